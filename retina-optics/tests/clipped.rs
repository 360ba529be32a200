//! Beams that apertures cut, and rays that fail otherwise.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

use std::path::Path;

use retina_optics::analysis::{
    PsfGridChoice, SpotOptions, Tolerances, encircled_energy, mtf, psf_grid, psf_polychromatic, ray_fans,
    relative_illumination, spots, tolerance_monte_carlo, wavefront,
};
use retina_optics::{
    Clipping, Launcher, OpticalSystem, Tracer, parse_prescription, shipped_design, shipped_designs,
};

fn read(surfaces: &str, field: &str, pupil_mm: f64) -> OpticalSystem {
    let text = format!(
        "schema = \"retina.optics/1\"\nname = \"test\"\n[beam]\nentrance_pupil_mm = {pupil_mm}\n\
         [[wavelength]]\nnm = 544.0\n[[field]]\n{field}\n{surfaces}[[surface]]\n"
    );
    parse_prescription(Path::new("test.toml"), &text).unwrap()
}

/// A singlet behind its stop whose rims cut half the beam of an oblique field.
fn cut_singlet() -> OpticalSystem {
    let surfaces = "[[surface]]\nstop = true\nthickness_mm = 25.0\n\
        [[surface]]\nradius_mm = 60.0\nthickness_mm = 4.0\nglass = \"N-BK7\"\nsemi_diameter_mm = 6.0\n\
        [[surface]]\nradius_mm = -60.0\nthickness_mm = 55.0\nsemi_diameter_mm = 6.0\n";
    read(surfaces, "y_tan = 0.2", 10.0)
}

/// A plane and a hemisphere of 5 mm, index 1.5: rays above 5 / 1.5 mm are totally reflected.
fn ball(pupil_mm: f64, semi_diameter: &str) -> OpticalSystem {
    let surfaces = format!(
        "[[surface]]\nstop = true\n[[surface]]\nthickness_mm = 5.0\nindex = 1.5\n\
         [[surface]]\nradius_mm = -5.0\nthickness_mm = 10.0\n{semi_diameter}\n"
    );
    read(&surfaces, "y_tan = 0.0", pupil_mm)
}

fn options(rings: usize) -> SpotOptions {
    SpotOptions { rings, arms: 48, clipping: Clipping::On }
}

/// Against single rays on a dense square grid, which knows nothing of edges: 700 points over the diameter
/// leave an edge uncertain by half a cell, some 2e-4 of the beam.
#[test]
fn a_cut_spot_does_not_depend_on_the_rings() {
    let system = cut_singlet();
    let launcher = Launcher::new(&system).unwrap();
    let tracer = Tracer::new(&system, 544.0, Clipping::On).unwrap();
    let (mut all, mut hits) = (0.0, Vec::new());
    for i in 0..700 {
        for j in 0..700 {
            let at = [i, j].map(|k: i32| (f64::from(k) + 0.5) / 350.0 - 1.0);
            if at[0].hypot(at[1]) <= 1.0 {
                all += 1.0;
                let ray = launcher.ray([0.0, 0.2], at).unwrap();
                hits.extend(tracer.trace_to_image(&ray).map(|hit| hit.local_mm));
            }
        }
    }
    let count = hits.len() as f64;
    let mean = hits.iter().sum::<glam::DVec3>() / count;
    let rms_um = 1e3 * (hits.iter().map(|hit| hit.distance_squared(mean)).sum::<f64>() / count).sqrt();
    assert!(count / all < 0.6, "the beam is cut: {}", count / all);
    for rings in [3, 4, 8, 24, 100] {
        let spot = &spots(&system, &options(rings)).unwrap().fields[0];
        assert!((spot.rms_um / rms_um - 1.0).abs() < 2e-3, "{rings} rings: {} against {rms_um}", spot.rms_um);
        assert!((spot.vignetted_fraction - (1.0 - count / all)).abs() < 5e-4, "{}", spot.vignetted_fraction);
    }
}

/// A central obstruction of 2 of 5 mm takes 4 / 25 of the beam, and one of a part of an arm at its outer end
/// too: a stop of 4 mm leaves 16 / 25 - 4 / 25.
#[test]
fn rings_of_light_are_split_at_both_edges() {
    let lens = "thickness_mm = 100.0\nfocal_mm = 100.0\n";
    for (aperture, clear) in [
        ("obstruction_mm = 2.0\nsemi_diameter_mm = 6.0\n", 21.0 / 25.0),
        ("obstruction_mm = 2.0\nsemi_diameter_mm = 4.0\n", 12.0 / 25.0),
    ] {
        let surfaces = format!("[[surface]]\nstop = true\n{aperture}[[surface]]\n{lens}");
        let system = read(&surfaces, "y_tan = 0.1", 10.0);
        for rings in [2, 24] {
            let spot = &spots(&system, &options(rings)).unwrap().fields[0];
            assert!((1.0 - spot.vignetted_fraction - clear).abs() < 1e-9, "{}", spot.vignetted_fraction);
        }
        let light = relative_illumination(&system, 1).unwrap();
        assert!((light.points[1].transmitted - clear).abs() < 1e-9, "{:?}", light.points);
    }
}

/// Where nothing is cut, apertures make no difference, to the last bit.
#[test]
fn an_uncut_spot_is_that_of_open_apertures() {
    let system = shipped_design("reference-1.3fc-wide").unwrap().unwrap();
    let open = spots(&system, &SpotOptions { clipping: Clipping::Off, ..options(8) }).unwrap();
    assert_eq!(spots(&system, &options(8)).unwrap().fields, open.fields);
}

/// Total reflection is no vignetting: every analysis says so, unless an aperture stops those rays before.
#[test]
fn total_reflection_is_refused_by_name_everywhere() {
    let system = ball(8.0, "");
    let at = [0.0, 0.0];
    let texts = [
        spots(&system, &options(8)).unwrap_err().to_string(),
        wavefront(&system, at, 544.0, 32, Clipping::On).unwrap_err().to_string(),
        ray_fans(&system, 16, Clipping::On).unwrap_err().to_string(),
        relative_illumination(&system, 1).unwrap_err().to_string(),
        psf_polychromatic(&system, at, 64, 32, 0.1, Clipping::On).unwrap_err().to_string(),
        mtf(&system, at, 64, 100.0, 10, Clipping::On).unwrap_err().to_string(),
    ];
    for text in texts {
        assert!(text.contains("total internal reflection at surface 3"), "{text}");
    }
    let stopped = spots(&ball(8.0, "semi_diameter_mm = 2.0"), &options(8)).unwrap();
    assert!((stopped.fields[0].vignetted_fraction - 0.75).abs() < 1e-9, "{stopped:?}");
}

/// Rays fail where h n > 5 mm: with 12 of the 6 Gaussian rings' radii, the outermost at 0.98306 of 3.36 mm,
/// above n = 1.51377. Of index errors within 0.1 that is a share of (0.1 - 0.01377) / 0.2 = 0.431.
#[test]
fn failed_trials_are_counted() {
    let system = ball(6.72, "");
    let tolerances = Tolerances { tilt_rad: 0.0, decentre_mm: 0.0, gap_mm: 0.0, index: 0.1, refocus: true };
    let report = tolerance_monte_carlo(&system, &tolerances, 600, 1, Clipping::On).unwrap();
    assert_eq!(report.failed + report.trials.len(), 600);
    // Three standard deviations of 600 draws.
    assert!((report.failed as f64 / 600.0 - 0.431).abs() < 0.061, "{}", report.failed);
}

/// The grid that is chosen holds 99 % of the light, never more than all of it.
#[test]
fn the_chosen_grid_holds_the_light() {
    for name in shipped_designs() {
        let system = shipped_design(name).unwrap().unwrap();
        let grid = psf_grid(&system, PsfGridChoice::default(), Clipping::On).unwrap();
        for field in &system.fields {
            let psf =
                psf_polychromatic(&system, field.at, grid.pupil_side, grid.side, grid.pitch_um, Clipping::On);
            let held = psf.unwrap().energy_on_grid;
            assert!((0.99..1.0).contains(&held), "{name} {:?}: {held}", field.at);
        }
    }
}

/// A grid that would hold light twice is refused with a pitch that is then allowed; a small one holds less
/// light, and encircled energy stays a share of all of it: 83.78 % in the first dark ring (Born and Wolf, 8.5.2).
#[test]
fn pitches_that_are_too_coarse_are_refused() {
    let system = read(
        "[[surface]]\nstop = true\n[[surface]]\nthickness_mm = 100.0\nfocal_mm = 100.0\n",
        "y_tan = 0.0",
        5.0,
    );
    let psf = |side, pitch_um| psf_polychromatic(&system, [0.0; 2], 128, side, pitch_um, Clipping::On);
    // Wavelength over the cone's full numerical aperture: the PSF's finest period.
    let unit_um = 0.544 / (2.0 * (0.025f64).atan().sin());
    for (side, largest_um) in [(32, unit_um), (512, 128.0 * unit_um / 512.0)] {
        let text = psf(side, 1.01 * largest_um).unwrap_err().to_string();
        let shown: f64 = text.split("at most ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
        assert!((shown - largest_um).abs() < 2e-4, "{text}, expected {largest_um}");
        assert!(psf(side, shown).unwrap().energy_on_grid <= 1.0 + 1e-9);
    }
    let small = psf(128, unit_um / 16.0).unwrap();
    assert!(small.energy_on_grid < 0.97, "{}", small.energy_on_grid);
    let energy = encircled_energy(&small, 400);
    let ring = energy.radius_um.iter().position(|&r| r >= 1.2197 * unit_um).unwrap();
    assert!((energy.fraction[ring] - 0.8378).abs() < 5e-3, "{}", energy.fraction[ring]);
}

/// Numbers that no bench has are refused with their place.
#[test]
fn absurd_numbers_are_refused() {
    let refusal = |surface: &str, field: &str| {
        let text = format!(
            "schema = \"retina.optics/1\"\nname = \"t\"\n[beam]\nentrance_pupil_mm = 5.0\n[[wavelength]]\nnm = 544.0\n\
             [[field]]\n{field}\n[[surface]]\nstop = true\n{surface}\n[[surface]]\n"
        );
        parse_prescription(Path::new("t.toml"), &text).unwrap_err().to_string()
    };
    for (surface, field, word) in [
        ("thickness_mm = 1e9", "y_tan = 0.0", "at most 1e6 mm"),
        ("thickness_mm = 1e300", "y_tan = 0.0", "surface 1"),
        ("thickness_mm = 10.0", "y_tan = 1e4", "field 1"),
        ("thickness_mm = 10.0\nindex = 50.0", "y_tan = 0.0", "no medium has this index"),
    ] {
        let text = refusal(surface, field);
        assert!(text.contains(word) && text.contains("t.toml"), "{word}: {text}");
    }
    let system = cut_singlet();
    let text = system.check_ray(Path::new("t"), [0.0; 2], [2.0, 2.0]).unwrap_err().to_string();
    assert!(text.contains("outside the pupil") && text.contains("2, 2"), "{text}");
    assert!(system.check_ray(Path::new("t"), [0.0; 2], [0.6, -0.8]).is_ok());
}
