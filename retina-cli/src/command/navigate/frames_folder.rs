//! What `navigate full-disk` and `navigate flashes` take alike: a folder of rendered frames, or a scenario.

use std::path::{Path, PathBuf};

use retina_batch::{FrameRange, Selection, Shard};
use retina_experiments::full_disk::{ImageKind, SourceChoice};
use retina_experiments::lines::list_name;
use retina_files::InputError;
use retina_navigation::limb::LimbOptions;
use serde_json::{Value, json};

use super::steps::{results_folder, results_name, write};
use crate::command::Backend;
use crate::failure::Failure;
use crate::output::{print_json, print_lines};

#[derive(clap::Args)]
pub(crate) struct FramesFolder {
    /// Folder that `retina render` wrote, or TOML file of a scenario for the whole experiment.
    #[arg(value_name = "DIR|SCENARIO.toml")]
    pub(crate) input: PathBuf,
    /// Folder of camera images of the screens, as `retina simulate frames` writes it.
    #[arg(long, value_name = "FOLDER")]
    pub(crate) images: Option<PathBuf>,
    /// Facility, schema retina.setup/1.
    #[arg(long, value_name = "FILE")]
    pub(crate) setup: Option<PathBuf>,
    /// Calibration of the facility.
    ///
    /// Give it for camera images that still contain the facility's distortion, or for screen images
    /// that were rendered with it.
    #[arg(long, value_name = "FILE")]
    calibration: Option<PathBuf>,
    /// Body to measure [default: the only one].
    #[arg(long, value_name = "NAME")]
    body: Option<String>,
    /// Use only frames A to B, counted from 0; B is excluded.
    #[arg(long, value_name = "A..B", allow_hyphen_values = true)]
    frames: Option<FrameRange>,
    /// Use only the frames whose number is I modulo N; of a scenario, every N-th of its frames from its I-th on.
    ///
    /// Run all shards of a scenario into one folder. Then run the command without --shard into that
    /// folder: it gives the whole result.
    #[arg(long, value_name = "I/N", allow_hyphen_values = true)]
    pub(crate) shard: Option<Shard>,
    /// Renderer for a scenario.
    #[arg(long, value_enum, default_value_t)]
    pub(crate) backend: Backend,
    /// Print a JSON document on standard output.
    #[arg(long)]
    json: bool,
    /// Also write a report page with plots.
    #[arg(long, value_name = "FILE.html")]
    pub(crate) report: Option<PathBuf>,
    /// Folder for the results. Frames that are already in it are not measured again.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
}

impl FramesFolder {
    /// Whether a scenario is given and no folder; the page's name is checked on the way.
    pub(crate) fn is_scenario(&self) -> Result<bool, Failure> {
        self.report.as_ref().map_or(Ok(()), |path| crate::check_file(path, "html"))?;
        Ok(self.input.extension().is_some_and(|extension| extension == "toml"))
    }

    /// The folder for a scenario's frames and results. Of a folder's flags, these and the command's `own`, none may be
    /// given with a scenario.
    pub(crate) fn scenario_out(&self, own: &[(&str, bool)]) -> Result<&Path, Failure> {
        let named = [
            ("--images", self.images.is_some()),
            ("--setup", self.setup.is_some()),
            ("--calibration", self.calibration.is_some()),
            ("--body", self.body.is_some()),
            ("--frames", self.frames.is_some()),
        ];
        if let Some((flag, _)) = named.iter().chain(own).find(|(_, given)| *given) {
            return Err(InputError::new(Path::new(flag), "belongs to a folder of frames")
                .found(self.input.display())
                .help("leave it out: the scenario or its scene sets this by its own keys")
                .into());
        }
        self.out
            .as_deref()
            .ok_or_else(|| Failure::new("a scenario needs --out: the folder for its frames and results"))
    }

    /// What a scenario's shard did, once it is done.
    pub(crate) fn print_part(&self, out: &Path, part: Shard, frames: usize) -> Result<(), Failure> {
        let document = json!({
            "schema": "retina.part/1",
            "out": out,
            "shard": format!("{}/{}", part.index, part.count),
            "frames": frames,
        });
        self.print(&document, &[format!("shard {} of {}: {frames} frames are done", part.index, part.count)])
    }

    /// The frames that are meant.
    pub(crate) fn choice(
        &self,
        kind: Option<ImageKind>,
        limb: LimbOptions,
        pointing_sigma_rad: f64,
    ) -> SourceChoice {
        SourceChoice {
            dir: self.input.clone(),
            images: self.images.clone(),
            kind,
            setup: self.setup.clone(),
            calibration: self.calibration.clone(),
            body: self.body.clone(),
            selection: Selection { range: self.frames, every: None, shard: self.shard },
            limb,
            silhouette: None,
            pointing_sigma_rad,
        }
    }

    /// Where measured frames are kept; the folder is made.
    pub(crate) fn frames_list(&self) -> Result<Option<PathBuf>, InputError> {
        let Some(out) = &self.out else { return Ok(None) };
        results_folder(out, &self.input)?;
        Ok(Some(out.join(list_name("frames", self.shard))))
    }

    /// What the results are called.
    pub(crate) fn label(&self) -> String {
        self.input.file_name().map_or("images".into(), |name| name.to_string_lossy()).into_owned()
    }

    /// Writes a folder's results, where they have a place; a part does not take the whole's.
    pub(crate) fn write_results(&self, stem: &str, files: &[(&str, &str)]) -> Result<(), Failure> {
        let Some(out) = &self.out else { return Ok(()) };
        let name = results_name(stem, self.frames, self.shard);
        files.iter().try_for_each(|(extension, text)| write(out, &format!("{name}.{extension}"), text))
    }

    /// Prints the document, or lines for people.
    pub(crate) fn print(&self, document: &Value, lines: &[String]) -> Result<(), Failure> {
        if self.json { print_json(document) } else { print_lines(lines) }
    }
}
