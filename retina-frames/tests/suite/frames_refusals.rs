//! Tables of frames that do not fit, by their messages.

use crate::common::{BALL, Case, PLAIN};

fn refusal(change: impl Fn(&Case)) -> String {
    let case = Case::new(&[(BALL, PLAIN)], 1);
    change(&case);
    let error = case.read(true).err().unwrap();
    format!("{error} | {:?} | {:?} | {:?}", error.found, error.expected, error.help)
}

fn table(text: &'static str) -> impl Fn(&Case) {
    move |case| std::fs::write(case.path("frames.csv"), text).unwrap()
}

#[test]
fn what_is_wrong_is_said() {
    for (text, words) in [
        ("measured\n0.png\n", "scene"),
        ("predicted,measured\n0.exr,\n", "the image is not named"),
        ("predicted,measured\n,0.png\n", "nothing is predicted"),
        ("predicted,measured\n", "has no rows"),
        ("predicted,scene,frame,measured\n0.exr,s.toml,0,0.png\n", "given twice"),
        ("scene,frame,measured\ns.toml,1.5,0.png\n", "no number of a frame"),
        ("scene,frame,start,measured\ns.toml,0,flat,0.png\n", "is no start"),
        ("predicted,measured,exposure_s\n0.exr,0.png,-1\n", "no exposure time"),
        ("predicted,measured\nmissing.exr,0.png\n", "missing.exr"),
        ("predicted,measured\n0.exr,0.exr\n", "is not a camera image"),
        ("predicted,measured\n0.png,0.png\n", "is no linear EXR"),
        ("predicted,start,measured\n0.exr,smooth,0.png\n", "belongs to a scene"),
        ("predicted,measured\n0.exr,0.png\n0.exr,0.png\n", "the image is there twice"),
    ] {
        let said = refusal(table(text));
        assert!(said.contains(words), "{text}: {said}");
    }
}

#[test]
fn an_image_of_another_size_is_refused() {
    let said = refusal(|case| {
        retina_image::CameraImage::new(64, 64, 4095.0).write_png(&case.path("0.png")).unwrap();
    });
    assert!(said.contains("the image is not the camera's") && said.contains("128 x 96"), "{said}");
    let said = refusal(|case| {
        retina_image::CameraImage::new(64, 64, 4095.0).write_png(&case.path("m.png")).unwrap();
        std::fs::write(case.path("frames.csv"), "predicted,measured,mask\n0.exr,0.png,m.png\n").unwrap();
    });
    assert!(said.contains("the mask is not the camera's"), "{said}");
}

#[test]
fn a_dark_image_is_refused() {
    let said = refusal(|case| {
        retina_image::CameraImage::new(128, 96, 4095.0).write_png(&case.path("0.png")).unwrap();
    });
    assert!(said.contains("no light"), "{said}");
}

#[test]
fn an_effect_that_cannot_be_shown_says_what_would_show_it() {
    let mut set = Case::new(&[(BALL, PLAIN)], 1).read(true).unwrap();
    let error = set.add("albedo_map").unwrap_err();
    assert!(format!("{:?}", error.found).contains("scene"), "{error:?}");
    let error = set.add("image_shift").unwrap_err();
    assert!(format!("{:?}", error.found).contains("--baseline gain"), "{error:?}");
}

/// A picture of the test's image, coded as sRGB, its full scale that of the file.
fn coded(case: &Case) -> image::GrayImage {
    let grey = image::open(case.path("0.png")).unwrap().into_luma16();
    let most = f64::from(grey.pixels().map(|p| p.0[0]).max().unwrap());
    image::GrayImage::from_fn(grey.width(), grey.height(), |x, y| {
        let light = (0.9 * f64::from(grey.get_pixel(x, y).0[0]) / most).max(0.0032);
        image::Luma([(255.0 * (1.055 * light.powf(1.0 / 2.4) - 0.055)).round() as u8])
    })
}

#[test]
fn a_photograph_says_what_its_pixels_share_and_how_it_was_read() {
    let case = Case::new(&[(BALL, PLAIN)], 1);
    let shared = |case: &Case| {
        let data = case.read(true).unwrap().dataset(false).unwrap();
        data.notes.join("\n")
    };
    assert!(!shared(&case).contains("share noise"));
    let picture = coded(&case);
    let of = |name: &str| {
        std::fs::write(case.path("frames.csv"), format!("predicted,measured\n0.exr,{name}\n")).unwrap();
        shared(&case)
    };
    let mut bytes = Vec::new();
    image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 95).encode_image(&picture).unwrap();
    // A directory of EXIF with an exposure time of 1/4 s.
    let directories = b"II*\0\x08\0\0\0\x01\0\x69\x87\x04\0\x01\0\0\0\x1a\0\0\0\0\0\0\0\
        \x01\0\x9a\x82\x05\0\x01\0\0\0\x2c\0\0\0\0\0\0\0\x01\0\0\0\x04\0\0\0";
    let length = (directories.len() + 8) as u16;
    bytes.splice(2..2, [&b"\xff\xe1"[..], &length.to_be_bytes(), b"Exif\0\0", directories].concat());
    std::fs::write(case.path("0.jpg"), bytes).unwrap();
    let notes = of("0.jpg");
    assert!(notes.contains("0.jpg: a grey JPEG: linearised"), "{notes}");
    assert!(notes.contains("pixels within 8 px of each other share noise"), "{notes}");
    assert!(notes.contains("exposure times are those of the images' EXIF"), "{notes}");
    image::DynamicImage::from(picture).into_rgb8().save(case.path("rgb.png")).unwrap();
    let notes = of("rgb.png");
    assert!(notes.contains("pixels within 2 px of each other share noise"), "{notes}");
    assert!(!notes.contains("EXIF"), "{notes}");
}
