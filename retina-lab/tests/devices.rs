//! Screens and cameras that are other programs: commands and folders.
#![allow(clippy::unwrap_used, reason = "a test may fail")]

mod support;

use retina_bench::ScreenImage;
use retina_image::CameraImage;
use retina_lab::{
    BenchScreen, CameraSettings, CameraSpec, ScreenAddress, ScreenSpec, open_camera, open_screen, open_view,
};

use support::setup;

const SIZE: [u32; 2] = [4, 2];

fn lit() -> ScreenImage {
    let mut image = ScreenImage::dark(SIZE[0], SIZE[1]);
    image.set(1, 0, [10, 20, 30]);
    image
}

#[test]
fn a_folder_shows_what_was_written_last_and_is_dark_at_the_end() {
    let dir = tempfile::tempdir().unwrap();
    let (spec, none) = (ScreenSpec::Folder(dir.path().into()), BenchScreen::new(SIZE));
    let mut screen = open_screen(&spec, &setup(SIZE), None, &none).unwrap();
    let mut view = open_view(&ScreenAddress::Folder(dir.path().into()), SIZE).unwrap();
    screen.show(&lit()).unwrap();
    assert_eq!(*view.read().unwrap(), lit());
    let second = open_screen(&spec, &setup(SIZE), None, &none).err().unwrap().to_string();
    assert!(second.contains("another program"), "{second}");
    assert!(screen.show(&ScreenImage::dark(2, 2)).is_err());
    drop(screen);
    assert_eq!(*view.read().unwrap(), ScreenImage::dark(SIZE[0], SIZE[1]));
}

#[test]
fn a_command_shows_each_frame_and_another_takes_an_image() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).display().to_string();
    let show = format!("cp \"$RETINA_FRAME\" '{}'", at("shown.png"));
    let mut screen =
        open_screen(&ScreenSpec::Command(show), &setup(SIZE), None, &BenchScreen::new(SIZE)).unwrap();
    screen.show(&lit()).unwrap();
    let shown = retina_campaign::read_screen(&dir.path().join("shown.png")).unwrap();
    assert_eq!(shown, lit());

    let mut image = CameraImage::new(3, 2, 4095.0);
    image.values[2] = 1234.0;
    image.write_png(&dir.path().join("taken.png")).unwrap();
    let take = format!(
        "echo $RETINA_EXPOSURE_S $RETINA_GAIN_DB > '{}'; cp '{}' \"$RETINA_OUT.png\"",
        at("told"),
        at("taken.png")
    );
    let mut camera = open_camera(&CameraSpec::Command(take), 12, None).unwrap();
    camera.set(&CameraSettings { exposure_s: 0.25, gain_db: 6.0 }).unwrap();
    for _ in 0..2 {
        assert_eq!(camera.take().unwrap().image, image);
    }
    assert_eq!(std::fs::read_to_string(dir.path().join("told")).unwrap(), "0.25 6\n");
    let mut silent = open_camera(&CameraSpec::Command("true".into()), 12, None).unwrap();
    let error = silent.take().unwrap_err().to_string();
    assert!(error.contains("0 files") && error.contains("RETINA_OUT"), "{error}");
}

#[test]
fn a_folder_gives_the_next_image_and_none_that_was_there() {
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, value: f32| {
        let mut image = CameraImage::new(3, 2, 4095.0);
        image.values[0] = value;
        image.write_png(&dir.path().join(name)).unwrap();
    };
    write("old.png", 1.0);
    let mut camera = open_camera(&CameraSpec::Folder(dir.path().into()), 12, None).unwrap();
    camera.set(&CameraSettings { exposure_s: 0.1, gain_db: 0.0 }).unwrap();
    let taken = std::thread::scope(|scope| {
        scope.spawn(|| {
            std::thread::sleep(std::time::Duration::from_millis(300));
            write("new.png", 2.0);
        });
        camera.take().unwrap()
    });
    assert_eq!(taken.image.values[0], 2.0);
}
