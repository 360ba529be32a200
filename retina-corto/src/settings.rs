//! `scene.json`: camera, Sun, bodies, rendering.

use std::path::Path;

use retina_files::InputError;
use retina_geometry::Pinhole;
use retina_screen::{PlainDisplay, Transfer};

use crate::node::{CAMERA_KEYS, Node, read_json};

/// Largest image side, pixels.
const MOST_PIXELS: i64 = 16_384;
/// Blender's colour transforms besides `Standard` and `Raw`.
const OTHER_TRANSFORMS: [&str; 8] =
    ["Filmic", "Filmic Log", "AgX", "AgX Log", "False Color", "Khronos PBR Neutral", "Log", "Film"];
const BOUNCES: [&str; 6] = [
    "total_bounces",
    "diffuse_bounces",
    "glossy_bounces",
    "transmission_bounces",
    "volume_bounces",
    "transparent_bounces",
];

/// What `scene.json` asks for.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Full angle of the image's larger side, rad.
    pub fov_rad: f64,
    /// Image width, pixels.
    pub width_px: u32,
    /// Image height, pixels.
    pub height_px: u32,
    /// Factor on all values.
    pub film_exposure: f64,
    /// Grey images; else RGB with equal channels.
    pub grey: bool,
    /// 8 or 16.
    pub bits: u8,
    /// The view transform, as far as it is one of a single channel.
    pub transfer: Transfer,
    /// Full angle of the Sun's disc, rad.
    pub sun_angle_rad: f64,
    /// Irradiance that the Sun gives a surface facing it, W m^-2 in Blender's units.
    pub sun_energy: f64,
    /// For each body, its `pass_index`: the number in its mask's name.
    pub pass_indices: Vec<u32>,
}

impl Settings {
    /// Reads `scene.json`; adds to `notes` what of it has no effect here, a sentence each.
    ///
    /// # Errors
    /// A key that is missing, of another kind, or out of its range.
    pub fn read(file: &Path, notes: &mut Vec<String>) -> Result<Self, InputError> {
        let document = read_json(file)?;
        let root = Node::root(file, &document);
        let mut known = vec!["camera_settings", "sun_settings", "body_settings", "rendering_settings"];
        let camera = root.key("camera_settings", "the camera's table")?;
        let sun = root.key("sun_settings", "the Sun's table")?;
        let bodies = bodies(&root)?;
        let numbered: Vec<String> = (1..=bodies.len()).map(|i| format!("body_settings_{i}")).collect();
        known.extend(numbered.iter().map(String::as_str));

        let fov_rad = camera.key("fov", "degrees")?.within(1e-6..=170.0)?.to_radians();
        let side = |key| Ok(camera.key(key, "pixels")?.integer(1..=MOST_PIXELS)? as u32);
        let (width_px, height_px) = (side("res_x")?, side("res_y")?);
        let film_exposure = camera.key("film_exposure", "a number above 0")?.positive()?;
        let grey = choice(&camera, "sensor", &["BW", "RGB"])? == "BW";
        let bits = if choice(&camera, "bit_encoding", &["8", "16"])? == "8" { 8 } else { 16 };
        let transfer = transfer(&camera, notes)?;
        sun.name_unknown(&["angle", "energy"], notes)?;
        let settings = Self {
            fov_rad,
            width_px,
            height_px,
            film_exposure,
            grey,
            bits,
            transfer,
            sun_angle_rad: sun.key("angle", "degrees")?.within(0.0..=89.0)?.to_radians(),
            sun_energy: sun.key("energy", "a number above 0")?.positive()?,
            pass_indices: pass_indices(&bodies, notes)?,
        };
        unused_of_camera(&camera, &settings, notes)?;
        unused_of_rendering(&root, notes)?;
        root.name_unknown(&known, notes)?;
        Ok(settings)
    }

    /// Blender's camera as a pinhole: square pixels, the field of view along the larger side, the
    /// principal point in the middle.
    pub fn pinhole(&self) -> Pinhole {
        let (width, height) = (f64::from(self.width_px), f64::from(self.height_px));
        let focal_px = 0.5 * width.max(height) / (0.5 * self.fov_rad).tan();
        Pinhole {
            fx_px: focal_px,
            fy_px: focal_px,
            cx_px: 0.5 * width,
            cy_px: 0.5 * height,
            width_px: self.width_px,
            height_px: self.height_px,
        }
    }

    /// The values of Blender's image: a Lambert surface of albedo a under a Sun of strength E has
    /// radiance a E cos i / pi, and I/F = a cos i, so full scale is I/F = pi / (exposure E).
    pub fn display(&self) -> PlainDisplay {
        PlainDisplay {
            gain: self.film_exposure * self.sun_energy / std::f64::consts::PI,
            transfer: self.transfer,
            bits: self.bits,
            channels: if self.grey { 1 } else { 3 },
        }
    }
}

/// The tables `body_settings`, or `body_settings_1` to `body_settings_n`.
fn bodies<'a>(root: &Node<'a>) -> Result<Vec<Node<'a>>, InputError> {
    let single = root.optional("body_settings")?;
    let numbered = root
        .keys()?
        .into_iter()
        .filter(|key| key.strip_prefix("body_settings_").is_some_and(|n| n.parse::<u32>().is_ok()));
    let count = numbered.count();
    match (single, count) {
        (Some(body), 0) => Ok(vec![body]),
        (None, 0) => {
            root.key("body_settings", "a body's table, or `body_settings_1`, `body_settings_2`, ...")?;
            Ok(Vec::new())
        }
        (Some(_), _) => Err(root
            .error("the bodies' settings are given in two ways")
            .found("`body_settings` and `body_settings_1`")
            .expected("one of the two")),
        (None, count) => {
            (1..=count).map(|i| root.key(&format!("body_settings_{i}"), "the table of this body")).collect()
        }
    }
}

fn choice<'a>(table: &Node<'a>, key: &str, choices: &[&str]) -> Result<&'a str, InputError> {
    let expected = choices.iter().map(|c| format!("\"{c}\"")).collect::<Vec<_>>().join(" or ");
    let node = table.key(key, &expected)?;
    let text = node.text()?;
    if choices.contains(&text) {
        return Ok(text);
    }
    Err(node
        .error("the value is none of those that are known here")
        .found(format!("\"{}\"", text.escape_default()))
        .expected(expected))
}

fn transfer(camera: &Node<'_>, notes: &mut Vec<String>) -> Result<Transfer, InputError> {
    let node = camera.key("viewtransform", "\"Standard\" or \"Raw\"")?;
    match node.text()? {
        "Standard" => Ok(Transfer::Srgb),
        "Raw" => Ok(Transfer::Linear),
        other if OTHER_TRANSFORMS.contains(&other) => {
            notes.push(format!(
                "the view transform {other} is not supported; in its place Standard is used (the sRGB curve)"
            ));
            Ok(Transfer::Srgb)
        }
        other => Err(node
            .error("is no view transform of Blender")
            .found(format!("\"{}\"", other.escape_default()))
            .expected("\"Standard\" or \"Raw\"")),
    }
}

fn pass_indices(bodies: &[Node<'_>], notes: &mut Vec<String>) -> Result<Vec<u32>, InputError> {
    let mut indices = Vec::new();
    for (number, body) in bodies.iter().enumerate() {
        let mut known = vec!["pass_index"];
        known.extend(BOUNCES);
        body.name_unknown(&known, notes)?;
        let index = match body.optional("pass_index")? {
            Some(node) => node.integer(0..=32_767)? as u32,
            None => {
                let index = number as u32 + 1;
                notes.push(format!("guessed: `{}.pass_index` = {index}", body.path));
                index
            }
        };
        indices.push(index);
        let mut bounces = Vec::new();
        for key in BOUNCES {
            if let Some(node) = body.optional(key)?
                && node.integer(0..=1_000_000)? > 0
            {
                bounces.push(key);
            }
        }
        if !bounces.is_empty() {
            notes.push(format!(
                "`{}`: {} above 0 have no effect: light is scattered once",
                body.path,
                bounces.join(", ")
            ));
        }
    }
    Ok(indices)
}

fn unused_of_camera(
    camera: &Node<'_>,
    settings: &Settings,
    notes: &mut Vec<String>,
) -> Result<(), InputError> {
    camera.name_unknown(&CAMERA_KEYS, notes)?;
    for key in ["clip_start", "clip_end"] {
        camera.key(key, "Blender units")?.within(0.0..=f64::MAX)?;
    }
    notes.push("`camera_settings.clip_start` and `clip_end` have no effect: nothing is cut off".into());
    let text = camera.key("K", "a text such as \"[[fx,0,cx],[0,fy,cy],[0,0,1]]\"")?.text()?;
    let numbers: Option<Vec<f64>> = text
        .split(|c: char| "[](), \t\n".contains(c))
        .filter(|word| !word.is_empty() && *word != "np.array" && *word != "array")
        .map(|word| word.parse().ok())
        .collect();
    let focal_px = settings.pinhole().fx_px;
    let differs = match numbers.as_deref() {
        Some([fx, _, cx, _, fy, cy, ..]) => {
            let off = |value: f64, from: f64| (value - from).abs() > 1e-3 * focal_px;
            let pinhole = settings.pinhole();
            off(*fx, focal_px) || off(*fy, focal_px) || off(*cx, pinhole.cx_px) || off(*cy, pinhole.cy_px)
        }
        _ => false,
    };
    notes.push(if differs {
        format!(
            "`camera_settings.K` is not the camera that `fov` and the resolution make (focal length {focal_px:.3} px); \
             as in CORTO, K has no effect"
        )
    } else {
        "`camera_settings.K` has no effect, as in CORTO: `fov` makes the projection".into()
    });
    Ok(())
}

fn unused_of_rendering(root: &Node<'_>, notes: &mut Vec<String>) -> Result<(), InputError> {
    let rendering = root.key("rendering_settings", "the table of the rendering")?;
    rendering.name_unknown(&["engine", "device", "samples", "preview_samples"], notes)?;
    let engine = rendering.key("engine", "\"CYCLES\" or an EEVEE")?.text()?;
    if engine != "CYCLES" {
        notes.push(format!(
            "the engine {} is not imitated: the image is that of physical shading and exact shadows, with \
             `film_exposure` applied as Cycles does",
            engine.escape_default()
        ));
    }
    if let Some(device) = rendering.optional("device")? {
        device.text()?;
    }
    for key in ["samples", "preview_samples"] {
        if let Some(node) = rendering.optional(key)? {
            node.integer(0..=i64::from(i32::MAX))?;
        }
    }
    notes.push(
        "`rendering_settings`: device and samples have no effect; --backend and --quality take their place"
            .into(),
    );
    Ok(())
}
