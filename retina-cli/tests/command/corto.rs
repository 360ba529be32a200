//! `retina render --corto` and `retina serve` on the example scenario, against an independent
//! projection and shading of its own files.

use std::fs;
use std::io::{BufRead as _, BufReader, Read as _};
use std::net::{TcpStream, UdpSocket};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use crate::common::{self, Fixture, assert_done, json, retina, stderr};
use exr::prelude::*;
use serde_json::Value;

const WIDTH: usize = 320;
const HEIGHT: usize = 240;
/// `fov`: 160 px are half of the larger side; tan(6 deg) = 0.10510424.
const FOCAL_PX: f64 = 160.0 / 0.105_104_24;
/// `energy`, `film_exposure` and the sidecar's albedo.
const ENERGY: f64 = 8.0;
const ALBEDO: f64 = 0.25;

fn scenario() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/corto/eros")
}

fn render(out: &Path, more: &[&str]) -> Output {
    let mut command = retina();
    command.arg("render").arg("--corto").arg(scenario()).arg("--out").arg(out);
    command.args(["--backend", "cpu", "--quality", "draft"]).args(more).output().unwrap()
}

/// One frame of geometry.json as CORTO hands it to Blender.
struct Frame {
    sun: [f64; 3],
    camera: ([f64; 3], [f64; 4]),
    body: ([f64; 3], [f64; 4]),
}

fn frame(index: usize) -> Frame {
    let text = fs::read_to_string(scenario().join("geometry/geometry.json")).unwrap();
    let document: Value = serde_json::from_str(&text).unwrap();
    let list = |object: &str, key: &str| -> Vec<f64> {
        let entry = &document[object][key][index];
        entry.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
    };
    let pose = |object: &str| {
        (list(object, "position").try_into().unwrap(), list(object, "orientation").try_into().unwrap())
    };
    Frame { sun: list("sun", "position").try_into().unwrap(), camera: pose("camera"), body: pose("body") }
}

/// Rotation matrix of a unit quaternion (w, x, y, z), written out (Diebel 2006, eq. 125, transposed:
/// from the object to the world).
fn matrix([w, x, y, z]: [f64; 4]) -> [[f64; 3]; 3] {
    [
        [1. - 2. * (y * y + z * z), 2. * (x * y - w * z), 2. * (x * z + w * y)],
        [2. * (x * y + w * z), 1. - 2. * (x * x + z * z), 2. * (y * z - w * x)],
        [2. * (x * z - w * y), 2. * (y * z + w * x), 1. - 2. * (x * x + y * y)],
    ]
}

impl Frame {
    /// Pixel and depth of a point of the file: Blender's camera looks along -z with y up, rows count
    /// downwards.
    fn project(&self, file: [f64; 3]) -> ([f64; 2], f64) {
        let (turn, camera) = (matrix(self.body.1), matrix(self.camera.1));
        let mut world = [0.0; 3];
        for k in 0..3 {
            world[k] =
                (0..3).map(|j| turn[k][j] * file[j] * 0.1).sum::<f64>() + self.body.0[k] - self.camera.0[k];
        }
        let local: Vec<f64> = (0..3).map(|k| (0..3).map(|j| camera[j][k] * world[j]).sum()).collect();
        let depth = -local[2];
        ([160.0 + FOCAL_PX * local[0] / depth, 120.0 - FOCAL_PX * local[1] / depth], depth)
    }
}

fn vertices() -> Vec<[f64; 3]> {
    let text = fs::read_to_string(scenario().join("body/shape/eros.obj")).unwrap();
    text.lines()
        .filter_map(|line| line.strip_prefix("v "))
        .map(|line| line.split(' ').map(|w| w.parse().unwrap()).collect::<Vec<f64>>().try_into().unwrap())
        .collect()
}

fn channels(path: &Path) -> Vec<(String, Vec<f32>)> {
    let image = read_all_flat_layers_from_file(path).unwrap();
    let layer = &image.layer_data[0];
    layer
        .channel_data
        .list
        .iter()
        .map(|c| (c.name.to_string(), c.sample_data.values_as_f32().collect()))
        .collect()
}

fn grey(path: &Path) -> Vec<u8> {
    let image = image::open(path).unwrap().into_luma8();
    assert_eq!(image.dimensions(), (WIDTH as u32, HEIGHT as u32));
    image.into_raw()
}

/// Left, top, right and bottom of what is set, as edges of pixels.
fn bounds(mask: &[u8]) -> [f64; 4] {
    let set = (0..mask.len()).filter(|&i| mask[i] > 0).map(|i| (i % WIDTH, i / WIDTH));
    set.fold([f64::MAX, f64::MAX, 0.0, 0.0], |[l, t, r, b], (x, y)| {
        let (x, y) = (x as f64, y as f64);
        [l.min(x), t.min(y), r.max(x + 1.0), b.max(y + 1.0)]
    })
}

/// sRGB encoding, IEC 61966-2-1.
fn srgb(value: f64) -> f64 {
    if value <= 0.003_130_8 { 12.92 * value } else { 1.055 * value.powf(1.0 / 2.4) - 0.055 }
}

#[test]
fn the_example_agrees_with_an_independent_projection_and_shading() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let done = render(&out, &["--by-products", "labels,slopes,mask,depth,img"]);
    assert_done(&done);
    for words in ["retina.toml", "clip_start", "diffuse_bounces", "device and samples"] {
        assert!(stderr(&done).contains(words), "{}", stderr(&done));
    }
    let vertices = vertices();
    assert_eq!(vertices.len(), 3897);
    for index in 0..5 {
        let frame = frame(index);
        let file = |kind: &str, extension: &str| out.join(format!("{kind}/{index:06}.{extension}"));
        // The body's outline: its vertices as an independent pinhole projects them. A mask's edge
        // pixel is set from half coverage on, and the outline's corners cover less of theirs.
        let seen: Vec<([f64; 2], f64)> = vertices.iter().map(|&v| frame.project(v)).collect();
        let mut wanted = [f64::MAX, f64::MAX, f64::MIN, f64::MIN];
        for ([x, y], _) in &seen {
            wanted = [wanted[0].min(*x), wanted[1].min(*y), wanted[2].max(*x), wanted[3].max(*y)];
        }
        let mask = grey(&file("mask_ID_1", "png"));
        let found = bounds(&mask);
        for side in 0..4 {
            assert!(
                (found[side] - wanted[side]).abs() < 1.5,
                "frame {index}: {found:?}, expected {wanted:?}"
            );
        }
        // The nearest vertex is seen, and no surface is nearer.
        let depth = channels(&file("depth", "exr"));
        assert_eq!(depth.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>(), ["A", "B", "G", "R"]);
        let depth = &depth[3].1;
        let nearest = seen.iter().fold(f64::MAX, |least, (_, depth)| least.min(*depth));
        let least = depth.iter().copied().fold(f32::MAX, f32::min);
        assert!((f64::from(least) - nearest).abs() < 2e-3, "{least} {nearest}");
        assert!((0..mask.len()).all(|i| mask[i] == 0 || depth[i] < 100.0));
        assert!(depth.contains(&1e10));
        // Shading from the normals' file: exposure E / pi a cos i, as an sRGB count; in the middle of
        // lit surface, where all nine pixels around are lit and the mask is whole.
        let slopes = channels(&file("slopes", "exr"));
        let normal = |pixel: usize| [3, 2, 1].map(|channel: usize| f64::from(slopes[channel].1[pixel]));
        let length = frame.sun.iter().map(|v| v * v).sum::<f64>().sqrt();
        let lit = grey(&file("mask_ID_shadow_1", "png"));
        let counts = grey(&file("frames", "png"));
        let mut off = Vec::new();
        for y in 1..HEIGHT - 1 {
            for x in 1..WIDTH - 1 {
                let around = (y - 1..=y + 1).flat_map(|y| (x - 1..=x + 1).map(move |x| y * WIDTH + x));
                if around.clone().all(|i| lit[i] > 0 && mask[i] > 0) {
                    let n = normal(y * WIDTH + x);
                    let cos_i = (0..3).map(|k| n[k] * frame.sun[k] / length).sum::<f64>();
                    let value = ENERGY / std::f64::consts::PI * ALBEDO * cos_i.max(0.0);
                    off.push((f64::from(counts[y * WIDTH + x]) - 255.0 * srgb(value)).abs());
                }
            }
        }
        off.sort_by(f64::total_cmp);
        assert!(off.len() > 400, "frame {index}: {} lit pixels", off.len());
        // Half a step of rounding and what the count changes within a pixel.
        assert!(off[off.len() / 2] < 0.6, "frame {index}: {}", off[off.len() / 2]);
        assert!(off[off.len() * 9 / 10] < 2.0, "frame {index}: {}", off[off.len() * 9 / 10]);
        // Light is seen only where the body is, but for pixels that it covers in part.
        let stray = (0..mask.len()).filter(|&i| lit[i] > 0 && mask[i] == 0).count();
        assert!(stray < 200, "{stray}");
        assert_eq!(fs::read(file("img", "png")).unwrap(), fs::read(file("frames", "png")).unwrap());
        let label: Vec<f64> = fs::read_to_string(file("labels", "txt"))
            .unwrap()
            .split_whitespace()
            .map(|word| word.parse().unwrap())
            .collect();
        assert_eq!(label.len(), 18);
        assert_eq!(label[..4], [index as f64, frame.body.0[0], frame.body.0[1], frame.body.0[2]]);
        assert_eq!(label[15..], frame.sun);
        assert!((label[11] - frame.camera.1[0]).abs() < 1e-12);
    }
}

#[test]
fn a_facility_can_show_it_and_what_does_not_fit_is_refused() {
    let fixture = Fixture::new();
    let setup = fixture.path("setup.toml");
    let setup = setup.to_str().unwrap();
    let out = fixture.path("screen");
    let summary = json(&render(&out, &["--setup", setup, "--frames", "0..1", "--json"]));
    assert_eq!(summary["saturated_px"], 0);
    let size = image::image_dimensions(out.join("frames/000000.png")).unwrap();
    assert_eq!(size, (160, 100));
    for (more, words) in [
        (
            vec!["--by-products", "img,depht"],
            "found `depht`, expected img, depth, mask, slopes, labels, depth_exr, slopes_exr",
        ),
        (vec!["--setup", setup, "--compensation", "resample"], "no calibration to compensate with"),
        (vec!["--compensation", "direct"], "--setup"),
        (vec!["--sidecar", "nowhere.toml"], "nowhere.toml: cannot be read"),
    ] {
        let refused = render(&fixture.path("refused"), &more);
        assert_eq!(refused.status.code(), Some(2), "{more:?}");
        assert!(stderr(&refused).contains(words), "{}", stderr(&refused));
        assert!(!fixture.path("refused").exists());
    }
}

/// A server started with some arguments, a connected sender of poses and a client.
struct Served {
    server: std::process::Child,
    lines: std::io::Lines<BufReader<std::process::ChildStdout>>,
    sender: UdpSocket,
    client: TcpStream,
    /// Its first line.
    ready: Value,
}

impl Served {
    fn start(arguments: &[&std::ffi::OsStr], frames: &str) -> Self {
        let served = Self::run(&[&["serve".as_ref()], arguments].concat(), frames);
        assert_eq!(served.ready["schema"], "retina.serve/1");
        served.sender.set_read_timeout(Some(std::time::Duration::from_secs(60))).unwrap();
        served
    }

    /// Any command that speaks the protocol.
    fn run(command: &[&std::ffi::OsStr], frames: &str) -> Self {
        let mut server = Command::new(env!("CARGO_BIN_EXE_retina"))
            .args(command)
            .args([
                "--backend",
                "cpu",
                "--quality",
                "draft",
                "--pose-port",
                "0",
                "--image-port",
                "0",
                "--json",
            ])
            .args(["--frames", frames])
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(server.stdout.take().unwrap()).lines();
        let ready: Value = serde_json::from_str(&lines.next().unwrap().unwrap()).unwrap();
        let address = |key: &str| ready[key].as_str().unwrap().to_owned();
        assert!(address("poses").starts_with("127.0.0.1:"));
        let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
        sender.connect(address("poses")).unwrap();
        let client = TcpStream::connect(address("images")).unwrap();
        Self { server, lines, sender, client, ready }
    }

    fn png(&mut self, datagram: &[u8]) -> Vec<u8> {
        self.sender.send(datagram).unwrap();
        let mut length = [0; 8];
        self.client.read_exact(&mut length).unwrap();
        let mut png = vec![0; u64::from_le_bytes(length) as usize];
        self.client.read_exact(&mut png).unwrap();
        png
    }

    /// The summary, once the server has ended by itself.
    fn end(mut self) -> Value {
        let end = serde_json::from_str(&self.lines.next().unwrap().unwrap()).unwrap();
        assert!(self.server.wait().unwrap().success());
        end
    }
}

#[test]
fn the_closed_loop_sends_the_images_that_a_run_writes() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    assert_done(&render(&out, &["--frames", "0..2"]));
    let mut served = Served::start(&["--corto".as_ref(), scenario().as_os_str()], "2");
    // A camera inside the body gets an answer and no image.
    let mut inside = datagram(&frame(0));
    inside.copy_within(80..104, 24);
    served.sender.send(&inside).unwrap();
    let mut reply = [0; 1024];
    let size = served.sender.recv(&mut reply).unwrap();
    let reply = String::from_utf8_lossy(&reply[..size]).into_owned();
    assert!(reply.contains("the camera is inside the body `eros`"), "{reply}");
    for index in 0..2 {
        let png = served.png(&datagram(&frame(index)));
        assert_eq!(png, fs::read(out.join(format!("frames/{index:06}.png"))).unwrap());
    }
    let end = served.end();
    assert_eq!((&end["images_sent"], &end["requests_refused"]), (&2.into(), &1.into()));
}

#[test]
fn a_scene_can_be_served_too() {
    let fixture = Fixture::new();
    fixture.edit("scene.toml", "\"auto\"", "0.05");
    assert_done(&fixture.render("out", &["--frames", "0..1", "--quality", "draft"]));
    let mut served = Served::start(&[fixture.path("scene.toml").as_os_str()], "1");
    // Blender's camera looks along -z: from +z, the Sun behind it, as the first frame is from -z.
    let pose = Frame {
        sun: [0.0, 0.0, 1e11],
        camera: ([0.0, 0.0, common::DISTANCE_M], [1.0, 0.0, 0.0, 0.0]),
        body: ([0.0; 3], [1.0, 0.0, 0.0, 0.0]),
    };
    fs::write(fixture.path("served.png"), served.png(&datagram(&pose))).unwrap();
    served.end();
    let counts = |name: &str| common::counts(&fixture.path(name));
    let (served, rendered) = (counts("served.png"), counts("out/frames/000000.png"));
    assert!(rendered.iter().any(|&count| count > 50));
    let differing = served.iter().zip(&rendered).filter(|(a, b)| a.abs_diff(**b) > 2).count();
    // The mesh's other side: its facets' edges lie elsewhere at the limb.
    assert!(differing < 40, "{differing} pixels differ");
}

/// Sun position, camera, body: 17 big-endian f64.
/// The virtual bench's photograph of the Moon comes back for a pose, and the loop's table says what it shows.
#[test]
fn the_laboratory_answers_poses_with_photographs() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let assets = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets");
    let (scene, setup) = (assets.join("scenarios/lumio.toml"), assets.join("setups/narrow-fov.toml"));
    let mut command: Vec<&std::ffi::OsStr> = vec!["lab".as_ref(), "loop".as_ref(), scene.as_ref()];
    command.extend(["--setup".as_ref(), setup.as_os_str(), "--out".as_ref(), out.as_os_str()]);
    // The Moon 350 000 km away, and a rate that no frame can keep.
    for word in "--screen bench --camera bench --radiance-scale 0.0175 --scale-m-per-bu 1.75e7 \
                 --rate-hz 1000"
        .split_whitespace()
    {
        command.push(word.as_ref());
    }
    let mut served = Served::run(&command, "1");
    assert_eq!(served.ready["schema"], "retina.lab-loop/1");
    let png = served.png(&datagram(&frame(0)));
    let end = served.end();
    assert_eq!((&end["frames"], &end["late"]), (&Value::from(1), &Value::from(1)));
    assert_eq!(png, fs::read(out.join("images/000000.png")).unwrap());
    let photograph = image::load_from_memory(&png).unwrap().to_luma16();
    let lit = photograph.pixels().filter(|pixel| pixel.0[0] > 400).count();
    // Its disc is 0.57 deg or 145 px wide at the focal length of 14 500 px; 85 % of it are lit.
    assert!((10_000..15_000).contains(&lit), "{:?}: {lit} lit pixels", photograph.dimensions());
    let table = fs::read_to_string(out.join("loop.csv")).unwrap();
    let (head, line) = table.trim_end().split_once('\n').unwrap();
    let column = |name: &str| -> f64 {
        let place = head.split(',').position(|column| column == name).unwrap();
        line.split(',').nth(place).unwrap().parse().unwrap()
    };
    let distance = ["camera_x_m", "camera_y_m", "camera_z_m"].map(column);
    let camera = frame(0).camera.0.map(|value| 1.75e7 * value);
    for (found, wanted) in distance.iter().zip(camera) {
        assert!((found - wanted).abs() < 1.0, "{distance:?}, {camera:?}");
    }
    assert!(column("whole_s") >= column("render_s") + column("take_s") && column("late") == 1.0);
}

fn datagram(frame: &Frame) -> Vec<u8> {
    let values = frame
        .sun
        .iter()
        .chain(&frame.camera.0)
        .chain(&frame.camera.1)
        .chain(&frame.body.0)
        .chain(&frame.body.1);
    values.flat_map(|value| value.to_be_bytes()).collect()
}
