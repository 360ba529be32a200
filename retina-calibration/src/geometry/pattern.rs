//! Calibration patterns: screens with hundreds of single lit pixels, and their list of points.

use std::path::Path;

use glam::DVec2;
use rand::seq::SliceRandom as _;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use retina_files::{InputError, Table, hash_bytes, read_schema, read_text, write_atomic};
use retina_formats::{Channel, log10_irradiance, measured_or_power_law};
use retina_geometry::Setup;
use retina_radiometry::ScreenResponse;
use serde::Deserialize;

/// What a pattern is to be.
#[derive(Debug, Clone, PartialEq)]
pub struct PatternOptions {
    /// Points a screen.
    pub points: usize,
    /// Number of screens; six a group of counts where absent.
    pub screens: Option<usize>,
    /// Digital counts to show; every 0.75 mag from the display's largest down to 5 where empty.
    pub counts: Vec<u8>,
    /// Lit sub-pixels.
    pub channel: Channel,
    /// Seed of the random positions.
    pub seed: u64,
    /// The display's measured response; the setup's power law where absent.
    pub response: Option<ScreenResponse>,
}

impl Default for PatternOptions {
    fn default() -> Self {
        Self { points: 400, screens: None, counts: Vec::new(), channel: Channel::W, seed: 1, response: None }
    }
}

/// A lit pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PatternPoint {
    /// Column of the pixel.
    pub column: u32,
    /// Row of the pixel.
    pub row: u32,
    /// Its digital count.
    pub digital_count: u8,
}

impl PatternPoint {
    /// Centre of the pixel, px.
    pub fn screen_px(&self) -> DVec2 {
        DVec2::new(f64::from(self.column) + 0.5, f64::from(self.row) + 0.5)
    }
}

/// One screen of a pattern.
#[derive(Debug, Clone, PartialEq)]
pub struct PatternScreen {
    /// File name below `screens/`, `000.png`.
    pub file: String,
    /// Exposure time over that of the faintest group of counts.
    pub exposure_ratio: f64,
    /// Lit sub-pixels.
    pub channel: Channel,
    /// Its points.
    pub points: Vec<PatternPoint>,
}

/// A set of screens.
#[derive(Debug, Clone, PartialEq)]
pub struct Pattern {
    /// Name of the setup it was made for.
    pub setup: String,
    /// The screens.
    pub screens: Vec<PatternScreen>,
}

/// Brightest over faintest that one exposure holds, mag: a 12-bit camera with the brightest spot's peak at 3000 DN
/// shows one 3.5 mag fainter at 120 DN, well above its noise.
const EXPOSURE_HOLDS_MAG: f64 = 3.5;
/// Steps of the default counts, mag.
const STEP_MAG: f64 = 0.75;
/// Faintest default count: just above the declared faint limit (B = 4.4).
const FAINTEST_COUNT: u8 = 5;
/// Spots reach this far, camera px: closer than twice that, they merge.
const SPOT_RADIUS_PX: f64 = 10.0;

impl Pattern {
    /// Makes a pattern for a setup: points in the part of the screen that the camera sees, counts spread evenly over
    /// the distance from its centre.
    ///
    /// # Errors
    /// So many points that their spots would merge, or no counts.
    pub fn make(setup: &Setup, options: &PatternOptions) -> Result<Self, InputError> {
        let response = measured_or_power_law(options.response.as_ref(), setup);
        let magnitude = |count: u8| -2.5 * log10_irradiance(&response, Channel::W, f64::from(count));
        let most = setup.screen.limits.most_count;
        let groups = count_groups(&wanted_counts(options, most, magnitude), magnitude);
        let brightest =
            |group: &[u8]| group.iter().map(|&count| magnitude(count)).fold(f64::INFINITY, f64::min);
        let faintest_group = groups.iter().map(|group| brightest(group)).fold(0.0, f64::max);
        let mut random = ChaCha8Rng::seed_from_u64(options.seed);
        let count = options.screens.unwrap_or(6 * groups.len()).max(1);
        let mut screens = Vec::with_capacity(count);
        for index in 0..count {
            let group = &groups[index % groups.len()];
            let places = scatter(setup, options.points, &mut random)?;
            screens.push(PatternScreen {
                file: format!("{index:03}.png"),
                exposure_ratio: 10f64.powf(0.4 * (brightest(group) - faintest_group)),
                channel: options.channel,
                points: with_counts(setup, places, group, &mut random),
            });
        }
        Ok(Self { setup: setup.name.clone(), screens })
    }

    /// Lit share of each row of a screen, 0 to 1.
    pub fn row_load(&self, screen: usize, row: u32, width_px: u32) -> f64 {
        let lit = self.screens[screen].points.iter().filter(|point| point.row == row).count();
        lit as f64 / f64::from(width_px)
    }

    /// Writes `screens/NNN.png`, `pattern.csv` and `pattern.toml` into a folder.
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn write(&self, folder: &Path, setup: &Setup, seed: u64) -> Result<(), InputError> {
        let failed = |path: &Path, error: &dyn std::fmt::Display| {
            InputError::new(path, format!("cannot be written: {error}"))
        };
        let screens = folder.join("screens");
        std::fs::create_dir_all(&screens).map_err(|error| failed(&screens, &error))?;
        self.check_alone(&screens)?;
        for screen in &self.screens {
            let path = screens.join(&screen.file);
            let bytes = Self::png(screen, setup).map_err(|error| failed(&path, &error))?;
            write_atomic(&path, &bytes).map_err(|error| failed(&path, &error))?;
        }
        let mut text =
            String::from("screen,point,screen_x_px,screen_y_px,digital_count,channel,exposure_ratio\n");
        for screen in &self.screens {
            for (id, point) in screen.points.iter().enumerate() {
                let at = point.screen_px();
                text.push_str(&format!(
                    "{},{id},{},{},{},{},{:.6e}\n",
                    screen.file,
                    at.x,
                    at.y,
                    point.digital_count,
                    screen.channel.letter(),
                    screen.exposure_ratio
                ));
            }
        }
        let list = folder.join("pattern.csv");
        write_atomic(&list, text.as_bytes()).map_err(|error| failed(&list, &error))?;
        let head = format!(
            "schema = \"retina.pattern/1\"\nsetup = {}\nseed = {seed}\nscreens = {}\n# BLAKE3 of pattern.csv\nhash = \"{}\"\n",
            toml::Value::String(self.setup.clone()),
            self.screens.len(),
            hash_bytes(text.as_bytes())
        );
        let path = folder.join("pattern.toml");
        write_atomic(&path, head.as_bytes()).map_err(|error| failed(&path, &error))
    }

    /// Whoever shows all files of the folder shows this pattern and no other.
    fn check_alone(&self, screens: &Path) -> Result<(), InputError> {
        let entries = std::fs::read_dir(screens)
            .map_err(|error| InputError::new(screens, format!("cannot be read: {error}")))?;
        for entry in entries.flatten() {
            let name = entry.file_name().to_string_lossy().into_owned();
            if name.ends_with(".png") && !self.screens.iter().any(|screen| screen.file == name) {
                return Err(InputError::new(screens, "holds a screen of another pattern")
                    .found(format!("`{name}`"))
                    .expected(format!("no file, or a pattern of {} screens", self.screens.len()))
                    .help("name an empty folder, or remove the old pattern"));
            }
        }
        Ok(())
    }

    fn png(screen: &PatternScreen, setup: &Setup) -> Result<Vec<u8>, png::EncodingError> {
        let (width, height) = (setup.screen.width_px, setup.screen.height_px);
        let channels = if screen.channel == Channel::W { 1 } else { 3 };
        let mut counts = vec![0u8; width as usize * height as usize * channels];
        for point in &screen.points {
            let at = (point.row as usize * width as usize + point.column as usize) * channels;
            counts[at + if channels == 3 { screen.channel as usize } else { 0 }] = point.digital_count;
        }
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, width, height);
        encoder.set_color(if channels == 1 { png::ColorType::Grayscale } else { png::ColorType::Rgb });
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(&counts)?;
        writer.finish()?;
        Ok(bytes)
    }

    /// Reads a pattern's folder.
    ///
    /// # Errors
    /// A file is missing, changed since it was written, or belongs to another setup.
    pub fn read(folder: &Path, setup: &Setup) -> Result<Self, InputError> {
        #[derive(Deserialize)]
        struct Head {
            setup: String,
            hash: String,
        }
        let head_file = folder.join("pattern.toml");
        let head: Head = read_schema(&head_file, "retina.pattern/1", "a pattern")?;
        if head.setup != setup.name {
            return Err(InputError::new(&head_file, "the pattern belongs to another setup")
                .at("key `setup`")
                .found(format!("`{}`", head.setup))
                .expected(format!("`{}`", setup.name)));
        }
        let list = folder.join("pattern.csv");
        let text = read_text(&list)?;
        if hash_bytes(text.as_bytes()) != head.hash {
            return Err(InputError::new(&list, "was changed since the pattern was made")
                .expected(format!("BLAKE3 {}, as in pattern.toml", head.hash))
                .help("make the pattern again with the same seed, or bring back its pattern.csv"));
        }
        let table = Table::parse(&list, &text)?;
        table.require(&[
            "screen",
            "screen_x_px",
            "screen_y_px",
            "digital_count",
            "channel",
            "exposure_ratio",
        ])?;
        let mut pattern = Self { setup: head.setup, screens: Vec::new() };
        for row in 0..table.len() {
            let file = table.text(row, "screen");
            if pattern.screens.last().is_none_or(|screen| screen.file != file) {
                let exposure_ratio = table.number(row, "exposure_ratio")?;
                pattern.screens.push(PatternScreen {
                    file: file.to_owned(),
                    exposure_ratio,
                    channel: Channel::from_letter(table.text(row, "channel")).unwrap_or_default(),
                    points: Vec::new(),
                });
            }
            let point = PatternPoint {
                column: table.number(row, "screen_x_px")? as u32,
                row: table.number(row, "screen_y_px")? as u32,
                digital_count: table.number(row, "digital_count")? as u8,
            };
            if let Some(screen) = pattern.screens.last_mut() {
                screen.points.push(point);
            }
        }
        Ok(pattern)
    }
}

fn wanted_counts(options: &PatternOptions, most: u8, magnitude: impl Fn(u8) -> f64) -> Vec<u8> {
    let mut counts = options.counts.clone();
    if counts.is_empty() {
        let mut next = f64::NEG_INFINITY;
        for count in (FAINTEST_COUNT..=most).rev() {
            if magnitude(count) >= next - 1e-9 {
                counts.push(count);
                next = magnitude(count) + STEP_MAG;
            }
        }
    }
    counts.retain(|&count| count > 0);
    counts.sort_unstable_by(|a, b| b.cmp(a));
    counts.dedup();
    counts
}

/// Parts falling counts into groups that one exposure holds; neighbouring groups share a count, which ties their
/// exposures together.
fn count_groups(counts: &[u8], magnitude: impl Fn(u8) -> f64) -> Vec<Vec<u8>> {
    let mut groups: Vec<Vec<u8>> = Vec::new();
    for &count in counts {
        match groups.last_mut() {
            Some(group) if magnitude(count) - magnitude(group[0]) <= EXPOSURE_HOLDS_MAG => group.push(count),
            Some(group) => {
                let last = group[group.len() - 1];
                let next = if group.len() > 1 && magnitude(count) - magnitude(last) <= EXPOSURE_HOLDS_MAG {
                    vec![last, count]
                } else {
                    vec![count]
                };
                groups.push(next);
            }
            None => groups.push(vec![count]),
        }
    }
    groups
}

/// Places at random, none nearer to another than about 0.6 of their mean distance.
fn scatter(setup: &Setup, count: usize, random: &mut ChaCha8Rng) -> Result<Vec<[u32; 2]>, InputError> {
    let (facility, camera) = (setup.facility_pinhole(), setup.camera_pinhole());
    let corner = |x: f64, y: f64| facility.pixel(camera.line_of_sight(DVec2::new(x, y)));
    let size = DVec2::new(f64::from(facility.width_px), f64::from(facility.height_px));
    let low = corner(0.0, 0.0).max(DVec2::ZERO).ceil();
    let high = corner(f64::from(camera.width_px), f64::from(camera.height_px)).min(size).floor();
    let extent = high - low;
    let apart = 0.6 * (extent.x * extent.y / count.max(1) as f64).sqrt();
    let merging = 2.0 * SPOT_RADIUS_PX * facility.fx_px / camera.fx_px;
    if count == 0 || apart < merging {
        let most = (extent.x * extent.y * (0.6 / merging).powi(2)) as usize;
        return Err(InputError::new(&setup.file, "so many points cannot be told apart on one screen")
            .at("option --points")
            .found(count)
            .expected(format!("1 to {most}, so that spots of {SPOT_RADIUS_PX} camera pixels do not merge"))
            .help("show more screens instead"));
    }
    let mut places: Vec<[u32; 2]> = Vec::with_capacity(count);
    while places.len() < count {
        let at = low + extent * DVec2::new(random.random::<f64>(), random.random::<f64>());
        let far = |place: &[u32; 2]| {
            (DVec2::new(f64::from(place[0]) + 0.5, f64::from(place[1]) + 0.5) - at).length_squared()
                >= apart * apart
        };
        if places.iter().all(far) {
            places.push([at.x as u32, at.y as u32]);
        }
    }
    Ok(places)
}

/// Gives each place a count so that every distance from the centre has all of them alike: a light that moves its
/// spot outwards would otherwise look like distortion.
fn with_counts(
    setup: &Setup,
    mut places: Vec<[u32; 2]>,
    group: &[u8],
    random: &mut ChaCha8Rng,
) -> Vec<PatternPoint> {
    let centre = [i64::from(setup.screen.width_px) / 2, i64::from(setup.screen.height_px) / 2];
    places.sort_by_key(|place| (0..2).map(|k| (i64::from(place[k]) - centre[k]).pow(2)).sum::<i64>());
    let mut counts = Vec::with_capacity(places.len() + group.len());
    while counts.len() < places.len() {
        let mut block = group.to_vec();
        block.shuffle(random);
        counts.extend(block);
    }
    let mut points: Vec<PatternPoint> = places
        .iter()
        .zip(counts)
        .map(|(&[column, row], digital_count)| PatternPoint { column, row, digital_count })
        .collect();
    points.sort_by_key(|point| (point.row, point.column));
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wide() -> Setup {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/setups");
        Setup::read(&folder.join("wide-fov.toml")).unwrap()
    }

    #[test]
    fn counts_span_the_screens_range_in_exposures_that_hold_them() {
        let pattern = Pattern::make(&wide(), &PatternOptions::default()).unwrap();
        let magnitude = |count: u8| -5.5 * (f64::from(count) / 255.0).log10();
        let mut all = Vec::new();
        for screen in &pattern.screens {
            let of: Vec<f64> = screen.points.iter().map(|p| magnitude(p.digital_count)).collect();
            let (low, high) =
                (of.iter().copied().fold(f64::INFINITY, f64::min), of.iter().copied().fold(0.0, f64::max));
            assert!(high - low <= 3.5);
            // The exposure brings each screen's brightest to the same light.
            all.push((low, screen.exposure_ratio));
            assert_eq!(screen.points.len(), 400);
        }
        let light = |(low, ratio): &(f64, f64)| 10f64.powf(-0.4 * low) * ratio;
        assert!(all.iter().all(|of| (light(of) / light(&all[0]) - 1.0).abs() < 1e-9));
        let counts: std::collections::BTreeSet<u8> =
            pattern.screens.iter().flat_map(|s| s.points.iter().map(|p| p.digital_count)).collect();
        assert!(counts.contains(&255) && *counts.first().unwrap() <= 6 && counts.len() >= 11, "{counts:?}");
    }

    #[test]
    fn light_and_place_are_uncorrelated_and_spots_apart() {
        let pattern =
            Pattern::make(&wide(), &PatternOptions { seed: 7, ..PatternOptions::default() }).unwrap();
        let mut rows = Vec::new();
        for screen in &pattern.screens {
            for (i, a) in screen.points.iter().enumerate() {
                rows.push([
                    f64::from(a.digital_count).log10(),
                    (a.screen_px() - DVec2::new(960.0, 600.0)).length_squared(),
                ]);
                for b in &screen.points[..i] {
                    // 20 camera px of 28.4 arcsec over 36.4 arcsec.
                    assert!((a.screen_px() - b.screen_px()).length() > 15.6);
                }
            }
        }
        let n = rows.len() as f64;
        let mean = [0, 1].map(|k| rows.iter().map(|r| r[k]).sum::<f64>() / n);
        let product =
            |a: usize, b: usize| rows.iter().map(|r| (r[a] - mean[a]) * (r[b] - mean[b])).sum::<f64>();
        let correlation = product(0, 1) / (product(0, 0) * product(1, 1)).sqrt();
        assert!(correlation.abs() < 0.01, "{correlation}");
    }

    #[test]
    fn a_folder_reads_back_and_a_changed_one_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let setup = wide();
        let options = PatternOptions { points: 50, screens: Some(2), ..PatternOptions::default() };
        let pattern = Pattern::make(&setup, &options).unwrap();
        pattern.write(folder.path(), &setup, options.seed).unwrap();
        let back = Pattern::read(folder.path(), &setup).unwrap();
        assert_eq!(back.screens[1].points, pattern.screens[1].points);
        let list = folder.path().join("pattern.csv");
        let text = std::fs::read_to_string(&list).unwrap().replacen(",255,", ",254,", 1);
        std::fs::write(&list, text).unwrap();
        assert!(Pattern::read(folder.path(), &setup).unwrap_err().to_string().contains("changed since"));
        let many = PatternOptions { points: 9000, ..options };
        assert!(Pattern::make(&setup, &many).unwrap_err().to_string().contains("told apart"));
    }
}
