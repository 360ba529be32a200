//! Pictures of ordinary cameras as light.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

use std::path::PathBuf;

use image::codecs::jpeg::JpegEncoder;
use retina_image::{CameraImage, Coding, Photograph, PhotographOptions, ReadOptions};

/// EXIF of one page: entries of the first directory (orientation) and of the EXIF one; values behind them.
fn exif(orientation: u8) -> Vec<u8> {
    let mut tiff = b"II*\0\x08\0\0\0\x02\0".to_vec();
    let entry = |tag: u16, kind: u16, count: u32, value: u32| {
        let mut bytes = [tag.to_le_bytes(), kind.to_le_bytes()].concat();
        bytes.extend(count.to_le_bytes());
        bytes.extend(value.to_le_bytes());
        bytes
    };
    tiff.extend(entry(0x0112, 3, 1, u32::from(orientation)));
    tiff.extend(entry(0x8769, 4, 1, 38));
    tiff.extend([0; 4]);
    let values = 38 + 2 + 5 * 12 + 4;
    tiff.extend([5, 0]);
    tiff.extend(entry(0x829a, 5, 1, values));
    tiff.extend(entry(0x9003, 2, 20, values + 16));
    tiff.extend(entry(0x9011, 2, 7, values + 36));
    tiff.extend(entry(0x920a, 5, 1, values + 8));
    tiff.extend(entry(0xa405, 3, 1, 75));
    tiff.extend([0; 4]);
    tiff.extend([1u32, 250, 500, 10].iter().flat_map(|v| v.to_le_bytes()));
    tiff.extend(b"2023:12:22 19:21:25\0+01:00\0");
    tiff
}

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn file(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    }

    /// A grey JPEG of 16 x 8 pixels, its left half at 200, its right half at 40.
    fn jpeg(&self, tiff: Option<&[u8]>) -> PathBuf {
        let picture = image::GrayImage::from_fn(16, 8, |x, _| image::Luma([if x < 8 { 200 } else { 40 }]));
        let mut bytes = Vec::new();
        JpegEncoder::new_with_quality(&mut bytes, 100).encode_image(&picture).unwrap();
        if let Some(tiff) = tiff {
            let length = (tiff.len() + 8) as u16;
            let segment = [&b"\xff\xe1"[..], &length.to_be_bytes(), b"Exif\0\0", tiff].concat();
            bytes.splice(2..2, segment);
        }
        self.file("a.jpg", &bytes)
    }

    fn png(&self, picture: impl Into<image::DynamicImage>) -> PathBuf {
        let path = self.0.path().join("a.png");
        picture.into().save(&path).unwrap();
        path
    }
}

fn upright() -> PhotographOptions {
    PhotographOptions { upright: true, ..PhotographOptions::default() }
}

#[test]
fn a_jpeg_is_linearised_and_its_exif_told() {
    let folder = Folder::new();
    let read = Photograph::read(&folder.jpeg(Some(&exif(1))), upright()).unwrap();
    assert!(read.lossy && read.linearised && !read.colour && !read.turned);
    // 255 ((200 / 255 + 0.055) / 1.055)^2.4 = 147.19, and 5.41 of 40; a JPEG rounds by 1.
    assert!((read.image.at(0, 4) - 147.2).abs() < 2.0, "{}", read.image.at(0, 4));
    assert!((read.image.at(15, 4) - 5.4).abs() < 0.4, "{}", read.image.at(15, 4));
    assert_eq!(read.image.full_scale_dn, 255.0);
    assert_eq!(
        (read.exif.exposure_s, read.exif.focal_mm, read.exif.focal_35mm_mm),
        (Some(0.004), Some(50.0), Some(75.0))
    );
    // The diagonal of 3 x 4 thousand pixels is 5000.
    assert!((read.exif.focal_px([4000, 3000]).unwrap() - 75.0 / 43.2666 * 5000.0).abs() < 1e-9);
    let notes = read.notes().join("\n");
    assert!(notes.contains("a grey JPEG: linearised by the sRGB curve to 0..255"), "{notes}");
    assert!(notes.contains("exposure 0.004000 s, focal length 50 mm, 75 mm in the 35-mm format"), "{notes}");
    assert!(notes.contains("EXIF time: 2023-12-22T19:21:25+01:00"), "{notes}");
}

#[test]
fn damaged_exif_is_none_and_a_time_without_offset_is_said_to_be_local() {
    let folder = Folder::new();
    let mut tiff = exif(1);
    let at = tiff.windows(6).position(|w| w == b"+01:00").unwrap();
    tiff[at..at + 6].copy_from_slice(b"+99:00");
    let notes = Photograph::read(&folder.jpeg(Some(&tiff)), upright()).unwrap().notes().join("\n");
    assert!(notes.contains("by the camera's clock, without its offset from UTC; it is not used"), "{notes}");
    let at = tiff.windows(4).position(|w| w == b"2023").unwrap();
    tiff[at..at + 4].copy_from_slice(b"0000");
    assert_eq!(Photograph::read(&folder.jpeg(Some(&tiff)), upright()).unwrap().exif.local_time, None);
    for cut in [0, 9, 20, 60] {
        let read = Photograph::read(&folder.jpeg(Some(&tiff[..cut])), upright()).unwrap();
        assert_eq!(read.exif.focal_35mm_mm, None, "{cut}");
    }
}

#[test]
fn an_orientation_is_applied_where_that_is_asked_for() {
    let folder = Folder::new();
    let path = folder.jpeg(Some(&exif(6)));
    let turned = Photograph::read(&path, upright()).unwrap();
    // Clockwise: the bright left half is at the top.
    assert_eq!([turned.image.width_px, turned.image.height_px], [8, 16]);
    assert!(turned.image.at(4, 0) > 100.0 && turned.image.at(4, 15) < 10.0);
    assert!(turned.notes().join("\n").contains("turned by its EXIF orientation (6)"));
    let straight = Photograph::read(&path, PhotographOptions::default()).unwrap();
    assert_eq!([straight.image.width_px, straight.image.height_px], [16, 8]);
    assert!(straight.notes().join("\n").contains("EXIF orientation (6) is not applied"));
}

#[test]
fn colour_of_8_bits_is_decoded_and_mixed_and_its_alpha_ignored() {
    let folder = Folder::new();
    let path = folder.png(image::RgbaImage::from_pixel(4, 4, image::Rgba([200, 40, 0, 7])));
    let read = Photograph::read(&path, PhotographOptions::default()).unwrap();
    assert!(read.colour && read.alpha && read.linearised && !read.lossy);
    // 0.2126 * 147.19 + 0.7152 * 5.41.
    assert!((read.image.at(1, 1) - 35.15).abs() < 0.1, "{}", read.image.at(1, 1));
    let notes = read.notes().join("\n");
    assert!(notes.contains("its luminance is taken") && notes.contains("(alpha) is ignored"), "{notes}");
    let linear = PhotographOptions { coding: Coding::Linear, ..PhotographOptions::default() };
    let read = Photograph::read(&path, linear).unwrap();
    assert!((read.image.at(1, 1) - (0.2126 * 200.0 + 0.7152 * 40.0)).abs() < 1e-3);
    assert!(read.notes().join("\n").contains("taken as linear"));
    // A channel that is full has lost what was above: so has the pixel.
    let path = folder.png(image::RgbImage::from_pixel(4, 4, image::Rgb([255, 40, 0])));
    assert_eq!(Photograph::read(&path, PhotographOptions::default()).unwrap().image.at(1, 1), 255.0);
}

#[test]
fn raw_counts_stay_as_they_are() {
    let folder = Folder::new();
    let path = folder.png(image::GrayImage::from_pixel(4, 4, image::Luma([40])));
    let read = Photograph::read(&path, PhotographOptions::default()).unwrap();
    assert_eq!(read.image, CameraImage::read(&path, ReadOptions::default()).unwrap());
    assert!(read.image.at(0, 0) == 40.0 && read.notes().is_empty());
    let srgb = PhotographOptions { coding: Coding::Srgb, ..PhotographOptions::default() };
    assert!((Photograph::read(&path, srgb).unwrap().image.at(0, 0) - 5.41).abs() < 0.05);
    let deep = image::ImageBuffer::from_pixel(4, 4, image::Rgb([40_000u16, 20_000, 10_000]));
    let read = Photograph::read(&folder.png(deep), PhotographOptions::default()).unwrap();
    assert!((read.image.at(0, 0) - (8504.0 + 14_304.0 + 722.0)).abs() < 0.1 && !read.linearised);
}

#[test]
fn where_counts_matter_jpeg_and_colour_are_refused_with_the_reason() {
    let folder = Folder::new();
    let said = CameraImage::read(&folder.jpeg(None), ReadOptions::default()).unwrap_err();
    assert!(said.to_string().contains("a.jpg: is a JPEG, which has lost the camera's counts"), "{said}");
    assert!(said.help.unwrap().contains("save raw counts"));
    let said =
        CameraImage::read(&folder.png(image::RgbImage::new(4, 4)), ReadOptions::default()).unwrap_err();
    assert!(said.to_string().contains("a.png: is a colour image"), "{said}");
    let said = Photograph::read(&folder.file("a.rw2", b"IIU\0"), upright()).unwrap_err();
    assert!(said.to_string().contains("a.rw2: is camera raw data"), "{said}");
}
