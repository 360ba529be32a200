//! `frames.csv` from the bench: screen images shown and photographed.

use std::collections::BTreeMap;
use std::fs::OpenOptions;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use retina_bench::{Bench, BenchError, Exposure, OpticsDetail, ScreenImage};
use retina_files::{
    InputError, MOST_IMAGE_PIXELS, decode_image, hash_bytes, hash_file, read_bytes, read_text, write_atomic,
};

use crate::points::{camera_image, make_folder};
use crate::{Facility, TemperatureProfile};

/// A campaign of frames.
#[derive(Debug, Clone, PartialEq)]
pub struct FramesOptions {
    /// Folder of screen images: `frames/NNNNNN.png` as `retina render` writes them, or PNG files themselves.
    pub screens: PathBuf,
    /// The place of each screen image in the sequence, which decides its time and its noise; `None`: they are the whole
    /// sequence.
    pub places: Option<Vec<usize>>,
    /// Exposure time, s; by default the brightest pixel of the first frame fills 60 % of the full well.
    pub exposure_s: Option<f64>,
    /// Between frames, s.
    pub interval_s: f64,
    /// The bench's temperature.
    pub temperature: TemperatureProfile,
    /// Detail of the optics.
    pub detail: OpticsDetail,
}

/// What a campaign gave.
#[derive(Debug, Clone, PartialEq)]
pub struct FramesResult {
    /// Frames photographed.
    pub frames: usize,
    /// Their exposure time, s.
    pub exposure_s: f64,
}

/// The exposure time at which the brightest pixel of a screen image fills 60 % of the full well, s; `None` where the image
/// is dark.
///
/// # Errors
/// The image has another size than the screen.
pub fn well_exposed_s(bench: &Bench, screen: &ScreenImage) -> Result<Option<f64>, BenchError> {
    let light = bench.light_e(screen, &Exposure::new(1.0, 0))?;
    let peak = f64::from(light.iter().copied().fold(0.0, f32::max));
    Ok((peak > 0.0).then(|| 0.6 * bench.sensor().full_well_e() / peak))
}

/// The screen images of a folder by name: PNG files in it, or in its `frames/`.
///
/// # Errors
/// It cannot be read, or holds none.
pub fn screens_of(folder: &Path) -> Result<Vec<PathBuf>, InputError> {
    let below = folder.join("frames");
    let folder = if below.is_dir() { below } else { folder.to_path_buf() };
    let entries = std::fs::read_dir(&folder)
        .map_err(|error| InputError::new(&folder, format!("cannot be read: {error}")))?;
    let mut files: Vec<PathBuf> = entries
        .filter_map(|entry| entry.ok().map(|entry| entry.path()))
        .filter(|path| path.extension().is_some_and(|extension| extension == "png"))
        .collect();
    files.sort();
    if files.is_empty() {
        return Err(InputError::new(&folder, "holds no screen images")
            .expected("PNG files, as `retina render` writes them"));
    }
    Ok(files)
}

/// A screen image from its PNG file: grey or colour, 8 bits.
///
/// # Errors
/// It does not read, or has more than 8 bits.
pub fn read_screen(path: &Path) -> Result<ScreenImage, InputError> {
    screen_of_png(path, &read_bytes(path)?)
}

/// A screen image from a PNG of 8 bits; `path` names it in errors.
///
/// # Errors
/// It is no PNG, or has other depths.
pub fn screen_of_png(path: &Path, bytes: &[u8]) -> Result<ScreenImage, InputError> {
    let formats = [image::ImageFormat::Png];
    let image = decode_image(path, "image", bytes, &formats, MOST_IMAGE_PIXELS)?;
    let deep = !matches!(
        image.color(),
        image::ColorType::L8 | image::ColorType::La8 | image::ColorType::Rgb8 | image::ColorType::Rgba8
    );
    if deep {
        return Err(InputError::new(path, "a screen image holds digital counts of 8 bits")
            .found(format!("{:?}", image.color())));
    }
    let rgb = image.to_rgb8();
    let (width_px, height_px) = rgb.dimensions();
    Ok(ScreenImage { width_px, height_px, counts: rgb.pixels().map(|pixel| pixel.0).collect() })
}

/// What an image of a screen is compared with: the linear EXR beside a rendered screen image where there is one, else the
/// screen image itself, by its absolute path.
pub fn predicted_by(screen: &Path) -> PathBuf {
    let radiance = screen.with_extension("exr");
    let predicted = if radiance.exists() { radiance } else { screen.to_path_buf() };
    std::path::absolute(&predicted).unwrap_or(predicted)
}

/// What decides an image besides its screen and its number: a folder of images is finished by the same only.
const MADE_FROM: &str = "images/made-from.txt";

/// A line a photograph: its hash and its name. What was damaged since is taken anew.
const HASHES: &str = "images/hashes.txt";

/// The hashes of a folder's photographs by name.
fn hashes(out: &Path) -> Result<BTreeMap<String, String>, InputError> {
    let path = out.join(HASHES);
    if !path.exists() {
        return Ok(BTreeMap::new());
    }
    let text = read_text(&path)?;
    // A last line that was cut short names no photograph.
    let whole = &text[..text.rfind('\n').map_or(0, |end| end + 1)];
    let pair = |line: &str| line.split_once(' ').map(|(hash, name)| (name.to_owned(), hash.to_owned()));
    Ok(whole.lines().filter_map(pair).collect())
}

fn add_hashes(out: &Path, text: &str) -> Result<(), InputError> {
    let path = out.join(HASHES);
    let file = OpenOptions::new().create(true).append(true).open(&path);
    file.and_then(|mut file| file.write_all(text.as_bytes()))
        .map_err(|error| InputError::new(&path, format!("cannot be written: {error}")))
}

/// Whether a photograph is there as it was taken.
fn is_whole(path: &Path, name: &str, hashes: &BTreeMap<String, String>) -> Result<bool, InputError> {
    match hashes.get(name) {
        Some(hash) if path.exists() => Ok(hash_file(path)? == *hash),
        _ => Ok(false),
    }
}

/// Photographs of a folder that are not as they were taken, by name.
///
/// # Errors
/// One cannot be read.
pub fn torn_frames(out: &Path) -> Result<Vec<String>, InputError> {
    let hashes = hashes(out)?;
    let mut torn = Vec::new();
    for name in hashes.keys() {
        if !is_whole(&out.join("images").join(name), name, &hashes)? {
            torn.push(name.clone());
        }
    }
    Ok(torn)
}

fn made_from(facility: &Facility, options: &FramesOptions, files: &[PathBuf]) -> Result<String, InputError> {
    // The screens are told by their content: their folder may be named otherwise next time.
    let own = FramesOptions { screens: PathBuf::new(), ..options.clone() };
    let mut text = format!("{facility:?}\n{own:?}\n");
    for file in files {
        text.push_str(&hash_file(file)?);
    }
    Ok(format!("{}\n", hash_bytes(text.as_bytes())))
}

/// Takes over the photographs of a campaign's parts, each with its options and its folder, before [`simulate_frames`] takes
/// those that are missing: their files are linked where the file system allows it, and copied elsewhere. Gives the
/// folders that are not taken over, or not whole: they are not there, or are of something else than their options say.
///
/// # Errors
/// A file that cannot be read or written.
pub fn adopt_frames(
    facility: &Facility,
    options: &FramesOptions,
    parts: &[(FramesOptions, PathBuf)],
    out: &Path,
) -> Result<Vec<PathBuf>, InputError> {
    let (images, mark) = (out.join("images"), out.join(MADE_FROM));
    if !mark.exists() && screens_of(&images).is_ok() {
        // Photographs of unknown origin: `simulate_frames` refuses them.
        return Ok(Vec::new());
    }
    let cannot = |path: &Path, error: &dyn std::fmt::Display| {
        InputError::new(path, format!("cannot be written: {error}"))
    };
    let mut left = Vec::new();
    for (part, folder) in parts {
        let theirs = folder.join(MADE_FROM);
        let own = match screens_of(&part.screens) {
            Ok(files) if theirs.exists() => read_text(&theirs)? == made_from(facility, part, &files)?,
            _ => false,
        };
        if !own {
            left.push(folder.clone());
            continue;
        }
        if !mark.exists() {
            make_folder(&images)?;
            let whole = made_from(facility, options, &screens_of(&options.screens)?)?;
            write_atomic(&mark, whole.as_bytes()).map_err(|error| cannot(&mark, &error))?;
        }
        let (theirs, ours) = (hashes(folder)?, hashes(out)?);
        let (mut all, mut lines) = (true, String::new());
        for screen in screens_of(&part.screens)? {
            let name = screen.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let (from, to) = (folder.join("images").join(&name), images.join(&name));
            if is_whole(&to, &name, &ours)? {
                continue;
            }
            let Some(hash) = theirs.get(&name).filter(|_| from.exists()) else {
                all = false;
                continue;
            };
            if !is_whole(&from, &name, &theirs)? {
                return Err(InputError::new(&from, "is not the photograph that was taken")
                    .expected(format!("hash {} ({HASHES})", &hash[..12.min(hash.len())]))
                    .help("run the shard that made it again: it takes the photograph anew"));
            }
            if to.exists() {
                std::fs::remove_file(&to).map_err(|error| cannot(&to, &error))?;
            }
            if std::fs::hard_link(&from, &to).is_err() {
                write_atomic(&to, &read_bytes(&from)?).map_err(|error| cannot(&to, &error))?;
            }
            lines += &format!("{hash} {name}\n");
        }
        add_hashes(out, &lines)?;
        if !all {
            left.push(folder.clone());
        }
    }
    Ok(left)
}

/// Photographs each screen image: `out/images/NAME.png` and `out/frames.csv`, which names the linear EXR
/// beside a rendered screen image where there is one. Images that an interrupted run of the same left are kept.
///
/// # Errors
/// A file that does not fit or cannot be written; the bench cannot be built; the folder holds images that were made
/// from something else.
pub fn simulate_frames(
    facility: &Facility,
    options: &FramesOptions,
    out: &Path,
    progress: impl Fn(usize, usize),
) -> Result<FramesResult, BenchError> {
    photograph(facility, None, options, out, progress)
}

/// As [`simulate_frames`], on the facility's bench where that is built already, in the options' detail.
///
/// # Errors
/// As there.
pub fn photograph_frames(
    facility: &Facility,
    bench: &Bench,
    options: &FramesOptions,
    out: &Path,
    progress: impl Fn(usize, usize),
) -> Result<FramesResult, BenchError> {
    photograph(facility, Some(bench), options, out, progress)
}

fn photograph(
    facility: &Facility,
    bench: Option<&Bench>,
    options: &FramesOptions,
    out: &Path,
    progress: impl Fn(usize, usize),
) -> Result<FramesResult, BenchError> {
    let files = screens_of(&options.screens)?;
    let images = out.join("images");
    make_folder(&images)?;
    let (mark, own) = (out.join(MADE_FROM), made_from(facility, options, &files)?);
    let others = if mark.exists() { read_text(&mark)? != own } else { screens_of(&images).is_ok() };
    if others {
        return Err(InputError::new(&images, "holds images that were made from something else")
            .help("give --out another folder, or empty this one")
            .into());
    }
    write_atomic(&mark, own.as_bytes())
        .map_err(|error| InputError::new(&mark, format!("cannot be written: {error}")))?;
    let built;
    let bench = match bench {
        Some(bench) => bench,
        None => {
            built = facility.bench(options.detail)?;
            &built
        }
    };
    let exposure_s = match options.exposure_s {
        Some(exposure_s) => exposure_s,
        None => well_exposed_s(bench, &read_screen(&files[0])?)?.ok_or_else(|| {
            InputError::new(&files[0], "the first screen image is dark").help("give the exposure time")
        })?,
    };
    let mut list = String::from("predicted,measured,time_s,temperature_c,exposure_s\n");
    let taken = hashes(out)?;
    if let Some(places) = options.places.as_ref().filter(|places| places.len() != files.len()) {
        return Err(InputError::new(
            &options.screens,
            "the screens are not those of this part of the sequence",
        )
        .found(format!("{} screen images", files.len()))
        .expected(places.len())
        .into());
    }
    for (number, file) in files.iter().enumerate() {
        let index = options.places.as_ref().map_or(number, |places| places[number]);
        let time_s = index as f64 * options.interval_s;
        let temperature_c = options.temperature.at_c(time_s);
        let pose = facility.dynamics.pose(
            bench.camera().pinhole.fx_px,
            facility.wrong.camera_roll_rad,
            time_s,
            temperature_c,
            facility.seed,
            index as u64,
        );
        let exposure = Exposure { exposure_s, temperature_c, pose, frame: index as u64 };
        let name = file.file_name().unwrap_or_default();
        let target = images.join(name);
        if !is_whole(&target, &name.to_string_lossy(), &taken)? {
            let frame = bench.expose(&read_screen(file)?, &exposure)?;
            camera_image(bench, frame).write_png(&target)?;
            add_hashes(out, &format!("{} {}\n", hash_file(&target)?, name.to_string_lossy()))?;
        }
        list.push_str(&format!(
            "{},images/{},{time_s},{temperature_c},{exposure_s}\n",
            predicted_by(file).display(),
            name.to_string_lossy()
        ));
        progress(number + 1, files.len());
    }
    let path = out.join("frames.csv");
    write_atomic(&path, list.as_bytes())
        .map_err(|error| InputError::new(&path, format!("cannot be written: {error}")))?;
    Ok(FramesResult { frames: files.len(), exposure_s })
}
