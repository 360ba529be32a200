//! The default sequence, and paths of other lengths, against integrations of their own.

use super::*;
use crate::time::parse_epoch;

fn made(halo: &LumioHalo) -> (Trajectory, HaloSummary) {
    halo.generate(&Ephemeris::analytic()).unwrap()
}

/// Frames about the middle of the default sequence.
fn about_the_middle(frames: usize, step_s: f64) -> LumioHalo {
    LumioHalo::centred_on(NEW_MOON_TDB_S, frames, step_s)
}

fn state(pose: &FramePose) -> MoonState {
    let (r, v) = (pose.camera_position_m, pose.camera_velocity_m_s.unwrap());
    [r.x, r.y, r.z, v.x, v.y, v.z]
}

#[test]
fn the_default_sequence_is_lumios() {
    let started = std::time::Instant::now();
    let (trajectory, summary) = made(&LumioHalo::default());
    let took_s = started.elapsed().as_secs_f64();
    assert!(took_s < 2.0 || cfg!(debug_assertions), "{took_s} s");
    assert_eq!(trajectory.frames.len(), 4321);
    let middle = &trajectory.frames[2160];
    let new_moon_s = Ephemeris::analytic().next_new_moon_s(parse_epoch("2027-07-10").unwrap()).unwrap();
    assert!((middle.time_s - new_moon_s).abs() < 5.0, "new Moon at {new_moon_s}");
    assert!(summary.jacobi_drift < 1e-10 && (summary.jacobi - 3.09).abs() < 1e-11);
    assert!((14.1..14.8).contains(&summary.period_days));
    assert!(summary.half_period_residual < 1e-11);
    assert!(summary.distance_min_m > 30e6 && summary.distance_max_m < 90e6, "{summary}");
    assert!(summary.lit_fraction > 0.9, "{summary}");
    assert!(summary.defects[0] < 1e-3 && summary.defects[1] < 1e-8, "{summary}");
    assert!((1e6..10e6).contains(&summary.moved_m), "{summary}");
    for pose in &trajectory.frames {
        let to_moon = (-pose.camera_position_m).normalize();
        let seen = pose.camera_from_inertial * to_moon;
        assert!((seen - DVec3::Z).length() < 1e-12, "{seen}");
        // North is up (-y) and not tilted to either side.
        let moon = &pose.bodies["moon"];
        let north = pose.camera_from_inertial * (moon.body_from_inertial.inverse() * DVec3::Z);
        assert!(north.x.abs() < 1e-12 && north.y < 0.0, "{north}");
        // The far side is what is seen.
        let camera = moon.body_from_inertial * pose.camera_position_m.normalize();
        assert!(camera.x < 0.0);
    }
}

/// The classical Runge-Kutta method with the forces written out anew, the bodies asked of the theories each 10 min and
/// the Moon's own acceleration from their masses: the oracle of the path's continuity.
fn runge_kutta(mut y: MoonState, from_s: f64, to_s: f64) -> MoonState {
    const H_S: f64 = 600.0;
    let rate = |t: f64, y: &MoonState| -> MoonState {
        let bodies = Ephemeris::analytic().solar_system(t).unwrap();
        let at = DVec3::from_slice(&y[..3]);
        let pull = |from: DVec3, gm: f64| -from * gm / from.length().powi(3);
        let (earth, sun) = (
            bodies.earth.position_m - bodies.moon.position_m,
            bodies.sun.position_m - bodies.moon.position_m,
        );
        let mut a = pull(at, 4.902_800_118e12);
        a += pull(at - earth, 3.986_004_355_07e14) - pull(-earth, 3.986_004_355_07e14);
        a += pull(at - sun, 1.327_124_400_412_794e20) - pull(-sun, 1.327_124_400_412_794e20);
        // 1361 W/m^2 at 1 au on 0.4 m^2 of 24 kg, with the coefficient 1.3.
        let au = 149_597_870_700.0 / (at - sun).length();
        a += (at - sun).normalize() * (1361.0 / 299_792_458.0 * au * au * 1.3 * 0.4 / 24.0);
        [y[3], y[4], y[5], a.x, a.y, a.z]
    };
    let along =
        |y: &MoonState, k: &MoonState, h: f64| -> MoonState { std::array::from_fn(|i| y[i] + h * k[i]) };
    let steps = ((to_s - from_s) / H_S).round();
    assert!((steps * H_S - (to_s - from_s)).abs() < 1e-3);
    for step in 0..steps as usize {
        let t = from_s + step as f64 * H_S;
        let k1 = rate(t, &y);
        let k2 = rate(t + H_S / 2.0, &along(&y, &k1, H_S / 2.0));
        let k3 = rate(t + H_S / 2.0, &along(&y, &k2, H_S / 2.0));
        let k4 = rate(t + H_S, &along(&y, &k3, H_S));
        y = std::array::from_fn(|i| y[i] + H_S / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]));
    }
    y
}

#[test]
fn a_frames_state_leads_to_a_later_frames_state() {
    let (trajectory, _) = made(&about_the_middle(361, 3600.0));
    let off = |first: usize, last: usize| {
        let (a, b) = (&trajectory.frames[first], &trajectory.frames[last]);
        let end = runge_kutta(state(a), a.time_s, b.time_s);
        let expected = state(b);
        let off: MoonState = std::array::from_fn(|i| end[i] - expected[i]);
        [&off[..3], &off[3..]].map(|part| DVec3::from_slice(part).length())
    };
    // What the table's interpolation (2 m of the Moon) and Runge and Kutta's steps make of a day, and what the
    // halo's instability makes of that in 15 days: a thousand times as much.
    for first in [0, 100, 200, 330] {
        let [m, m_s] = off(first, first + 24);
        assert!(m < 0.3 && m_s < 1e-5, "{first}: {m} m, {m_s} m/s after a day");
    }
    let [m, m_s] = off(0, 360);
    assert!(m < 50.0 && m_s < 5e-4, "{m} m, {m_s} m/s after 15 days");
}

#[test]
fn spans_of_one_frame_to_half_a_year_are_paths_near_the_same_orbit() {
    for (frames, step_s) in
        [(1, 300.0), (2, 0.0), (3, 300.0), (30, 86_400.0), (181, 86_400.0), (500, -3600.0), (7, 1e6)]
    {
        let (trajectory, summary) = made(&about_the_middle(frames, step_s));
        assert_eq!(trajectory.frames.len(), frames);
        assert!(summary.defects[0] < 1e-3 && summary.defects[1] < 1e-8, "{frames}: {summary}");
        // Within a fifth of the orbit's own size, at the distances of halos beside it.
        assert!(summary.moved_m < 13e6, "{frames}: {summary}");
        assert!(summary.distance_min_m > 35e6 && summary.distance_max_m < 88e6, "{frames}: {summary}");
    }
}

#[test]
fn the_path_is_near_the_circular_problems_orbit_at_any_epoch_and_south_of_it_most() {
    let ephemeris = Ephemeris::analytic();
    let orbit = southern_l2_halo(3.09).unwrap();
    for epoch in ["1911-02-03", "1969-07-20", "2027-02-20", "2093-11-05"] {
        let halo = LumioHalo { epoch_tdb_s: parse_epoch(epoch).unwrap(), ..about_the_middle(61, 21_600.0) };
        let (trajectory, _) = made(&halo);
        let (mut lowest, mut highest) = (0.0_f64, 0.0_f64);
        for (frame, pose) in trajectory.frames.iter().enumerate() {
            let since = 0.5 * orbit.period + MEAN_MOTION_RAD_S * 21_600.0 * frame as f64;
            let since = [0.0, since.rem_euclid(orbit.period)];
            let circular = integrate(|_, s| dynamics(s), orbit.start, since, TOLERANCE).unwrap();
            let former = moon_state(&ephemeris, pose.time_s, &circular).unwrap();
            let off_m = pose.camera_position_m.distance(DVec3::from_slice(&former[..3]));
            assert!(off_m < 13e6, "{epoch}, {frame}: {off_m} m");
            let rotating =
                pulsating_frame(&ephemeris, pose.time_s).unwrap().inverse() * pose.camera_position_m;
            assert!(rotating.x > 0.0, "{epoch}, {frame}: beyond the Moon");
            (lowest, highest) = (lowest.min(rotating.z), highest.max(rotating.z));
        }
        assert!(-lowest > 1.5 * highest, "{epoch}: {lowest} {highest}");
    }
}

#[test]
fn the_number_of_workers_changes_no_bit() {
    let halo = about_the_middle(200, 5000.0);
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let three = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    let [one, many] = [alone, three].map(|pool| pool.install(|| made(&halo)));
    assert_eq!(one, many);
}

#[test]
fn sunlight_moves_the_path() {
    let [dark, lit] = [0.0, LUMIO_PRESSURE_AREA_M2_KG].map(|pressure_area_m2_kg| {
        made(&LumioHalo { pressure_area_m2_kg, ..about_the_middle(31, 43_200.0) }).0
    });
    let off_m = dark
        .frames
        .iter()
        .zip(&lit.frames)
        .fold(0.0_f64, |most, (a, b)| most.max(a.camera_position_m.distance(b.camera_position_m)));
    // 1e-7 m/s^2 for as long as the orbit takes to answer, (1e5 s)^2: a kilometre.
    assert!((100.0..1e5).contains(&off_m), "{off_m} m");
}

#[test]
fn what_cannot_be_made_is_refused() {
    let halo = LumioHalo { frames: 2, ..LumioHalo::default() };
    let refused = |halo: LumioHalo| halo.generate(&Ephemeris::analytic()).map(|_| ()).unwrap_err();
    assert!(matches!(refused(LumioHalo { frames: 0, ..halo.clone() }), HaloError::NoFrames));
    for not_finite in [
        LumioHalo { step_s: f64::NAN, ..halo.clone() },
        LumioHalo { epoch_tdb_s: f64::INFINITY, ..halo.clone() },
        LumioHalo { pressure_area_m2_kg: f64::NAN, ..halo.clone() },
    ] {
        assert!(matches!(refused(not_finite), HaloError::NotFinite { .. }));
    }
    assert!(matches!(refused(LumioHalo { jacobi: 3.3, ..halo.clone() }), HaloError::NoOrbit(_)));
    assert!(matches!(refused(LumioHalo { epoch_tdb_s: 4e9, ..halo.clone() }), HaloError::Ephemeris(_)));
    assert!(matches!(refused(LumioHalo { step_s: 1e300, ..halo.clone() }), HaloError::Ephemeris(_)));
    // A push of 0.5 m/s^2 leaves no orbit.
    let error = refused(LumioHalo { pressure_area_m2_kg: 1e5, frames: 4000, ..halo });
    assert!(error.to_string().contains("no path of the forces"), "{error}");
}
