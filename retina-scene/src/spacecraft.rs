//! A scene's trajectory that SPICE kernels hold: a spacecraft, its camera's axes, and the bodies that it sees.

use std::path::Path;

use retina_files::InputError;
use retina_sky::Trajectory;
use retina_sky::ephemeris::Ephemeris;
use retina_sky::spacecraft::{Pointing, SpacecraftFrames, camera_from_axes};

use crate::file::GeneratedTable;
use crate::keys::{Keys, STEP_S};
use crate::sequence::epoch_s;

/// The trajectory.
///
/// # Errors
/// A key is missing or does not fit; the kernels lack the spacecraft, a body, or their axes at an epoch.
pub(crate) fn spacecraft(
    scene: &Path,
    table: &GeneratedTable,
    bodies: &[String],
    ephemeris: &Ephemeris,
) -> Result<Trajectory, InputError> {
    let keys = Keys { scene, kind: table.kind.name() };
    let observer = keys.required(
        "observer",
        table.observer.clone(),
        "the spacecraft: a name that a kernel gives, or NAIF's number as text, such as \"-226\"",
    )?;
    let epoch = keys.required("epoch", table.epoch.as_ref(), "the time of the first frame")?;
    let axes = table.axes.as_ref().map_or(["+x", "+y", "+z"], |axes| axes.each_ref().map(String::as_str));
    let camera_from_frame = camera_from_axes(axes).ok_or_else(|| {
        keys.refuse(
            "axes",
            "the axes do not fit those",
            format!("{axes:?}"),
            "the frame's axes that are the camera's right, down and boresight, right-handed, such as [\"+x\", \"+y\", \"+z\"]",
        )
    })?;
    let pointing = match &table.frame {
        Some(name) => Pointing::Frame { name: name.clone(), camera_from_frame },
        None if table.axes.is_some() => {
            return Err(keys.missing("frame", "the frame whose axes `axes` names"));
        }
        None if bodies.is_empty() => {
            return Err(keys.missing("frame", "the camera's frame: the scene has no body to point at"));
        }
        None => Pointing::FirstBody,
    };
    let wanted = SpacecraftFrames {
        observer,
        pointing,
        bodies: bodies.to_vec(),
        frames: table.frames,
        step_s: keys.within("step_s", table.step_s.unwrap_or(STEP_S), [1e-6, 1e9], "s")?,
        epoch_tdb_s: epoch_s(scene, "epoch", epoch)?,
    };
    wanted.generate(ephemeris).map_err(|error| {
        let found = InputError::new(scene, error.to_string()).at("key `trajectory`");
        match ephemeris.kernel_files().is_empty() {
            true => found.help("name the kernels in `[ephemeris] kernels`"),
            false => found,
        }
    })
}
