//! A scene whose camera, Sun and photometry are set by hand: drafts while one turns, the full frame afterwards.

use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use axum::extract::{Query, State};
use axum::routing::{get, post};
use axum::{Json, Router};
use retina_batch::{BackendChoice, BatchError, FrameMaker, Scaling};
use retina_files::{InputError, hash_bytes, parse_toml, read_text};
use retina_geometry::Pinhole;
use retina_render::Quality;
use retina_scene::{Compensation, Given, Scene, SceneFrame};
use retina_sky::Trajectory;
use serde::Deserialize;
use serde_json::{Value, json};

use super::pose::View;
use super::{image_bytes, locked, with_facts};
use crate::api::{Answer, App, Shared, beside, json_of};
use crate::failure::Refusal;
use crate::session::file_name;

/// Largest draft, px.
const DRAFT_PX: [f64; 2] = [640.0, 400.0];
/// What the scene's copy for the live pose is called in errors.
const POSE: &str = "the pose";

/// Scenes that stay open, so that two windows do not open theirs in turn. Each holds its meshes and renderers.
const OPEN_SCENES: usize = 2;

/// The scenes that are open, the latest first.
#[derive(Default)]
pub(super) struct Live {
    open: VecDeque<Open>,
}

struct Open {
    file: PathBuf,
    /// Of the file, and of the photometry in its place.
    hash: String,
    frame: SceneFrame,
    names: Vec<String>,
    frames: usize,
    scene: Scene,
    draft: Option<FrameMaker>,
    full: Option<FrameMaker>,
}

pub(super) fn routes() -> Router<Arc<App>> {
    Router::new()
        .route("/api/scene", get(about))
        .route("/api/scene/image", post(image))
        .route("/api/scene/pose", post(pose))
}

impl From<BatchError> for Refusal {
    fn from(error: BatchError) -> Self {
        match error {
            BatchError::Input(error) => error.into(),
            error => Self::new(axum::http::StatusCode::UNPROCESSABLE_ENTITY, error.to_string()),
        }
    }
}

/// The scene's text with other photometry for one body.
fn with_photometry(
    file: &std::path::Path,
    text: &str,
    body: &str,
    photometry: &str,
) -> Result<toml::Table, InputError> {
    let mut scene: toml::Table = parse_toml(file, text)?;
    let own: toml::Table = parse_toml("photometry".as_ref(), &format!("photometry = {photometry}"))?;
    let bodies = scene.get_mut("body").and_then(toml::Value::as_array_mut);
    let table = bodies.and_then(|bodies| {
        bodies
            .iter_mut()
            .filter_map(toml::Value::as_table_mut)
            .find(|table| table.get("name").and_then(toml::Value::as_str) == Some(body))
    });
    if let (Some(table), Some(value)) = (table, own.get("photometry")) {
        table.insert("photometry".to_owned(), value.clone());
    }
    Ok(scene)
}

/// What the page asks for.
#[derive(Debug, Clone, Deserialize)]
struct Asked {
    at: String,
    body: String,
    /// Frame that time and bodies are taken from.
    frame: usize,
    view: Option<View>,
    /// A TOML table in the place of the body's own.
    photometry: Option<String>,
    #[serde(default)]
    full: bool,
}

impl Live {
    /// The scene of a request, opened if it is another one than before.
    fn open(&mut self, app: &App, asked: &Asked) -> Result<&mut Open, Refusal> {
        let file = app.path(&asked.at)?;
        let mut text = read_text(&file)?;
        if let Some(photometry) = &asked.photometry {
            text = with_photometry(&file, &text, &asked.body, photometry)?.to_string();
        }
        let hash = hash_bytes(text.as_bytes());
        let same = self.open.iter().position(|open| open.file == file && open.hash == hash);
        if let Some(open) = same.and_then(|place| self.open.remove(place)) {
            self.open.push_front(open);
        } else {
            // A law that was tried is not kept beside the next one; nor is a third scene.
            self.open.retain(|open| open.file != file);
            self.open.truncate(OPEN_SCENES - 1);
            let mut scene = Scene::parse(&file, &text, Given::default())?;
            if scene.bodies.is_empty() {
                return Err(InputError::new(&file, "has no body to turn the camera about")
                    .expected("a scene with at least one [[body]]")
                    .into());
            }
            scene.allow_empty_frames = true;
            scene.bodies.iter_mut().for_each(|body| body.may_be_behind = true);
            let names = scene.bodies.iter().map(|body| body.name.clone()).collect();
            let (frame, frames) = (scene.frame(asked.frame)?, scene.frame_count());
            self.open.push_front(Open { file, hash, frame, names, frames, scene, draft: None, full: None });
        }
        let open = self.open.front_mut().ok_or_else(|| Refusal::conflict("the scene is not open"))?;
        if open.frame.index != asked.frame {
            open.frame = open.scene.frame(asked.frame)?;
        }
        Ok(open)
    }
}

impl Open {
    fn body(&self, name: &str) -> Result<usize, Refusal> {
        self.names.iter().position(|own| own == name).ok_or_else(|| Refusal::not_found("such body"))
    }

    /// The renderer of drafts, or of full frames.
    fn maker(&mut self, full: bool) -> Result<&mut FrameMaker, BatchError> {
        let place = if full { &mut self.full } else { &mut self.draft };
        if let Some(maker) = place {
            return Ok(maker);
        }
        let mut scene = self.scene.clone();
        scene.output.exr = false;
        let mut quality = None;
        if !full {
            scene.image = draft_image(&scene.image);
            (scene.compensation, scene.distortion, scene.inverse) = (Compensation::None, None, None);
            (scene.stars, scene.flashes) = (None, None);
            quality = Some(Quality::Draft);
        }
        let (maker, _) = FrameMaker::open(scene, BackendChoice::Auto, quality, Scaling::OfFrame)?;
        Ok(place.insert(maker))
    }
}

/// The same field in fewer pixels.
fn draft_image(image: &Pinhole) -> Pinhole {
    let [width, height] = [image.width_px, image.height_px].map(f64::from);
    let scale = (DRAFT_PX[0] / width).min(DRAFT_PX[1] / height).min(1.0);
    let size = |px: f64| (px * scale).round().max(1.0);
    Pinhole {
        fx_px: image.fx_px * size(width) / width,
        fy_px: image.fy_px * size(height) / height,
        cx_px: image.cx_px * size(width) / width,
        cy_px: image.cy_px * size(height) / height,
        width_px: size(width) as u32,
        height_px: size(height) as u32,
    }
}

#[derive(Deserialize)]
struct Start {
    at: String,
    body: Option<String>,
    #[serde(default)]
    frame: usize,
    /// Reads the files again: what the scene names may have changed on the disk.
    #[serde(default)]
    anew: bool,
}

async fn about(State(app): Shared, Query(start): Query<Start>) -> Answer {
    beside(move || {
        let mut live = locked(&app.panes.live);
        if start.anew {
            let file = app.path(&start.at)?;
            live.open.retain(|open| open.file != file);
        }
        let asked = Asked {
            at: start.at,
            body: start.body.unwrap_or_default(),
            frame: start.frame,
            view: None,
            photometry: None,
            full: false,
        };
        let open = live.open(&app, &asked)?;
        let body = if asked.body.is_empty() { 0 } else { open.body(&asked.body)? };
        let scene: toml::Table = parse_toml(&open.file, &read_text(&open.file)?)?;
        let photometry: Value = scene
            .get("body")
            .and_then(|bodies| bodies.get(body)?.get("photometry"))
            .map_or(Value::Null, |value| value.to_string().into());
        let image = open.scene.image;
        json_of(json!({
            "name": file_name(&open.file),
            "bodies": open.names,
            "body": open.names[body],
            "radius_m": open.scene.bodies[body].reference_radius_m(),
            "frames": open.frames,
            "photometry": photometry,
            "view": View::of(&open.frame, body, &image),
            "image_px": { "fx": image.fx_px, "width": image.width_px, "height": image.height_px },
        }))
    })
    .await
}

fn view_of(asked: &Asked) -> Result<View, Refusal> {
    let unsound = || Refusal::conflict("the view has a number that is out of range");
    asked.view.filter(View::is_sound).ok_or_else(unsound)
}

async fn image(State(app): Shared, Json(asked): Json<Asked>) -> Answer {
    beside(move || {
        let view = view_of(&asked)?;
        let mut live = locked(&app.panes.live);
        let open = live.open(&app, &asked)?;
        let body = open.body(&asked.body)?;
        let pose = view.pose(&open.frame, &open.names, body, &open.scene.image);
        let start = Instant::now();
        let maker = open.maker(asked.full)?;
        let opened_s = start.elapsed().as_secs_f64();
        let start = Instant::now();
        let made = maker.pose(POSE, pose)?;
        let size = made.size_px.map(|size| size as usize);
        let facts = json!({
            "seconds": start.elapsed().as_secs_f64(),
            "opened_s": opened_s,
            "radiance_scale": made.radiance_scale,
            "saturated_px": made.saturated_px,
            "image_px": made.truth["image_px"],
            "bodies": made.truth["bodies"],
            "renderer": maker.name().adapter,
        });
        Ok(with_facts(
            image_bytes(size, made.counts.into_iter().map(|b| [b])),
            "application/octet-stream",
            &facts,
        ))
    })
    .await
}

/// The pose as files: a table of one frame, and the scene that shows it.
async fn pose(State(app): Shared, Json(asked): Json<Asked>) -> Answer {
    beside(move || {
        let view = view_of(&asked)?;
        let mut live = locked(&app.panes.live);
        let open = live.open(&app, &asked)?;
        let body = open.body(&asked.body)?;
        let pose = view.pose(&open.frame, &open.names, body, &open.scene.image);
        let text = read_text(&open.file)?;
        let mut scene: toml::Table = match &asked.photometry {
            Some(photometry) => with_photometry(&open.file, &text, &asked.body, photometry)?,
            None => parse_toml(&open.file, &text)?,
        };
        scene.insert("trajectory".to_owned(), "pose.csv".into());
        // As bright as it is seen here.
        scene.insert("radiance_scale".to_owned(), "auto".into());
        let trajectory = Trajectory::new(POSE.as_ref(), vec![pose]);
        json_of(json!({ "pose.csv": trajectory.to_csv(), "scene.toml": scene.to_string() }))
    })
    .await
}
