//! The window on a virtual X server, whose frame buffer file is compared to the pixel. Skipped where there is no Xvfb.
#![allow(clippy::unwrap_used, reason = "a test may fail")]

mod support;

use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use retina_bench::ScreenImage;
use retina_lab::{BenchScreen, ScreenAddress, ScreenSpec, find_screens, open_screen, open_view};
use support::setup;

struct Server {
    process: Child,
    display: String,
    folder: tempfile::TempDir,
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

fn server(size: &str) -> Option<Server> {
    let folder = tempfile::tempdir().unwrap();
    let number = 100 + std::process::id() % 400 + if size.starts_with("64") { 500 } else { 0 };
    let display = format!(":{number}");
    let process = Command::new("Xvfb")
        .args([&display, "-noreset", "-screen", "0", size, "-fbdir", folder.path().to_str().unwrap()])
        .stderr(Stdio::null())
        .spawn();
    let Ok(process) = process else {
        println!("skipped: there is no Xvfb");
        return None;
    };
    let server = Server { process, display, folder };
    let start = Instant::now();
    while find_screens(&server.display).is_err() {
        assert!(start.elapsed() < Duration::from_secs(20), "Xvfb does not start");
        std::thread::sleep(Duration::from_millis(50));
    }
    Some(server)
}

/// Red, green and blue of each pixel in a frame buffer file (XWD: big-endian words, then 4 bytes a pixel).
fn frame_buffer(folder: &Path, pixels: usize) -> Vec<[u8; 3]> {
    let bytes = std::fs::read(folder.join("Xvfb_screen0")).unwrap();
    let word = |at: usize| u32::from_be_bytes(bytes[4 * at..4 * at + 4].try_into().unwrap()) as usize;
    let (header, colours) = (word(0), word(19));
    let first = header + 12 * colours;
    bytes[first..first + 4 * pixels].chunks_exact(4).map(|pixel| [pixel[2], pixel[1], pixel[0]]).collect()
}

fn image(seed: u32) -> ScreenImage {
    let count =
        |i: u32, k: u32| ((i.wrapping_mul(2_654_435_761).wrapping_add(seed * 97 + k * 31)) >> 13) as u8;
    let counts = (0..1920 * 1200).map(|i| [count(i, 0), count(i, 1), count(i, 2)]).collect();
    ScreenImage { width_px: 1920, height_px: 1200, counts }
}

#[test]
fn a_frame_is_on_the_glass_to_the_pixel_and_black_stays_behind() {
    let Some(server) = server("1920x1200x24") else { return };
    let spec: ScreenSpec = format!("x11:{}", server.display).parse().unwrap();
    let none = BenchScreen::new([1920, 1200]);
    let mut screen = open_screen(&spec, &setup([1920, 1200]), None, &none).unwrap();
    let address: ScreenAddress = format!("x11:{}", server.display).parse().unwrap();
    let mut view = open_view(&address, [1920, 1200]).unwrap();
    for seed in 0..3 {
        let image = image(seed);
        screen.show(&image).unwrap();
        assert!(frame_buffer(server.folder.path(), 1920 * 1200) == image.counts, "other pixels are shown");
        assert!(view.read().unwrap().counts == image.counts, "other pixels are read");
    }
    let second = open_screen(&spec, &setup([1920, 1200]), None, &none).err().unwrap().to_string();
    assert!(second.contains("another program"), "{second}");
    drop(screen);
    let left: Vec<_> = frame_buffer(server.folder.path(), 1920 * 1200)
        .into_iter()
        .filter(|pixel| *pixel != [0; 3])
        .collect();
    assert!(left.is_empty(), "{} pixels are lit: {:?}", left.len(), left[0]);
    drop(open_screen(&spec, &setup([1920, 1200]), None, &none).unwrap());
}

#[test]
fn a_display_of_another_size_is_refused_with_its_outputs() {
    let Some(server) = server("640x480x24") else { return };
    let none = BenchScreen::new([1920, 1200]);
    for text in [format!("x11:{}", server.display), format!("x11:{}@screen", server.display)] {
        let error =
            open_screen(&text.parse().unwrap(), &setup([1920, 1200]), None, &none).err().unwrap().to_string();
        assert!(error.contains("640 x 480") && error.contains("1920 x 1200"), "{error}");
    }
    let missing = format!("x11:{}@DP-9", server.display).parse().unwrap();
    let error = open_screen(&missing, &setup([1920, 1200]), None, &none).err().unwrap().to_string();
    assert!(error.contains("no output DP-9"), "{error}");
}
