//! Light finer than the screen's counts: several screens within one exposure, whose light adds up.
//!
//! A screen of 8 bits has steps of 0.9 % near its brightest count (gamma 2.2) and of half at its faintest. Shown for a
//! share s of the time in which light is shown, count c gives s r(c) of the full light, where r is the screen's response
//! over that of its largest count. For light L the first screen takes the largest count with s_1 r(c_1) <= L, each
//! further one the same of what is left, and the last one the nearest.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use retina_bench::ScreenImage;
use retina_files::{InputError, MOST_IMAGE_PIXELS, Table, decode_image, read_bytes, read_text, write_atomic};
use retina_formats::SetupStamp;
use retina_geometry::Setup;
use retina_radiometry::ScreenResponse;

use crate::LabError;
use crate::sequence::check_name;
use crate::show::png;

/// The table of a folder of split frames.
pub(crate) const SPLIT_FILE: &str = "split.csv";
/// Most screens of a frame.
const MOST_SCREENS: usize = 8;
/// Light below this is not told from darkness where errors are stated as parts.
const FAINT: f32 = 1e-5;

/// A screen of a frame, and its share of the time in which light is shown.
#[derive(Debug, Clone, PartialEq)]
pub struct FramePart {
    /// Its file.
    pub file: PathBuf,
    /// Its share.
    pub share: f64,
}

/// How well the screens of a frame add up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SplitError {
    /// Pixels brighter than the screen can be.
    pub clipped: usize,
    /// Largest error, as a part of the full light; clipped pixels count.
    pub largest: f32,
    /// Root mean square of the relative errors of pixels brighter than 1e-5 of full light.
    pub relative_rms: f32,
    /// The same with one screen alone.
    pub relative_rms_of_one: f32,
}

/// Refuses shares that do not fall, or are no parts of one whole.
///
/// # Errors
/// Says what they should be.
pub fn check_shares(shares: &[f64]) -> Result<(), InputError> {
    let sum: f64 = shares.iter().sum();
    let falls = shares.windows(2).all(|pair| pair[1] <= pair[0]);
    if (2..=MOST_SCREENS).contains(&shares.len())
        && falls
        && shares.iter().all(|share| *share > 0.0)
        && (sum - 1.0).abs() < 1e-6
    {
        return Ok(());
    }
    Err(InputError::new(Path::new("--shares"), "are no shares of the time")
        .found(shares.iter().map(f64::to_string).collect::<Vec<_>>().join(","))
        .expected(format!("2 to {MOST_SCREENS} numbers above 0 that fall and add up to 1, such as 0.9,0.1")))
}

/// The screens of a frame: `light` is row by row, as a part of the full light (count 255 all the time). Counts are
/// `most_count` at most; light beyond it is clipped. `response` is that of the screen.
pub fn split(
    light: &[f32],
    [width_px, height_px]: [u32; 2],
    response: &ScreenResponse,
    most_count: u8,
    shares: &[f64],
) -> (Vec<ScreenImage>, SplitError) {
    let full = response.brightest_w_m2_nm();
    let levels: Vec<f64> =
        (0..=most_count).map(|count| response.irradiance_w_m2_nm([count; 3]) / full).collect();
    let last = usize::from(most_count);
    let below = |wanted: f64| levels.partition_point(|level| *level <= wanted).saturating_sub(1);
    let nearest = |wanted: f64| {
        let low = below(wanted);
        let high = (low + 1).min(last);
        if wanted - levels[low] <= levels[high] - wanted { low } else { high }
    };
    let mut screens = vec![vec![0u8; light.len()]; shares.len()];
    let (mut largest, mut squares, mut squares_of_one, mut bright) = (0f32, 0f64, 0f64, 0usize);
    let mut clipped = 0;
    for (at, &wanted) in light.iter().enumerate() {
        let wanted = f64::from(wanted.max(0.0));
        clipped += usize::from(wanted > levels[last] * (1.0 + 1e-6));
        let mut left = wanted;
        for (k, share) in shares.iter().enumerate() {
            let count = if k + 1 < shares.len() { below(left / share) } else { nearest(left / share) };
            left -= share * levels[count];
            screens[k][at] = count as u8;
        }
        largest = largest.max(left.abs() as f32);
        if wanted > f64::from(FAINT) {
            squares += (left / wanted).powi(2);
            squares_of_one += ((levels[nearest(wanted)] - wanted) / wanted).powi(2);
            bright += 1;
        }
    }
    let rms = |squares: f64| if bright > 0 { (squares / bright as f64).sqrt() as f32 } else { 0.0 };
    let error =
        SplitError { clipped, largest, relative_rms: rms(squares), relative_rms_of_one: rms(squares_of_one) };
    (screens.iter().map(|counts| ScreenImage::grey(width_px, height_px, counts)).collect(), error)
}

/// A linear image of 16 bits, grey: its name as a frame, and its light as a part of `full` (65535 is the largest number).
///
/// # Errors
/// Its name cannot name a frame's images; it does not read, has 8 bits, colours, or another size than the screen.
pub fn read_light(path: &Path, size_px: [u32; 2], full: f64) -> Result<(String, Vec<f32>), InputError> {
    let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    check_name(&name, path)?;
    let formats = [image::ImageFormat::Png, image::ImageFormat::Tiff];
    let image = decode_image(path, "image", &read_bytes(path)?, &formats, MOST_IMAGE_PIXELS)?;
    let image::DynamicImage::ImageLuma16(grey) = image else {
        return Err(InputError::new(path, "is no linear image of 16 bits")
            .found(format!("{:?}", image.color()))
            .expected("grey samples of 16 bits, as `retina export --format png16` writes them")
            .help("an image of 8 bits can be shown as it is: `retina lab capture`"));
    };
    if [grey.width(), grey.height()] != size_px {
        return Err(InputError::new(path, "has another size than the setup's screen")
            .found(format!("{} x {} px", grey.width(), grey.height()))
            .expected(format!("{} x {} px", size_px[0], size_px[1]))
            .help("scale the image, or give the setup that it was made for"));
    }
    Ok((name, grey.as_raw().iter().map(|value| (f64::from(*value) / full) as f32).collect()))
}

/// Writes frames as screens: `screens/NAME-1.png` and so on, and `split.csv`.
pub struct SplitWriter {
    out: PathBuf,
    shares: Vec<f64>,
    table: String,
}

impl SplitWriter {
    /// Makes the folder.
    ///
    /// # Errors
    /// It is there already, or cannot be made.
    pub fn new(out: &Path, setup: &Setup, shares: &[f64]) -> Result<Self, InputError> {
        if out.exists() {
            return Err(InputError::new(out, "is there already").help("give --out another folder"));
        }
        let screens = out.join("screens");
        std::fs::create_dir_all(&screens)
            .map_err(|error| InputError::new(&screens, format!("the folder cannot be made: {error}")))?;
        Ok(Self {
            out: out.into(),
            shares: shares.to_vec(),
            table: SetupStamp::of(setup).line() + "frame,light,screen,share\n",
        })
    }

    /// Adds the screens of a frame whose linear image is `light`; the name is that of [`read_light`].
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn add(&mut self, name: &str, light: &Path, screens: &[ScreenImage]) -> Result<(), LabError> {
        let light = std::path::absolute(light).unwrap_or_else(|_| light.to_path_buf());
        for (number, (screen, share)) in screens.iter().zip(&self.shares).enumerate() {
            let file = format!("screens/{name}-{}.png", number + 1);
            let path = self.out.join(&file);
            write_atomic(&path, &png(screen)?)
                .map_err(|error| InputError::new(&path, format!("cannot be written: {error}")))?;
            let light = light.display().to_string().replace('"', "\"\"");
            let _ = writeln!(self.table, "{name},\"{light}\",{file},{share}");
        }
        Ok(())
    }

    /// Writes the table: the folder is a sequence then.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn finish(self) -> Result<PathBuf, InputError> {
        let path = self.out.join(SPLIT_FILE);
        write_atomic(&path, self.table.as_bytes())
            .map_err(|error| InputError::new(&path, format!("cannot be written: {error}")))?;
        Ok(path)
    }
}

/// The frames of a folder's `split.csv` in its order: name, linear image, screens.
///
/// # Errors
/// It does not read, is another setup's, or its shares do not fit.
pub(crate) fn read_split(
    folder: &Path,
    setup: &Setup,
) -> Result<Vec<(String, PathBuf, Vec<FramePart>)>, InputError> {
    let path = folder.join(SPLIT_FILE);
    let text = read_text(&path)?;
    if let Some(stamp) = SetupStamp::of_text(&path, &text)? {
        stamp.check(&path, setup)?;
    }
    let table = Table::parse(&path, &text)?;
    table.require(&["frame", "light", "screen", "share"])?;
    let mut frames: Vec<(String, PathBuf, Vec<FramePart>)> = Vec::new();
    for row in 0..table.len() {
        let name = table.text(row, "frame").to_owned();
        let part =
            FramePart { file: folder.join(table.text(row, "screen")), share: table.number(row, "share")? };
        match frames.last_mut() {
            Some((last, _, parts)) if *last == name => parts.push(part),
            _ => frames.push((name, table.text(row, "light").into(), vec![part])),
        }
    }
    if frames.is_empty() {
        return Err(InputError::new(&path, "has no frame"));
    }
    for (name, _, parts) in &frames {
        let shares: Vec<f64> = parts.iter().map(|part| part.share).collect();
        check_shares(&shares)
            .map_err(|error| InputError::new(&path, error.to_string()).at(format!("frame {name}")))?;
    }
    Ok(frames)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may fail")]

    use super::*;

    #[test]
    fn screens_add_up_to_the_light() {
        let response = ScreenResponse::power_law(2.2, 0.0);
        let light: Vec<f32> = (0..4096).map(|k| (k as f32 / 4095.0).powi(3)).collect();
        let level = |count: u8| (f64::from(count) / 255.0).powf(2.2);
        let mut last = f32::INFINITY;
        for shares in [&[0.9, 0.1][..], &[0.9, 0.09, 0.01]] {
            let (screens, error) = split(&light, [64, 64], &response, 255, shares);
            let off = light.iter().enumerate().map(|(at, wanted)| {
                let sum: f64 = screens
                    .iter()
                    .zip(shares)
                    .map(|(screen, share)| share * level(screen.counts[at][0]))
                    .sum();
                (sum - f64::from(*wanted)).abs()
            });
            let largest = off.fold(0.0, f64::max);
            assert!((largest - f64::from(error.largest)).abs() < 1e-6, "{largest} {error:?}");
            assert!(
                error.largest < last && error.relative_rms < 0.25 * error.relative_rms_of_one,
                "{error:?}"
            );
            last = error.largest;
        }
        // Near full light a single screen has steps of 0.9 %, and two a hundredth of that.
        assert!(last < 1e-4, "{last}");
        // More than full light is full light.
        let (screens, error) = split(&[2.0], [1, 1], &response, 255, &[0.5, 0.5]);
        assert_eq!(screens.iter().map(|screen| screen.counts[0][0]).collect::<Vec<_>>(), [255, 255]);
        assert_eq!((error.clipped, error.largest), (1, 1.0));
        let (screens, error) = split(&[0.5], [1, 1], &response, 100, &[0.9, 0.1]);
        assert!(screens.iter().all(|screen| screen.counts[0][0] == 100) && error.clipped == 1);
        for wrong in [&[1.0][..], &[0.1, 0.9], &[0.5, 0.4], &[1.1, -0.1], &[0.125; 9]] {
            assert!(check_shares(wrong).is_err(), "{wrong:?}");
        }
    }
}
