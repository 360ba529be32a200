//! The virtual bench: a screen image and what the camera makes of it, part by part, and the image of one point.

use std::sync::Arc;
use std::time::Instant;

use axum::extract::State;
use axum::routing::post;
use axum::{Json, Router};
use rayon::prelude::*;
use retina_bench::{Bench, BenchOptions, Exposure, PointImage, ScreenImage};
use retina_campaign::read_screen;
use retina_files::hash_bytes;
use retina_geometry::Setup;
use serde::Deserialize;
use serde_json::json;

use super::{image_bytes, locked, setup_of, with_facts};
use crate::api::{Answer, App, Shared, beside, within};
use crate::failure::Refusal;

/// Benches that are kept: one for each way in which a point's image is seen.
const KEPT: usize = 3;

/// The brightest pixel is brought to this part of the full well where no exposure is asked for.
const AUTO_LEVEL: f64 = 0.6;

/// Pixels about a point that are shown of its image, from the middle one to the rim.
const SPOT_HALF_PX: usize = 20;

/// Benches by their setup's hash and what they model.
#[derive(Default)]
pub(super) struct Benches(Vec<(String, PointImage, Arc<Bench>)>);

pub(super) fn routes() -> Router<Arc<App>> {
    Router::new()
        .route("/api/bench/screen", post(screen))
        .route("/api/bench/image", post(image))
        .route("/api/bench/spot", post(spot))
}

/// What of the image of a point is modelled.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Points {
    Point,
    Diffraction,
    Full,
}

impl From<Points> for PointImage {
    fn from(points: Points) -> Self {
        match points {
            Points::Point => Self::Point,
            Points::Diffraction => Self::Diffraction,
            Points::Full => Self::Full,
        }
    }
}

/// What the screen shows.
#[derive(Debug, Clone, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Shown {
    /// Single pixels at the points of a grid, this many along x.
    Grid { columns: u32, digital_count: u8 },
    /// A frame of a rendered sequence.
    Frame { at: String, frame: usize },
}

#[derive(Debug, Clone, Deserialize)]
struct Asked {
    setup: String,
    screen: Shown,
    points: Points,
    ghosts: bool,
    noise: bool,
    /// s; without it the brightest pixel is well exposed.
    exposure_s: Option<f64>,
}

#[derive(Debug, Clone, Deserialize)]
struct Spot {
    setup: String,
    points: Points,
    screen_px: [f64; 2],
}

impl Benches {
    /// The bench of a setup, and the seconds that it took to build; 0 where it was there.
    fn get(&mut self, setup: &Setup, points: PointImage) -> Result<(Arc<Bench>, f64), Refusal> {
        // All of a setup is in what it prints.
        let key = hash_bytes(format!("{setup:?}").as_bytes());
        let found = self.0.iter().position(|(own, shown, _)| *own == key && *shown == points);
        if let Some(at) = found {
            let kept = self.0.remove(at);
            let bench = Arc::clone(&kept.2);
            self.0.push(kept);
            return Ok((bench, 0.0));
        }
        let start = Instant::now();
        let options = BenchOptions { seed: 1, point_image: points, ..BenchOptions::default() };
        let bench = Arc::new(Bench::new(setup, &options)?);
        if self.0.len() >= KEPT {
            self.0.remove(0);
        }
        self.0.push((key, points, Arc::clone(&bench)));
        Ok((bench, start.elapsed().as_secs_f64()))
    }
}

fn shown(app: &App, setup: &Setup, shown: &Shown) -> Result<ScreenImage, Refusal> {
    let (width, height) = (setup.screen.width_px, setup.screen.height_px);
    match shown {
        Shown::Grid { columns, digital_count } => {
            let columns = (*columns).clamp(1, width.min(200));
            let rows = (columns * height / width).max(1);
            let mut image = ScreenImage::dark(width, height);
            for row in 0..rows {
                for column in 0..columns {
                    let [x, y] = [(column, columns, width), (row, rows, height)]
                        .map(|(k, count, size)| ((2 * k + 1) * size) / (2 * count));
                    image.set(x, y, [*digital_count; 3]);
                }
            }
            Ok(image)
        }
        Shown::Frame { at, frame } => {
            let folder = app.path(at)?;
            let path = within(&folder, folder.join("frames").join(format!("{frame:06}.png")))?;
            // Another size is refused by the bench, which says what it expects.
            Ok(read_screen(&path)?)
        }
    }
}

async fn screen(State(app): Shared, Json(asked): Json<Asked>) -> Answer {
    beside(move || {
        let image = shown(&app, &setup_of(&app, &asked.setup)?, &asked.screen)?;
        let size = [image.width_px as usize, image.height_px as usize];
        let counts = image.counts.iter().map(|count| [count[1]]);
        Ok(with_facts(image_bytes(size, counts), "application/octet-stream", &json!({})))
    })
    .await
}

async fn image(State(app): Shared, Json(asked): Json<Asked>) -> Answer {
    beside(move || {
        let setup = setup_of(&app, &asked.setup)?;
        let on_screen = shown(&app, &setup, &asked.screen)?;
        let (bench, built_s) = locked(&app.panes.benches).get(&setup, asked.points.into())?;
        let start = Instant::now();
        // Light grows with the exposure: one second first, then as long as it takes.
        let second = Exposure::new(1.0, 0);
        let mut light = if asked.ghosts {
            bench.light_e(&on_screen, &second)?
        } else {
            bench.focused_e(&bench.landed(&on_screen, &second)?, &second)
        };
        let brightest = light.par_iter().copied().reduce(|| 0.0, f32::max);
        let full_well_e = bench.sensor().full_well_e();
        let exposure_s = match asked.exposure_s {
            Some(value) if value > 0.0 && value < 1e6 => value,
            Some(_) => {
                return Err(Refusal::conflict(
                    "the exposure is out of range: seconds above 0 and below 1e6 are expected",
                ));
            }
            None => AUTO_LEVEL * full_well_e / f64::from(brightest).max(1e-6),
        };
        light.par_iter_mut().for_each(|value| *value = (*value * exposure_s as f32).max(0.0));
        let dn = if asked.noise {
            bench.read(&light, &Exposure::new(exposure_s, 1)).dn
        } else {
            bench.sensor().noiseless(&light)
        };
        let saturated = light.iter().filter(|value| f64::from(**value) >= full_well_e).count();
        let camera = &setup.camera;
        let facts = json!({
            "seconds": start.elapsed().as_secs_f64(),
            "built_s": built_s,
            "exposure_s": exposure_s,
            "saturated_px": saturated,
            "largest_dn": bench.sensor().largest_dn(),
        });
        let size = [camera.width_px as usize, camera.height_px as usize];
        let bytes = image_bytes(size, dn.into_iter().map(u16::to_le_bytes));
        Ok(with_facts(bytes, "application/octet-stream", &facts))
    })
    .await
}

/// The image of one white pixel: where it lands, and the share of the light that each camera pixel receives.
async fn spot(State(app): Shared, Json(asked): Json<Spot>) -> Answer {
    beside(move || {
        let setup = setup_of(&app, &asked.setup)?;
        let (bench, _) = locked(&app.panes.benches).get(&setup, asked.points.into())?;
        let size = [setup.screen.width_px, setup.screen.height_px];
        let pixel = [0, 1].map(|k| asked.screen_px[k].floor());
        if (0..2).any(|k| !(0.0..f64::from(size[k])).contains(&pixel[k])) {
            return Err(Refusal::conflict("the point is not on the screen"));
        }
        let mut on_screen = ScreenImage::dark(size[0], size[1]);
        on_screen.set(pixel[0] as u32, pixel[1] as u32, [255; 3]);
        let exposure = Exposure::new(1.0, 0);
        let middle = pixel.map(|value| value + 0.5);
        let landed = bench.land_px(middle, 1, &exposure);
        let sources = bench.sources(&on_screen, &exposure)?;
        let Some(at) = landed.filter(|_| !sources.is_empty()) else {
            return Err(Refusal::conflict("the light of this pixel does not reach the sensor"));
        };
        let width = setup.camera.width_px as usize;
        let mut light = vec![0f32; width * setup.camera.height_px as usize];
        bench.optics().add_points(&mut light, &sources);
        let total: f64 = sources.iter().map(|source| source.electrons).sum();
        let corner = at.map(|value| value.floor() as i64 - SPOT_HALF_PX as i64);
        let side = 2 * SPOT_HALF_PX + 1;
        let share = |k: usize| {
            let x = usize::try_from(corner[0] + (k % side) as i64).ok().filter(|x| *x < width);
            let y = usize::try_from(corner[1] + (k / side) as i64).ok();
            let value = x.zip(y).and_then(|(x, y)| light.get(y * width + x)).copied().unwrap_or(0.0);
            f64::from(value) / total
        };
        let shares: Vec<f64> = (0..side * side).map(share).collect();
        let moments = Moments::of(&shares, side);
        let landed_by = |channel: usize| bench.land_px(middle, channel, &exposure);
        let ideal = {
            let line = setup.facility_pinhole().line_of_sight(glam::DVec2::from(middle));
            bench.camera().pinhole.pixel(line)
        };
        let facts = json!({
            "screen_px": middle,
            "landed_px": { "r": landed_by(0), "g": landed_by(1), "b": landed_by(2) },
            "without_distortion_px": [ideal.x, ideal.y],
            "corner_px": corner,
            "centroid_px": [corner[0] as f64 + moments.centroid[0], corner[1] as f64 + moments.centroid[1]],
            "rms_px": moments.rms,
            "rms_um": moments.rms * setup.camera.pixel_um,
            "brightest_share": shares.iter().copied().fold(0.0, f64::max),
            "shown_share": shares.iter().sum::<f64>(),
        });
        let values = shares.into_iter().map(|value| (value as f32).to_le_bytes());
        Ok(with_facts(image_bytes([side, side], values), "application/octet-stream", &facts))
    })
    .await
}

/// Centre and RMS radius of an image.
struct Moments {
    centroid: [f64; 2],
    rms: f64,
}

impl Moments {
    fn of(values: &[f64], side: usize) -> Self {
        let place = |k: usize| [(k % side) as f64 + 0.5, (k / side) as f64 + 0.5];
        let sum = values.iter().sum::<f64>().max(f64::MIN_POSITIVE);
        let mean =
            |of: &dyn Fn(usize) -> f64| values.iter().enumerate().map(|(k, v)| v * of(k)).sum::<f64>() / sum;
        let centroid = [mean(&|k| place(k)[0]), mean(&|k| place(k)[1])];
        let square = mean(&|k| (0..2).map(|axis| (place(k)[axis] - centroid[axis]).powi(2)).sum());
        Self { centroid, rms: square.sqrt() }
    }
}
