use std::path::Path;

use super::*;

fn setup(name: &str) -> Setup {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/setups");
    Setup::read(&folder.join(name)).unwrap()
}

/// Coarse enough for tests.
fn quick() -> BenchOptions {
    let detail = OpticsDetail { nodes: [5, 4], lines: 1, half_px: 24 };
    BenchOptions { detail, ..BenchOptions::default() }
}

fn centroid(light: &[f32], width: usize, about: [f64; 2], half: i64) -> ([f64; 2], f64) {
    let (mut sum, mut x, mut y) = (0.0, 0.0, 0.0);
    let (cx, cy) = (about[0] as i64, about[1] as i64);
    for j in cy - half..=cy + half {
        for i in cx - half..=cx + half {
            if i >= 0 && j >= 0 && (i as usize) < width && (j as usize) < light.len() / width {
                let value = f64::from(light[j as usize * width + i as usize]);
                sum += value;
                x += value * (i as f64 + 0.5);
                y += value * (j as f64 + 0.5);
            }
        }
    }
    ([x / sum, y / sum], sum)
}

/// The light-weighted mean with a Gaussian weight about the result, sqrt(2) times as wide as the spot: place and width.
/// Written here from the pixels alone, as a detector would.
fn windowed(light: &[f32], width: usize, about: [f64; 2]) -> ([f64; 2], f64) {
    let (mut at, mut sigma) = (about, 1.5f64);
    for _ in 0..200 {
        let weight2 = 2.0 * sigma * sigma;
        let half = (3.0 * weight2.sqrt()).ceil() as i64;
        let (mut sum, mut first, mut second) = (0.0, [0.0; 2], [0.0; 3]);
        for j in at[1] as i64 - half..=at[1] as i64 + half {
            for i in at[0] as i64 - half..=at[0] as i64 + half {
                let inside = i >= 0 && j >= 0 && (i as usize) < width && (j as usize) < light.len() / width;
                if inside {
                    let [x, y] = [i as f64 + 0.5 - at[0], j as f64 + 0.5 - at[1]];
                    let w = f64::from(light[j as usize * width + i as usize])
                        * (-(x * x + y * y) / (2.0 * weight2)).exp();
                    sum += w;
                    first = [first[0] + w * x, first[1] + w * y];
                    second = [second[0] + w * x * x, second[1] + w * x * y, second[2] + w * y * y];
                }
            }
        }
        let step = first.map(|m| 1.5 * m / sum);
        at = [at[0] + step[0], at[1] + step[1]];
        // The Gaussian whose product with the weight has these moments.
        let moments =
            glam::DMat2::from_cols_array(&[second[0], second[1], second[1], second[2]]) * (1.0 / sum);
        let own = moments.inverse() - glam::DMat2::from_diagonal(glam::DVec2::splat(1.0 / weight2));
        let next = if own.determinant() > 0.0 { own.determinant().powf(-0.25) } else { 1.5 * sigma };
        let next = next.clamp(0.5, 7.0);
        let settled = step[0].hypot(step[1]) < 1e-5 && (next / sigma - 1.0).abs() < 1e-5;
        sigma = next;
        if settled {
            break;
        }
    }
    (at, sigma)
}

/// A green sub-pixel's image is where the optics say, and has its light: that of a star of the channel's share (eq. 10),
/// times cos^4 and the solid angle. Black, glare and mura off.
#[test]
fn a_point_lands_where_it_should_with_its_light() {
    let mut setup = setup("wide-fov.toml");
    setup.optics.veiling_glare = 0.0;
    setup.optics.coating_reflectance = 0.0;
    setup.optics.black_level = 0.0;
    setup.optics.mura = 0.0;
    let bench = Bench::new(&setup, &quick()).unwrap();
    let exposure = Exposure::new(1e-3, 0);
    for at in [[960, 600], [1500, 250], [300, 1100]] {
        let mut screen = ScreenImage::dark(1920, 1200);
        screen.set(at[0], at[1], [0, 255, 0]);
        let light = bench.light_e(&screen, &exposure).unwrap();
        let expected = bench.land_px([f64::from(at[0]) + 0.5, f64::from(at[1]) + 0.5], 1, &exposure).unwrap();
        let (_, sum) = centroid(&light, 2048, expected, 22);
        let (got, _) = windowed(&light, 2048, expected);
        assert!((got[0] - expected[0]).hypot(got[1] - expected[1]) < 0.15, "{got:?} {expected:?}");
        // K_f shows about the same place: distortion is 2 % of it at most.
        let k = setup
            .facility_pinhole()
            .line_of_sight(glam::DVec2::new(f64::from(at[0]) + 0.5, f64::from(at[1]) + 0.5));
        let pinhole = setup.camera_pinhole().pixel(k);
        assert!((pinhole.x - expected[0]).hypot(pinhole.y - expected[1]) < 25.0, "{pinhole} {expected:?}");
        if at == [960, 600] {
            let star = bench.star_e_s(setup.brightest_magnitude()) * 1e-3 / 3.0;
            assert!((sum / star - 1.0).abs() < 0.02, "{sum} {star}");
        }
    }
}

/// The two ways of laying light on the sensor agree for what is resolved: in light, place and the mean
/// over pixels. The scene's grid of whole pixels does not hold the beat of the screen's pixels with the
/// camera's, which reaches 2 % where the optics are sharpest.
#[test]
fn points_and_scenes_agree() {
    let mut setup = setup("wide-fov.toml");
    setup.optics.mura = 0.0;
    let bench = Bench::new(&setup, &quick()).unwrap();
    for middle in [[960.0, 600.0], [1500.0, 250.0]] {
        let mut screen = ScreenImage::dark(1920, 1200);
        for row in 0..1200 {
            for column in 0..1920 {
                let d = (f64::from(column) - middle[0]).hypot(f64::from(row) - middle[1]);
                if d < 40.3 {
                    screen.set(column, row, [200; 3]);
                }
            }
        }
        // So long that what points leave out (0.02 electrons a source and pixel) does not count.
        let exposure = Exposure::new(1.0, 0);
        let sources = bench.sources(&screen, &exposure).unwrap();
        let mut points = vec![0f32; 2048 * 1536];
        let mut scene = points.clone();
        bench.optics().add_points(&mut points, &sources);
        let tiles = bench.optics().tiles(&bench.scene(&screen, &exposure).unwrap(), &bench.buffers);
        scene.chunks_exact_mut(2048).enumerate().for_each(|(y, row)| tiles.add_to_row(y, row));
        let peak = points.iter().copied().fold(0.0, f32::max);
        let worst = points.iter().zip(&scene).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(peak > 50.0 && worst < 0.03 * peak, "{worst} of {peak}");
        let lit = points.iter().filter(|v| **v > 0.5 * peak).count() as f64;
        let square: f64 = points.iter().zip(&scene).map(|(a, b)| f64::from(a - b).powi(2)).sum();
        assert!((square / lit).sqrt() < 0.012 * f64::from(peak), "{} of {peak}", (square / lit).sqrt());
        let sums = [&points, &scene].map(|image| image.iter().map(|v| f64::from(*v)).sum::<f64>());
        assert!((sums[0] / sums[1] - 1.0).abs() < 1e-3, "{sums:?}");
        let about = bench.land_px(middle, 1, &exposure).unwrap();
        let [a, b] = [&points, &scene].map(|image| centroid(image, 2048, about, 90).0);
        assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 3e-3, "{a:?} {b:?}");
    }
}

/// Images are laid in memory that was used before: an exposure knows nothing of those before it.
#[test]
fn an_exposure_does_not_depend_on_those_before_it() {
    let bench = Bench::new(&setup("wide-fov.toml"), &quick()).unwrap();
    let mut points = ScreenImage::dark(1920, 1200);
    points.set(960, 600, [255; 3]);
    let disc = |radius: f64| {
        let mut screen = ScreenImage::dark(1920, 1200);
        for (row, column) in (0..1200).flat_map(|row| (0..1920).map(move |column| (row, column))) {
            if (f64::from(column) - 960.0).hypot(f64::from(row) - 600.0) < radius {
                screen.set(column, row, [180; 3]);
            }
        }
        screen
    };
    let (large, small) = (disc(400.0), disc(80.0));
    let expose = |screen: &ScreenImage| bench.expose(screen, &Exposure::new(0.01, 7)).unwrap();
    let first = [&small, &points].map(expose);
    expose(&large);
    assert!(first == [&small, &points].map(expose));
}

/// An exposure is the same bytes again, another frame is not; an unlit one has the offset and the read
/// noise that the setup states.
#[test]
fn noise_is_the_setups_and_repeats() {
    let setup = setup("wide-fov.toml");
    let bench = Bench::new(&setup, &quick()).unwrap();
    let dark = ScreenImage::dark(1920, 1200);
    let first = bench.expose(&dark, &Exposure::new(0.01, 3)).unwrap();
    assert_eq!(first, bench.expose(&dark, &Exposure::new(0.01, 3)).unwrap());
    let other = bench.expose(&dark, &Exposure::new(0.01, 4)).unwrap();
    assert_ne!(first, other);
    // Differences of two frames hold no fixed pattern: twice the variance of read noise, rounding and the
    // dark current's few electrons.
    let gain = bench.sensor().gain_e_per_dn;
    let count = first.dn.len() as f64;
    let difference = |i: usize| f64::from(first.dn[i]) - f64::from(other.dn[i]);
    let variance = (0..first.dn.len()).map(|i| difference(i).powi(2)).sum::<f64>() / count / 2.0;
    let black = f64::from(bench.light_e(&dark, &Exposure::new(0.01, 0)).unwrap()[0]);
    let expected = (2.3f64.powi(2) + 0.01 + black) / gain.powi(2) + 1.0 / 12.0;
    assert!((variance / expected - 1.0).abs() < 0.05, "{variance} {expected}");
    let mean = first.dn.iter().map(|&v| f64::from(v)).sum::<f64>() / count;
    assert!((mean - 32.0).abs() < 0.05, "{mean}");
}

/// With the same pupil and sensor, a brighter screen saturates where it should.
#[test]
fn a_full_pixel_is_full() {
    let bench = Bench::new(&setup("wide-fov.toml"), &quick()).unwrap();
    let mut screen = ScreenImage::dark(1920, 1200);
    screen.set(960, 600, [255; 3]);
    let frame = bench.expose(&screen, &Exposure::new(1.0, 0)).unwrap();
    assert_eq!(frame.dn.iter().copied().max().unwrap(), 4095);
    let error = bench.expose(&ScreenImage::dark(10, 10), &Exposure::new(1.0, 0)).unwrap_err();
    assert!(error.to_string().contains("[10, 10]"), "{error}");
}

/// The reference is matched by the diagonal: M -1.388 in the place of eq. 13's -1.566, 12.8 % off.
#[test]
fn lenses_of_another_magnification_than_the_setups_are_refused() {
    let mut wrong = setup("wide-fov.toml");
    wrong.optics.system = Some("reference-1.3fc-wide".into());
    let said = crate::facility_system(&wrong).unwrap_err().to_string();
    assert!(said.contains("wide-fov.toml, key `optics.system`"), "{said}");
    // 86.8 / 1.388 and 86.8 / 1.566 mm.
    assert!(said.contains("of f_c / |M| 62.5") && said.contains("expected 55.4"), "{said}");
    let BenchError::Input(error) = crate::facility_system(&wrong).unwrap_err() else { unreachable!() };
    let help = error.help.unwrap();
    assert!(help.contains("set observed_rows_px = 135"), "{help}");
    wrong.facility.observed_rows_px = Some(1354.0);
    assert!(crate::facility_system(&wrong).is_ok());
    let mut narrow = setup("narrow-fov.toml");
    narrow.optics.system = Some("reference-1.3fc-wide".into());
    assert!(crate::facility_system(&narrow).is_err());
}

/// Parts of a point's image taken away leave its light and its place, and make it sharper.
#[test]
fn parts_of_a_points_image_can_be_left_out() {
    let setup = setup("wide-fov.toml");
    let exposure = Exposure::new(1e-3, 0);
    let mut screen = ScreenImage::dark(1920, 1200);
    screen.set(1500, 1100, [0, 255, 0]);
    let images = [PointImage::Point, PointImage::Diffraction, PointImage::Full].map(|point_image| {
        let bench = Bench::new(&setup, &BenchOptions { point_image, ..quick() }).unwrap();
        let sources = bench.sources(&screen, &exposure).unwrap();
        let at = bench.land_px([1500.5, 1100.5], 1, &exposure).unwrap();
        let mut light = vec![0f32; 2048 * 1536];
        bench.optics().add_points(&mut light, &sources);
        let (mean, sum) = centroid(&light, 2048, at, 20);
        // The others have no coma. Of a point that is smaller than the pixel, the pixel is all that is known.
        let (seen, within_px) = match point_image {
            PointImage::Point => (mean, 0.5),
            PointImage::Diffraction => (mean, 0.1),
            PointImage::Full => (windowed(&light, 2048, at).0, 0.1),
        };
        assert!((seen[0] - at[0]).hypot(seen[1] - at[1]) < within_px, "{point_image:?}: {seen:?} {at:?}");
        (f64::from(light.iter().copied().fold(0.0, f32::max)) / sum, sum)
    });
    let [point, diffraction, full] = images;
    assert!(point.0 > 1.2 * diffraction.0 && diffraction.0 > 1.5 * full.0, "{images:?}");
    // Wings of the full image lie beyond what is summed here.
    assert!(
        (diffraction.1 / point.1 - 1.0).abs() < 0.02 && (full.1 / point.1 - 1.0).abs() < 0.05,
        "{images:?}"
    );
}

/// Without noise the numbers are the mean of what the sensor reads.
#[test]
fn numbers_without_noise_are_the_mean_of_those_with_it() {
    let bench = Bench::new(&setup("wide-fov.toml"), &quick()).unwrap();
    let light = vec![2000f32; 2048 * 1536];
    let exposure = Exposure::new(1e-3, 0);
    let mean = |dn: &[u16]| dn.iter().map(|&dn| f64::from(dn)).sum::<f64>() / dn.len() as f64;
    let (quiet, noisy) = (mean(&bench.sensor().noiseless(&light)), mean(&bench.read(&light, &exposure).dn));
    assert!((quiet - noisy).abs() < 0.6, "{quiet} {noisy}");
}

/// Points over the field, all in one image: where the table has their green light, and what a detector finds.
fn found(bench: &Bench, counts: [u8; 3]) -> Vec<([f64; 2], [f64; 2], f64)> {
    let exposure = Exposure::new(1e-2, 0);
    let mut screen = ScreenImage::dark(1920, 1200);
    let places: Vec<[u32; 2]> = (0..48).map(|i| [212 + i % 8 * 213, 70 + i / 8 * 211]).collect();
    places.iter().for_each(|&[x, y]| screen.set(x, y, counts));
    let mut light = vec![0f32; 2048 * 1536];
    bench.optics().add_points(&mut light, &bench.sources(&screen, &exposure).unwrap());
    let at = |[x, y]: [u32; 2]| {
        let expected = bench.land_px([f64::from(x) + 0.5, f64::from(y) + 0.5], 1, &exposure)?;
        let inside = expected[0] > 25.0 && expected[1] > 25.0 && expected[0] < 2023.0 && expected[1] < 1511.0;
        inside.then_some(expected)
    };
    places
        .into_iter()
        .filter_map(at)
        .map(|expected| {
            let (seen, sigma) = windowed(&light, 2048, expected);
            (expected, seen, sigma)
        })
        .collect()
}

/// Images between the kernels' nodes are blends, whose cores lie on one another: with nodes elsewhere spots are found at
/// the same places and equally wide, and about where the table of rays has them.
#[test]
fn spots_do_not_depend_on_where_the_nodes_are() {
    let setup = setup("wide-fov.toml");
    let with = |nodes: [usize; 2]| {
        let detail = OpticsDetail { nodes, lines: 1, ..OpticsDetail::default() };
        found(&Bench::new(&setup, &BenchOptions { detail, ..BenchOptions::default() }).unwrap(), [0, 255, 0])
    };
    let (one, other) = (with(OpticsDetail::default().nodes), with([25, 17]));
    let rms = |of: &dyn Fn(usize) -> f64| {
        ((0..one.len()).map(|i| of(i).powi(2)).sum::<f64>() / one.len() as f64).sqrt()
    };
    let apart = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]) / 2f64.sqrt();
    let places = rms(&|i| apart(one[i].1, other[i].1));
    let table = rms(&|i| apart(one[i].0, one[i].1));
    let widths = rms(&|i| (one[i].2 / other[i].2).ln());
    assert!(one.len() > 40 && places < 0.02 && widths < 0.04 && table < 0.08, "{places} {widths} {table}");
}

/// A display that is moved towards the lenses and away from them, photographed, against the table that the workbench has:
/// here wavefronts are tabulated over the display, cut to kernels and blended, and a detector finds the spots. The mean of
/// the light moves by up to 60 % more.
#[test]
fn depth_moves_spots_as_the_workbench_has_it() {
    let setup = setup("wide-fov.toml");
    let detail = OpticsDetail { lines: 1, ..OpticsDetail::default() };
    let at_depth = |focus_mm: f64| {
        let mut options = BenchOptions { detail, ..BenchOptions::default() };
        options.wrong.screen.focus_mm = focus_mm;
        found(&Bench::new(&setup, &options).unwrap(), [255; 3])
    };
    let pinhole = setup.camera_pinhole();
    let rays = crate::SpotTracer::new(&setup, 0.175, 0..3).unwrap().shifts(false).unwrap();
    let focused = at_depth(0.0);
    let tangent = |seen: [f64; 2]| pinhole.line_of_sight(glam::DVec2::from(seen)).length();
    for (depth_mm, limit) in [(-0.1, 0.04), (0.02, 0.06), (0.1, 0.06)] {
        let (mut off, mut all) = (0.0, 0.0);
        for (still, deep) in focused.iter().zip(&at_depth(depth_mm)) {
            let r = tangent(still.1);
            let measured = (tangent(deep.1) - r) / (r * depth_mm);
            let expected = rays.tangent_per_depth(r, depth_mm);
            off += (r * (measured - expected)).powi(2);
            all += (r * measured).powi(2);
        }
        let part = (off / all).sqrt();
        assert!(part < limit, "{depth_mm} mm: {part}");
    }
}

/// Points over the field, all in one image with hardly any noise, where our detector finds them.
fn detected(bench: &Bench, counts: [u8; 3]) -> Vec<glam::DVec2> {
    let exposure = Exposure::new(1e-2, 0);
    let mut screen = ScreenImage::dark(1920, 1200);
    let places: Vec<[u32; 2]> = (0..48).map(|i| [212 + i % 8 * 213, 70 + i / 8 * 211]).collect();
    places.iter().for_each(|&[x, y]| screen.set(x, y, counts));
    let light = bench.light_e(&screen, &exposure).unwrap();
    let peak = light.iter().copied().fold(0.0, f32::max);
    let mut image = retina_image::CameraImage::new(2048, 1536, 65_535.0);
    image.steps = retina_image::Steps::Fine;
    for (i, (value, light)) in image.values.iter_mut().zip(&light).enumerate() {
        *value = 100.0 + 50_000.0 * light / peak + crate::hash::normal(7, i as u64) as f32;
    }
    let options = retina_image::DetectOptions::default();
    let points = retina_image::detect_points(&image, &options).points;
    let nearest = |&[x, y]: &[u32; 2]| {
        let at = bench.land_px([f64::from(x) + 0.5, f64::from(y) + 0.5], 1, &exposure)?;
        let at = glam::DVec2::from(at);
        let found = points.iter().map(|point| glam::DVec2::new(point.x_px, point.y_px));
        found.min_by(|a, b| a.distance(at).total_cmp(&b.distance(at))).filter(|near| near.distance(at) < 6.0)
    };
    let seen: Vec<_> = places.iter().filter_map(nearest).collect();
    assert!(seen.len() > 40, "{} of {}", seen.len(), points.len());
    seen
}

/// Coma of the objective, photographed and found by our detector, against what the workbench traces for it. Coma turns the
/// bright cores inwards in the middle of the field and at its edge, and outwards between. In green light the facility is
/// alike all round; in white, where one coma is tried, the sub-pixels stand side by side.
#[test]
fn coma_moves_spots_as_the_workbench_has_it() {
    let setup = setup("wide-fov.toml");
    let pinhole = setup.camera_pinhole();
    let half_width = 0.5 * 2048.0 / pinhole.fx_px;
    let comas = [(3e-4, 0.15), (-5e-4, 0.3), (1e-4, 0.3), (1e-3, 0.15)];
    for (counts, lit, tried) in [([0, 255, 0], 1..2, &comas[..]), ([255; 3], 0..3, &comas[..1])] {
        let tracer = crate::SpotTracer::new(&setup, 0.175, lit).unwrap();
        let with_coma = |path_mm: f64| {
            let detail = OpticsDetail { lines: 1, ..OpticsDetail::default() };
            let mut options = BenchOptions { detail, ..BenchOptions::default() };
            options.wrong.objective.coma_mm = path_mm / half_width;
            detected(&Bench::new(&setup, &options).unwrap(), counts)
        };
        let without = with_coma(0.0);
        for &(path_mm, limit) in tried {
            let form = retina_geometry::ComaTracer::coma_form(&tracer, path_mm).unwrap();
            let (mut off, mut all) = (0.0, 0.0);
            for (without, with) in without.iter().zip(&with_coma(path_mm)) {
                let place = pinhole.line_of_sight(*without);
                let measured = pinhole.line_of_sight(*with) - place;
                let expected = form.moved(place, glam::DVec2::ZERO) * path_mm / half_width;
                off += measured.distance_squared(expected);
                all += measured.length_squared();
            }
            let part = (off / all).sqrt();
            println!("{counts:?} {path_mm} mm: {part:.3} of {:.3} px", (all / 48.0).sqrt() * pinhole.fx_px);
            assert!(part < limit, "{counts:?} {path_mm} mm: {part}");
        }
    }
}

/// A camera that points aside sees the same facility turned: in the tables, and in its photographs as far as the place
/// within a pixel moves what a detector finds.
#[test]
fn a_camera_that_points_aside_sees_the_same_turned() {
    let setup = setup("wide-fov.toml");
    let detail = OpticsDetail { lines: 1, ..OpticsDetail::default() };
    let pointing_rad = [0.1f64.to_radians(), 0.0];
    let mut options = BenchOptions { detail, ..BenchOptions::default() };
    let straight = found(&Bench::new(&setup, &options).unwrap(), [255; 3]);
    options.wrong.pointing_rad = pointing_rad;
    let bench = Bench::new(&setup, &options).unwrap();
    let aside = found(&bench, [255; 3]);
    let pinhole = setup.camera_pinhole();
    let turned = |px: [f64; 2]| {
        let tangents = pinhole.line_of_sight(glam::DVec2::from(px));
        bench.optics.camera().pixel(tangents.to_array())
    };
    let (mut table, mut photograph) = (0.0f64, 0.0f64);
    for (one, other) in straight.iter().zip(&aside) {
        let t = (turned(one.0) - glam::DVec2::from(other.0)).length();
        let p = (turned(one.1) - glam::DVec2::from(other.1)).length();
        table = table.max(t);
        photograph = photograph.max(p);
    }
    assert_eq!(straight.len(), aside.len());
    assert!(table < 5e-3 && photograph < 0.025, "{table} {photograph}");
}
