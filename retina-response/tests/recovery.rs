//! Known responses are found again: the truth is the closed form that the readings were drawn from.

#![allow(clippy::unwrap_used, reason = "a test")]

mod common;

use common::{TRUTH, Truth, fit, plan, readings};
use retina_response::Estimate;

/// Half width of a 90 % interval of a normal, sigmas.
const NINETY_PERCENT: f64 = 1.644_85;

fn off(estimate: Estimate, truth: f64) -> f64 {
    (estimate.value - truth) / estimate.sigma
}

/// Rms of the drawn noise over the light, of the readings where that is below a tenth.
fn relative_noise() -> f64 {
    let each: Vec<f64> = plan()
        .iter()
        .filter(|(_, square_px)| *square_px > 0.0)
        .map(|&(count, n)| TRUTH.sigma_w_m2(n * n, count) / (n * n * TRUTH.pixel_w_m2(count)))
        .filter(|share| *share < 0.1)
        .collect();
    (each.iter().map(|share| share * share).sum::<f64>() / each.len() as f64).sqrt()
}

#[test]
fn gamma_black_zero_and_full_are_found_within_three_sigma() {
    for stated in [true, false] {
        let found = fit(&readings(&TRUTH, &plan(), 7, stated)).unwrap();
        let offs = [
            off(found.gamma, TRUTH.gamma),
            off(found.black, TRUTH.black),
            off(found.full_w_m2, TRUTH.full_w_m2),
            off(found.zero_w_m2.unwrap(), TRUTH.zero_w_m2),
        ];
        assert!(offs.iter().all(|off| off.abs() < 3.0), "{stated}: {offs:?}");
        assert!(found.gamma.sigma < 0.01 && found.black.sigma < 0.2 * TRUTH.black, "{found:?}");
        assert!(found.warnings.is_empty(), "{:?}", found.warnings);
        assert!((found.rms_relative / relative_noise() - 1.0).abs() < 0.3, "{}", found.rms_relative);
        assert!(found.irradiance_w_m2.windows(2).all(|pair| pair[1] > pair[0]));
        if !stated {
            let noise = found.noise.unwrap();
            assert!((noise.proportional / TRUTH.proportional - 1.0).abs() < 0.4, "{noise:?}");
            assert!((noise.floor_w_m2 / TRUTH.floor_w_m2 - 1.0).abs() < 0.6, "{noise:?}");
        }
    }
}

/// 90 % intervals hold the truth in 85 to 95 % of 300 campaigns (two standard errors of 300 draws are 3.5 %).
fn ninety_percent_intervals(stated: bool) {
    const CAMPAIGNS: u64 = 300;
    {
        let mut inside = [0u32; 6];
        let mut bent = 0;
        for seed in 0..CAMPAIGNS {
            let found = fit(&readings(&TRUTH, &plan(), 1000 + seed, stated)).unwrap();
            let at = |count: usize| {
                (found.irradiance_w_m2[count] - TRUTH.pixel_w_m2(count)) / found.sigma_w_m2[count]
            };
            let offs = [
                off(found.gamma, TRUTH.gamma),
                off(found.black, TRUTH.black),
                off(found.full_w_m2, TRUTH.full_w_m2),
                off(found.zero_w_m2.unwrap(), TRUTH.zero_w_m2),
                at(5),
                at(128),
            ];
            for (inside, off) in inside.iter_mut().zip(offs) {
                *inside += u32::from(off.abs() < NINETY_PERCENT);
            }
            bent += u32::from(found.knots > 2);
        }
        println!("stated {stated}: {inside:?} of {CAMPAIGNS} inside, {bent} with more than two knots");
        assert!(bent < 15, "{bent} of {CAMPAIGNS} power laws were given more knots");
        for inside in inside {
            let share = f64::from(inside) / CAMPAIGNS as f64;
            assert!((0.85..=0.95).contains(&share), "stated {stated}: {share}");
        }
    }
}

#[test]
fn intervals_hold_the_truth_nine_times_of_ten_where_noise_is_stated() {
    ninety_percent_intervals(true);
}

#[test]
fn intervals_hold_the_truth_nine_times_of_ten_where_noise_is_estimated() {
    ninety_percent_intervals(false);
}

/// Forty-three readings in which the meter's floor hides most of the proportional noise: the likeliest noise often has none,
/// and bright readings would then be believed far too much.
#[test]
fn noise_that_few_readings_tell_is_not_taken_for_none() {
    let truth = Truth { black: 2e-5, floor_w_m2: 2e-7, zero_w_m2: 3e-7, proportional: 0.002, ..TRUTH };
    let mut plan = vec![(0, 0.0); 4];
    plan.push((0, 400.0));
    for count in [2, 4, 8, 12, 16, 24, 32, 48, 64, 96, 128, 160, 192, 224, 255] {
        plan.extend([100.0, 200.0].map(|square| (count, square)));
        if count < 64 {
            plan.push((count, 400.0));
        }
    }
    let offs: Vec<f64> = (0..120)
        .map(|seed| {
            off(fit(&readings(&truth, &plan, 5000 + seed, false)).unwrap().full_w_m2, truth.full_w_m2).abs()
        })
        .collect();
    let beyond = offs.iter().filter(|off| **off > 3.0).count();
    let worst = offs.iter().copied().fold(0.0, f64::max);
    println!("{beyond} of {} beyond three sigmas, {worst:.1} at worst, {} readings", offs.len(), plan.len());
    assert!(beyond <= 3 && worst < 5.0, "{beyond}, {worst}");
}

/// A display that departs from its power law by up to 5 %: the curve follows it to within its noise.
#[test]
fn a_departure_from_the_power_law_is_followed() {
    let truth = Truth { bend: 0.05, ..TRUTH };
    let found = fit(&readings(&truth, &plan(), 3, true)).unwrap();
    assert!(found.knots > 2);
    for count in [4, 8, 16, 40, 90, 128, 200, 255] {
        let error = found.irradiance_w_m2[count] / truth.pixel_w_m2(count) - 1.0;
        assert!(
            error.abs() < 0.006 + 4.0 * found.sigma_w_m2[count] / truth.pixel_w_m2(count),
            "{count}: {error}"
        );
    }
    assert!(found.irradiance_w_m2.windows(2).all(|pair| pair[1] > pair[0]));
}

/// One wild reading in twelve changes nothing but the list of outliers.
#[test]
fn wild_readings_are_set_aside() {
    let mut drawn = readings(&TRUTH, &plan(), 11, true);
    let wild: Vec<usize> = (9..drawn.len()).step_by(12).collect();
    for (k, &i) in wild.iter().enumerate() {
        drawn[i].irradiance_w_m2 *= if k % 2 == 0 { 1.7 } else { 0.6 };
    }
    let found = fit(&drawn).unwrap();
    assert!(off(found.gamma, TRUTH.gamma).abs() < 3.0 && off(found.full_w_m2, TRUTH.full_w_m2).abs() < 3.0);
    let named: Vec<usize> = found.outliers.iter().map(|&(_, line)| line - 2).collect();
    let far = |i: &&usize| drawn[**i].irradiance_w_m2 > 20.0 * TRUTH.floor_w_m2 + TRUTH.zero_w_m2;
    assert!(wild.iter().filter(far).all(|i| named.contains(i)), "{named:?} of {wild:?}");
}

/// High counts alone, one square: gamma and black are one unknown, and black and zero another; both are said.
#[test]
fn what_cannot_be_told_apart_is_said() {
    let plan: Vec<(usize, f64)> = (0..20).map(|k| (200 + 55 * k / 19, 100.0)).collect();
    let found = fit(&readings(&TRUTH, &plan, 5, true)).unwrap();
    let all = found.warnings.join("\n");
    assert!(all.contains("gamma and black cannot be told apart"), "{all}");
    assert!(all.contains("the meter's zero cannot be told apart"), "{all}");
    assert_eq!(found.zero_w_m2, None);
}

/// Sigmas stated three times too small are raised, and that is said.
#[test]
fn stated_sigmas_that_are_too_small_are_raised() {
    let honest = fit(&readings(&TRUTH, &plan(), 4, true)).unwrap();
    let mut drawn = readings(&TRUTH, &plan(), 4, true);
    drawn.iter_mut().for_each(|r| r.sigma_w_m2 = r.sigma_w_m2.map(|s| s / 3.0));
    let found = fit(&drawn).unwrap();
    assert!(found.warnings.iter().any(|text| text.contains("sigma_w_m2")), "{:?}", found.warnings);
    assert!((found.gamma.sigma / honest.gamma.sigma - 1.0).abs() < 0.4);
}
