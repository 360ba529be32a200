//! Images of a sphere by a generator that shares nothing with the code under test: rays at 6 x 6 points a pixel,
//! convolution by summing points, Poisson's noise, rounding.

use std::path::{Path, PathBuf};

use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, Normal};
use retina_batch::{Channels, write_exr};
use retina_diagnosis::{DiagnoseOptions, Diagnosis};
use retina_files::InputError;
use retina_frames::{FrameSet, FramesSource, diagnose_frames};
use retina_geometry::Setup;
use retina_image::CameraImage;

pub(crate) const WIDTH: usize = 128;
pub(crate) const HEIGHT: usize = 96;
const FULL_SCALE: f64 = 4095.0;
/// Electrons for a digital number.
const ELECTRONS: f64 = 4.0;
const READ_NOISE_DN: f64 = 2.0;

/// A sphere in front of a camera: middle of its image, radius, and direction of the Sun (camera axes).
#[derive(Clone, Copy)]
pub(crate) struct Ball {
    pub(crate) centre_px: [f64; 2],
    pub(crate) radius_px: f64,
    pub(crate) sun: [f64; 3],
}

pub(crate) const BALL: Ball = Ball { centre_px: [60.0, 50.0], radius_px: 21.0, sun: [0.75, 0.25, -0.612] };

/// Blur of the optics, in the prediction also: without any, no image can be moved by a part of a pixel.
const OPTICS_PX: f64 = 0.9;

/// What an image is made by.
#[derive(Clone, Copy)]
pub(crate) struct Chain {
    pub(crate) shift_px: [f64; 2],
    pub(crate) roll_rad: f64,
    pub(crate) law: fn(f64, f64) -> f64,
    /// Beside the optics' own [`OPTICS_PX`], which the prediction has.
    pub(crate) blur_px: f64,
    pub(crate) glare: f64,
    /// Seidel's coma: c of [`seidel`] at r = 1, px.
    pub(crate) coma_px: f64,
    /// Share of the light mirrored at the axis.
    pub(crate) ghost: f64,
    /// Where the signal ends, DN.
    pub(crate) well_dn: f64,
    pub(crate) vignetting: f64,
    pub(crate) nonlinearity: f64,
    pub(crate) offset_dn: f64,
    pub(crate) noise: bool,
}

pub(crate) fn lambert(mu0: f64, _: f64) -> f64 {
    mu0
}

pub(crate) fn lommel_seeliger(mu0: f64, mu: f64) -> f64 {
    2.0 * mu0 / (mu0 + mu)
}

pub(crate) const PLAIN: Chain = Chain {
    shift_px: [0.8, -0.6],
    roll_rad: 0.01,
    law: lambert,
    blur_px: 0.0,
    glare: 0.0,
    coma_px: 0.0,
    ghost: 0.0,
    well_dn: f64::INFINITY,
    vignetting: 0.0,
    nonlinearity: 0.0,
    offset_dn: 30.0,
    noise: true,
};

/// cos i, cos e, phase (rad) where a line of sight meets the ball; the camera is far away.
fn meet(ball: &Ball, at: [f64; 2]) -> Option<[f64; 3]> {
    let (x, y) = ((at[0] - ball.centre_px[0]) / ball.radius_px, (at[1] - ball.centre_px[1]) / ball.radius_px);
    let rest = 1.0 - x * x - y * y;
    (rest > 0.0).then(|| {
        let normal = [x, y, -rest.sqrt()];
        let mu0 = (0..3).map(|k| normal[k] * ball.sun[k]).sum::<f64>();
        [mu0, rest.sqrt(), (-ball.sun[2]).acos()]
    })
}

/// Mean over a pixel of what its points see.
fn over_pixel(column: usize, row: usize, value: impl Fn([f64; 2]) -> f64) -> f64 {
    const SIDE: usize = 6;
    let inner = |k: usize| (k as f64 + 0.5) / SIDE as f64;
    (0..SIDE * SIDE)
        .map(|k| value([column as f64 + inner(k % SIDE), row as f64 + inner(k / SIDE)]))
        .sum::<f64>()
        / (SIDE * SIDE) as f64
}

/// The prediction: light of Lambert's sphere, with the layers of angles.
pub(crate) fn write_prediction(path: &Path, ball: &Ball) {
    let plane = |value: &dyn Fn([f64; 2]) -> f64| -> Vec<f32> {
        (0..WIDTH * HEIGHT).map(|at| over_pixel(at % WIDTH, at / WIDTH, value) as f32).collect()
    };
    let mask = plane(&|at| f64::from(u8::from(meet(ball, at).is_some())));
    let mean_angle = |angle: &dyn Fn([f64; 3]) -> f64| -> Vec<f32> {
        let sum = plane(&|at| meet(ball, at).map_or(0.0, |m| angle(m).to_degrees()));
        sum.iter().zip(&mask).map(|(s, m)| if *m > 0.0 { s / m } else { 0.0 }).collect()
    };
    let light = spread(&|at| meet(ball, at).map_or(0.0, |[mu0, mu, _]| lambert(mu0.max(0.0), mu)), OPTICS_PX);
    let channels = vec![
        ("IF".to_owned(), light.iter().map(|v| *v as f32).collect()),
        ("incidence_deg".to_owned(), mean_angle(&|m| m[0].acos())),
        ("emission_deg".to_owned(), mean_angle(&|m| m[1].acos())),
        ("phase_deg".to_owned(), mean_angle(&|m| m[2])),
        ("mask".to_owned(), mask.clone()),
    ];
    let bytes =
        write_exr(Channels { width_px: WIDTH, height_px: HEIGHT, channels }, "made by a test").unwrap();
    std::fs::write(path, bytes).unwrap();
}

/// Points of the pupil in [`seidel`].
const PUPIL: usize = 24;

/// Where rays of Seidel's coma meet the image, px: c r (rho^2 (2 + cos 2 theta) along the radius, rho^2 sin 2 theta across)
/// (W. J. Smith, Modern Optical Engineering, ch. 3), r = 1 at half the camera's width; rings of equal area.
fn seidel(c: f64, from_axis: [f64; 2]) -> [[f64; 2]; PUPIL] {
    let r = from_axis[0].hypot(from_axis[1]);
    let along = if r > 0.0 { [from_axis[0] / r, from_axis[1] / r] } else { [0.0; 2] };
    let size = c * r / (WIDTH as f64 / 2.0);
    std::array::from_fn(|k| {
        let (rho2, theta) =
            (((k / 8) as f64 + 0.5) / 3.0, std::f64::consts::TAU * ((k % 8) as f64 + 0.5) / 8.0);
        let (a, t) = (size * rho2 * (2.0 + (2.0 * theta).cos()), size * rho2 * (2.0 * theta).sin());
        [a * along[0] - t * along[1], a * along[1] + t * along[0]]
    })
}

/// A photograph.
pub(crate) fn photograph(ball: &Ball, chain: &Chain, seed: u64) -> CameraImage {
    let (sin, cos) = chain.roll_rad.sin_cos();
    let back = |at: [f64; 2]| -> [f64; 2] {
        // Seen at c + shift + R (p - c).
        let (x, y) =
            (at[0] - ball.centre_px[0] - chain.shift_px[0], at[1] - ball.centre_px[1] - chain.shift_px[1]);
        [ball.centre_px[0] + cos * x + sin * y, ball.centre_px[1] - sin * x + cos * y]
    };
    let light = |at: [f64; 2]| {
        meet(ball, back(at)).map_or(0.0, |[mu0, mu, _]| if mu0 > 0.0 { (chain.law)(mu0, mu) } else { 0.0 })
    };
    let axis = [WIDTH as f64 / 2.0, HEIGHT as f64 / 2.0];
    let through = |at: [f64; 2]| {
        let comatic = |at: [f64; 2]| match chain.coma_px {
            0.0 => light(at),
            c => {
                seidel(c, [at[0] - axis[0], at[1] - axis[1]])
                    .iter()
                    .map(|d| light([at[0] - d[0], at[1] - d[1]]))
                    .sum::<f64>()
                    / PUPIL as f64
            }
        };
        let mirrored = [2.0 * axis[0] - at[0], 2.0 * axis[1] - at[1]];
        comatic(at) + if chain.ghost > 0.0 { chain.ghost * comatic(mirrored) } else { 0.0 }
    };
    let mut image = spread(&through, chain.blur_px.hypot(OPTICS_PX));
    if chain.glare > 0.0 {
        let halo = spread_pixels(&image, 8.0);
        image.iter_mut().zip(&halo).for_each(|(v, h)| *v += chain.glare * (h - *v));
    }
    let peak = image.iter().copied().fold(0.0, f64::max);
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut out = CameraImage::new(WIDTH as u32, HEIGHT as u32, FULL_SCALE as f32);
    for (at, value) in image.iter().enumerate() {
        let (x, y) = ((at % WIDTH) as f64 + 0.5, (at / WIDTH) as f64 + 0.5);
        let r = (x - WIDTH as f64 / 2.0).hypot(y - HEIGHT as f64 / 2.0) / (WIDTH as f64 / 2.0);
        let mut dn = 2800.0 * value / peak * (1.0 - chain.vignetting * r * r);
        dn += chain.nonlinearity * dn * dn / FULL_SCALE;
        dn = dn.min(chain.well_dn);
        dn += chain.offset_dn;
        if chain.noise {
            let sigma = (dn.max(0.0) / ELECTRONS + READ_NOISE_DN.powi(2)).sqrt();
            dn += Normal::new(0.0, sigma).unwrap().sample(&mut random);
        }
        out.values[at] = dn.round().clamp(0.0, FULL_SCALE) as f32;
    }
    out
}

/// Each pixel the sum over points of a Gaussian's place.
fn spread(light: &dyn Fn([f64; 2]) -> f64, sigma: f64) -> Vec<f64> {
    const FINE: usize = 4;
    let (columns, rows) = (WIDTH * FINE, HEIGHT * FINE);
    let cells: Vec<f64> = (0..columns * rows)
        .map(|at| {
            light([((at % columns) as f64 + 0.5) / FINE as f64, ((at / columns) as f64 + 0.5) / FINE as f64])
        })
        .collect();
    let wide = gaussian(&cells, columns, rows, sigma * FINE as f64);
    (0..WIDTH * HEIGHT)
        .map(|at| {
            let (x, y) = (at % WIDTH * FINE, at / WIDTH * FINE);
            (0..FINE * FINE).map(|k| wide[(y + k / FINE) * columns + x + k % FINE]).sum::<f64>()
                / (FINE * FINE) as f64
        })
        .collect()
}

fn spread_pixels(image: &[f64], sigma: f64) -> Vec<f64> {
    gaussian(image, WIDTH, HEIGHT, sigma)
}

fn gaussian(values: &[f64], columns: usize, rows: usize, sigma: f64) -> Vec<f64> {
    let reach = (4.0 * sigma).ceil() as i64;
    let weights: Vec<f64> = (-reach..=reach).map(|k| (-0.5 * (k as f64 / sigma).powi(2)).exp()).collect();
    let norm: f64 = weights.iter().sum();
    let along = |values: &[f64], step: usize, length: usize| -> Vec<f64> {
        (0..values.len())
            .map(|at| {
                let place = (at / step % length) as i64;
                weights
                    .iter()
                    .enumerate()
                    .map(|(k, w)| {
                        let other = place + k as i64 - reach;
                        let inside = (0..length as i64).contains(&other);
                        if inside {
                            w * values[(at as i64 + (other - place) * step as i64) as usize]
                        } else {
                            0.0
                        }
                    })
                    .sum::<f64>()
                    / norm
            })
            .collect()
    };
    along(&along(values, 1, columns), columns, rows)
}

pub(crate) const SETUP: &str = r#"
schema = "retina.setup/1"
name = "test"
[screen]
width_px = 100
height_px = 60
width_mm = 10.0
height_mm = 6.0
bits = 8
wavelength_nm = { r = 605.0, g = 544.0, b = 475.0 }
[camera]
width_px = 128
height_px = 96
pixel_um = 10.0
focal_mm = 25.0
f_number = 4.0
bits = 12
[facility]
observed_rows_px = 60
"#;

/// A folder with a setup, a prediction, and as many photographs as there are chains.
pub(crate) struct Case {
    folder: tempfile::TempDir,
    pub(crate) setup: Setup,
}

impl Case {
    pub(crate) fn new(images: &[(Ball, Chain)], seed: u64) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        std::fs::write(path("setup.toml"), SETUP).unwrap();
        let mut table = String::from("predicted,measured,exposure_s\n");
        for (k, (ball, chain)) in images.iter().enumerate() {
            write_prediction(&path(&format!("{k}.exr")), ball);
            photograph(ball, chain, 1000 * seed + k as u64).write_png(&path(&format!("{k}.png"))).unwrap();
            table.push_str(&format!("{k}.exr,{k}.png,0.1\n"));
        }
        std::fs::write(path("frames.csv"), table).unwrap();
        let setup = Setup::read(&path("setup.toml")).unwrap();
        Self { folder, setup }
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub(crate) fn read(&self, register: bool) -> Result<FrameSet, InputError> {
        let files = [self.path("frames.csv")];
        FrameSet::read(&FramesSource { files: &files, setup: &self.setup, calibration: None, register })
    }

    pub(crate) fn diagnose(&self, register: bool) -> Diagnosis {
        let mut set = self.read(register).unwrap();
        diagnose_frames(&mut set, &[], &DiagnoseOptions { flips: 499, seed: 1 }).unwrap().2
    }
}

pub(crate) fn parameter(set_or: &Diagnosis, effect: &str, name: &str) -> f64 {
    let candidate = set_or.candidates.iter().find(|c| c.effect == effect).unwrap();
    candidate.parameters.iter().find(|p| p.name == name).unwrap().value
}
