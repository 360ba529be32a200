//! The analyses against closed forms.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

use std::f64::consts::{FRAC_1_SQRT_2, PI};

use retina_optics::analysis::{
    SpotOptions, Tolerances, at_temperature, encircled_energy, field_curves, ghosts, lens_elements, mtf, psf,
    psf_huygens, psf_polychromatic, ray_fans, relative_illumination, seidel_sums, spots, thermal_sweep,
    tolerance_monte_carlo, wavefront,
};
use retina_optics::glass::{GlassCatalogue, Medium};
use retina_optics::paraxial::Paraxial;
use retina_optics::{Clipping, OpticalSystem, Shape, Surface, SystemBuilder, Wavelength, shipped_design};

const NM: f64 = 550.0;

/// An ideal lens at its stop, f mm, with its image in the focal plane.
fn ideal(f: f64, pupil: f64) -> OpticalSystem {
    SystemBuilder::new("ideal", pupil)
        .wavelengths(&[Wavelength { nm: NM, weight: 1.0 }])
        .fields(&[[0.0, 0.0], [0.0, 0.1]])
        .surface(Surface::new(Shape::IdealLens { focal_mm: f }, 0.0, Medium::Air))
        .image_after(f)
        .unwrap()
}

/// A lens without thickness at its stop, of index 1.5, curvatures c1 and c2.
fn thin(c1: f64, c2: f64, pupil: f64, medium: Medium, image: f64) -> OpticalSystem {
    let surface =
        |c: f64, medium| Surface::new(Shape::Conic { curvature_per_mm: c, conic: 0.0 }, 0.0, medium);
    SystemBuilder::new("thin", pupil)
        .wavelengths(&[
            Wavelength { nm: 486.1, weight: 1.0 },
            Wavelength { nm: NM, weight: 1.0 },
            Wavelength { nm: 656.3, weight: 1.0 },
        ])
        .fields(&[[0.0, 0.0], [0.0, 0.05]])
        .surface(surface(c1, medium))
        .surface(surface(c2, Medium::Air))
        .image_after(image)
        .unwrap()
}

/// Bessel function J1 by its power series (Abramowitz and Stegun 9.1.10), good to v of about 20.
fn j1(v: f64) -> f64 {
    let (mut term, mut sum) = (v / 2.0, v / 2.0);
    for k in 1..80 {
        let k = f64::from(k);
        term *= -(v * v / 4.0) / (k * (k + 1.0));
        sum += term;
    }
    sum
}

/// A thin lens at its stop (Welford): S_III = H^2 phi, S_IV = H^2 phi / n, S_V = 0,
/// C_I = y^2 phi / V, C_II = 0. S_I of a plano-convex lens, convex side first, n = 1.5, object at infinity:
/// y^4 phi^3 / 4 (n^2/(n-1)^2 + (n+2)/(n(n-1)^2) (B - 2(n^2-1)/(n+2))^2 - n/(n+2)), B = 1.
#[test]
fn seidel_sums_of_a_thin_lens() {
    let (n, c1, y) = (1.5, 0.02, 5.0);
    let phi = (n - 1.0) * c1;
    let sums = seidel_sums(&thin(c1, 0.0, 2.0 * y, Medium::Index(n), 1.0 / phi)).unwrap().sum;
    let h = 0.05 * y;
    let near = |got: f64, expected: f64, name: &str| {
        assert!((got - expected).abs() < 1e-12 + 1e-12 * expected.abs(), "{name}: {got} against {expected}");
    };
    let square = |x: f64| x * x;
    let shape = (n + 2.0) / (n * square(n - 1.0)) * square(1.0 - 2.0 * (n * n - 1.0) / (n + 2.0));
    near(
        sums.spherical_mm,
        y.powi(4) * phi.powi(3) / 4.0 * (square(n / (n - 1.0)) + shape - n / (n + 2.0)),
        "S_I",
    );
    near(sums.astigmatism_mm, h * h * phi, "S_III");
    near(sums.petzval_mm, h * h * phi / n, "S_IV");
    near(sums.distortion_mm, 0.0, "S_V");
    let glass = GlassCatalogue::embedded().get("N-BK7").unwrap().clone();
    let [f, d, c] = [0.4861, 0.55, 0.6563].map(|um| glass.index(um).unwrap());
    let lens = thin(c1, -c1, 2.0 * y, Medium::Glass(glass), 45.0);
    let sums = seidel_sums(&lens).unwrap().sum;
    near(sums.axial_colour_mm, y * y * (d - 1.0) * 2.0 * c1 * (f - c) / (d - 1.0), "C_I");
    near(sums.lateral_colour_mm, 0.0, "C_II");
}

/// Third-order theory against real rays: for a small pupil the OPD of the marginal ray in the paraxial focus is
/// S_I / 8, and S_V / S_III / S_IV follow the real chief ray and foci of a Cooke triplet at a small field.
#[test]
fn seidel_sums_are_the_limit_of_real_rays() {
    let mut lens = shipped_design("cooke-triplet").unwrap().unwrap();
    lens.beam = retina_optics::Beam::EntrancePupil(2.0);
    let first = Paraxial::primary(&lens).unwrap().first_order();
    let image = lens.image();
    lens.surfaces[image - 1].thickness_mm = first.image_mm.unwrap();
    for field in &mut lens.fields {
        field.at[1] *= 0.1;
    }
    let sums = seidel_sums(&lens).unwrap().sum;
    let map = wavefront(&lens, [0.0, 0.0], NM, 201, Clipping::Off).unwrap();
    let rim = map.points.iter().find(|p| p.pupil[0] > 0.99 && p.pupil[1].abs() < 1e-9).unwrap();
    let opd_mm = rim.opd_waves.unwrap() * NM * 1e-6 / rim.pupil[0].powi(4);
    assert!((opd_mm / (sums.spherical_mm / 8.0) - 1.0).abs() < 0.02, "{opd_mm} {}", sums.spherical_mm / 8.0);
    let curves = field_curves(&lens, 1).unwrap();
    let (point, nu) = (&curves.points[1], 1.0 / first.working_f_number.unwrap() / 2.0);
    // Longitudinal foci: -(3 S_III + S_IV) and -(S_III + S_IV) over 2 n u^2 (Welford).
    let tangential = -(3.0 * sums.astigmatism_mm + sums.petzval_mm) / (2.0 * nu * nu);
    let sagittal = -(sums.astigmatism_mm + sums.petzval_mm) / (2.0 * nu * nu);
    assert!(
        (point.tangential_mm[1] / tangential - 1.0).abs() < 0.05,
        "{} {tangential}",
        point.tangential_mm[1]
    );
    assert!((point.sagittal_mm[1] / sagittal - 1.0).abs() < 0.05, "{} {sagittal}", point.sagittal_mm[1]);
    // Relative distortion: S_V / (2 n' u' h'), h' the image height, u' negative in a converging beam.
    let distortion = sums.distortion_mm / (-2.0 * nu * point.height_mm);
    assert!((point.distortion / distortion - 1.0).abs() < 0.05, "{} {distortion}", point.distortion);
}

/// Airy: PSF (2 J1(v) / v)^2, v = pi r / (lambda N); first dark ring at 1.22 lambda N holding 83.78 % of the
/// energy (Born and Wolf, 8.5.2); MTF 2/pi (acos s - s sqrt(1 - s^2)) (Goodman, Introduction to Fourier Optics).
#[test]
fn an_ideal_lens_gives_the_airy_pattern() {
    let (f, pupil) = (100.0, 5.0);
    let lens = ideal(f, pupil);
    // The exact f-number of the rim: sin, not tan, of the cone's half angle.
    let n = 1.0 / (2.0 * (pupil / 2.0 / f).atan().sin());
    let unit = NM * 1e-3 * n;
    let airy = |r_um: f64| {
        let v = PI * r_um / unit;
        if v < 1e-9 { 1.0 } else { (2.0 * j1(v) / v).powi(2) }
    };
    let fft = psf(&lens, [0.0, 0.0], NM, 128, 512, Clipping::On).unwrap();
    let direct = psf_polychromatic(&lens, [0.0, 0.0], 128, 129, 0.5, Clipping::On).unwrap();
    for pattern in [&fft, &direct] {
        let mut worst: f64 = 0.0;
        for row in 0..pattern.side {
            for column in 0..pattern.side {
                let [x, y] = pattern.at_um(column, row);
                if x.hypot(y) < 5.0 * unit {
                    worst = worst.max((pattern.values[row * pattern.side + column] - airy(x.hypot(y))).abs());
                }
            }
        }
        // The grid's cells resolve the rim to about a hundredth of a cell: 1e-3 of the amplitude.
        assert!(worst < 1e-3, "{worst}");
        assert!((pattern.peak() - 1.0).abs() < 1e-9);
    }
    let wide = psf_polychromatic(&lens, [0.0, 0.0], 128, 512, unit / 8.0, Clipping::On).unwrap();
    let energy = encircled_energy(&wide, 400);
    let ring = energy.radius_um.iter().position(|&r| r >= 1.2197 * unit).unwrap();
    assert!((energy.fraction[ring] - 0.8378).abs() < 5e-3, "{}", energy.fraction[ring]);
    let cutoff = 1e3 / unit;
    let transfer = mtf(&lens, [0.0, 0.0], 256, cutoff, 20, Clipping::On).unwrap();
    for (i, &frequency) in transfer.frequency_per_mm.iter().enumerate() {
        let s: f64 = (frequency / cutoff).min(1.0);
        let expected = 2.0 / PI * (s.acos() - s * (1.0 - s * s).sqrt());
        for got in [transfer.x[i], transfer.y[i], transfer.diffraction_limit[i]] {
            assert!((got - expected).abs() < 2e-3, "{s}: {got} against {expected}");
        }
    }
}

/// FFT against the sum of every ray's plane wave (other sampling, no sine condition): an aberrated Cooke triplet.
#[test]
fn fft_agrees_with_huygens() {
    let lens = shipped_design("cooke-triplet").unwrap().unwrap();
    for field in [[0.0, 0.0], [0.0, 0.12]] {
        let fft = psf(&lens, field, NM, 128, 512, Clipping::Off).unwrap();
        let side = 41;
        let exact = psf_huygens(&lens, field, NM, (40, 80), side, fft.pitch_um).unwrap();
        let peak = exact.peak();
        let (mut worst, mut moved): (f64, f64) = (0.0, 0.0);
        let at =
            |row: usize, column: usize| fft.values[(256 + row - side / 2) * 512 + 256 + column - side / 2];
        for row in 0..side {
            for column in 0..side {
                let expected = exact.values[row * side + column];
                worst = worst.max((at(row, column) - expected).abs() / peak);
                moved = moved.max((at(row, (column + 3) % side) - expected).abs() / peak);
            }
        }
        // 2 % covers the departure from the sine condition at 14 deg / f/5; a shift of 3 pixels must show.
        assert!(worst < 0.02, "{field:?}: {worst}");
        assert!(moved > 0.1, "{field:?}: the comparison cannot fail: {moved}");
    }
    let mut blurred = lens.clone();
    blurred.surfaces[5].thickness_mm += 1.0;
    let error = psf(&blurred, [0.0, 0.0], NM, 16, 64, Clipping::Off).unwrap_err().to_string();
    assert!(error.contains("more than half a wave"), "{error}");
}

/// cos^4 for an ideal lens at its stop; an aperture at half the beam leaves a quarter.
#[test]
fn illumination_follows_cos4_and_apertures() {
    let lens = ideal(50.0, 10.0);
    for point in relative_illumination(&lens, 4).unwrap().points {
        let expected = (1.0 + point.field * point.field).powi(-2);
        assert!((point.relative - expected).abs() < 1e-6, "{} {expected}", point.relative);
        assert!((point.transmitted - 1.0).abs() < 1e-12);
    }
    let mut narrow = lens;
    narrow.surfaces[1].aperture.outer_mm = 2.5;
    let options = SpotOptions { rings: 40, ..SpotOptions::default() };
    let lost = spots(&narrow, &options).unwrap().fields[0].vignetted_fraction;
    assert!((lost - 0.75).abs() < 0.01, "{lost}");
}

/// Fans and spots of an ideal lens out of focus by dz: transverse error dz x / f, RMS dz a / (f sqrt 2).
#[test]
fn fans_and_spots_of_pure_defocus() {
    let mut lens = ideal(100.0, 20.0);
    lens.surfaces[1].thickness_mm += 0.5;
    let fans = ray_fans(&lens, 2, Clipping::On).unwrap();
    for point in &fans.fields[0].wavelengths[0].y_fan {
        assert!((point.error_um + 500.0 * point.pupil * 10.0 / 100.0).abs() < 1e-9);
    }
    let rms = spots(&lens, &SpotOptions::default()).unwrap().fields[0].rms_um;
    assert!((rms - 500.0 * 0.1 * FRAC_1_SQRT_2).abs() < 1e-9, "{rms}");
}

/// A window in a parallel beam: reflectance ((n-1)/(n+1))^4, the ghost stays parallel. And through a Cooke
/// triplet, a narrow beam's traced radius is that of the paraxial ghost ray.
#[test]
fn ghosts_of_a_window_and_of_a_lens() {
    let plane = |t, medium| Surface::new(Shape::PLANE, t, medium);
    let window = SystemBuilder::new("window", 10.0)
        .surface(plane(4.0, Medium::Index(1.5)))
        .surface(plane(0.0, Medium::Air))
        .image_after(20.0)
        .unwrap();
    let ghost = ghosts(&window, None).unwrap()[0];
    assert!((ghost.reflectance - 0.2f64.powi(4)).abs() < 1e-15);
    assert_eq!((ghost.first, ghost.second, ghost.focus_mm), (2, 3, None));
    assert!((ghost.rms_radius_mm.unwrap() - 5.0 * FRAC_1_SQRT_2).abs() < 1e-12);
    assert!((ghosts(&window, Some(0.005)).unwrap()[0].reflectance - 2.5e-5).abs() < 1e-18);
    let mut lens = shipped_design("cooke-triplet").unwrap().unwrap();
    lens.beam = retina_optics::Beam::EntrancePupil(0.2);
    let all = ghosts(&lens, None).unwrap();
    assert_eq!(all.len(), 15);
    for ghost in all {
        let traced = ghost.rms_radius_mm.unwrap() / FRAC_1_SQRT_2;
        assert!((traced / ghost.paraxial_radius_mm - 1.0).abs() < 0.01, "{ghost:?}");
    }
}

/// A thin lens decentred by d moves its image by d: boresight is uniform in a square, mean square 2 d^2 / 3.
#[test]
fn tolerances_of_a_thin_lens() {
    let lens = thin(0.01, -0.01, 1.0, Medium::Index(1.5), 100.0);
    assert_eq!(lens_elements(&lens), [(1, 2)]);
    let d = 0.1;
    let tolerances = Tolerances { tilt_rad: 0.0, decentre_mm: d, gap_mm: 0.0, index: 0.0, refocus: false };
    let run = |seed| tolerance_monte_carlo(&lens, &tolerances, 4000, seed, Clipping::Off).unwrap();
    let report = run(7);
    let square: f64 =
        report.trials.iter().map(|t| t.boresight_mm[0].powi(2) + t.boresight_mm[1].powi(2)).sum();
    let mean = square / report.trials.len() as f64;
    // The mean of 4000 squares of a uniform variate scatters by 1 %.
    assert!((mean / (2.0 * d * d / 3.0) - 1.0).abs() < 0.04, "{mean}");
    assert!(report.trials.iter().all(|t| t.boresight_mm.iter().all(|b| b.abs() < d * 1.001)));
    assert_eq!(run(7), report);
    assert_ne!(run(8), report);
    let none = Tolerances { decentre_mm: 0.0, ..tolerances };
    let still = tolerance_monte_carlo(&lens, &none, 3, 1, Clipping::Off).unwrap();
    assert_eq!(still.trials[2], still.nominal);
    let expected = spots(&lens, &SpotOptions { rings: 6, arms: 12, clipping: Clipping::Off }).unwrap();
    assert!((still.nominal.rms_um[1] - expected.fields[1].rms_um).abs() < 1e-6);
    // An index error de of a thin lens moves the focus by -f de / (n - 1): refocusing finds it.
    let index = Tolerances { index: 1e-3, refocus: true, ..none };
    let moved = tolerance_monte_carlo(&lens, &index, 200, 3, Clipping::Off).unwrap();
    let largest =
        moved.trials.iter().map(|t| (t.refocus_mm - moved.nominal.refocus_mm).abs()).fold(0.0, f64::max);
    assert!(largest > 0.18 && largest < 0.2006, "{largest}");
}

/// A thin lens in a mount: df/dT = f (alpha - (dn/dT) / (n - 1)), n relative to the air of that temperature.
#[test]
fn temperature_of_a_thin_lens() {
    let glass = GlassCatalogue::embedded().get("N-BK7").unwrap().clone();
    let lens = thin(0.01, -0.01, 1.0, Medium::Glass(glass.clone()), 96.0);
    let [cold, warm] = [10.0, 30.0].map(|t| glass.index_at(0.55, t, 1.0).unwrap());
    let n = glass.index(0.55).unwrap();
    let f = Paraxial::primary(&lens).unwrap().first_order().efl_mm.unwrap();
    let expected = f * (7.1e-6 - (warm - cold) / 20.0 / (n - 1.0));
    let points = thermal_sweep(&lens, &[10.0, 30.0], 0.0, &SpotOptions::default()).unwrap();
    let slope = (points[1].efl_mm.unwrap() - points[0].efl_mm.unwrap()) / 20.0;
    assert!((slope / expected - 1.0).abs() < 1e-3, "{slope} {expected}");
    let same = at_temperature(&lens, 20.0, 1.0, 1e-5).unwrap();
    assert!((Paraxial::primary(&same).unwrap().first_order().efl_mm.unwrap() / f - 1.0).abs() < 1e-12);
    let unknown = GlassCatalogue::embedded().get("E-BAF11").unwrap().clone();
    let error =
        at_temperature(&thin(0.01, 0.0, 1.0, Medium::Glass(unknown), 90.0), 25.0, 1.0, 0.0).unwrap_err();
    assert!(error.to_string().contains("E-BAF11"), "{error}");
}

/// The results are what `--json` prints: they survive serialisation.
#[test]
fn results_serialise_with_units_in_their_names() {
    let lens = ideal(100.0, 5.0);
    let text = serde_json::to_string(&spots(&lens, &SpotOptions::default()).unwrap()).unwrap();
    assert!(text.contains("\"rms_um\"") && text.contains("\"airy_radius_um\""), "{text}");
}
