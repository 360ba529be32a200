//! Setups as the commands read them.

use std::path::Path;

use retina_files::InputError;
use retina_geometry::Setup;

use crate::output::tell;

/// Setups that ship, by name.
const SHIPPED: [(&str, &str); 2] =
    [("wide-fov", retina::assets::WIDE_FOV_SETUP), ("narrow-fov", retina::assets::NARROW_FOV_SETUP)];

/// Reads a setup, and says so where the calibration that it names is not there: a copy of a setup loses it easily, and
/// nothing but a compensating command would notice.
///
/// The name of a setup that ships stands for it, where no file (a folder is none) has that name; the calibration that it names is a file, and
/// is left out.
pub(crate) fn read_setup(path: &Path) -> Result<Setup, InputError> {
    if let Some((name, text)) = SHIPPED.iter().find(|(name, _)| Path::new(name) == path)
        && !path.is_file()
    {
        let mut setup = Setup::parse(text, format!("{name}.toml").as_ref())?;
        setup.calibration.file = None;
        return Ok(setup);
    }
    let setup = Setup::read(path).map_err(|error| {
        let names = SHIPPED.map(|(name, _)| name);
        let is_name = !path.exists() && path.extension().is_none() && path.components().count() == 1;
        if is_name { error.help(format!("setups that ship: {}", names.join(", "))) } else { error }
    })?;
    if let Some(missing) = setup.calibration_path().filter(|file| !file.exists()) {
        tell!(
            "warning: {}: key `calibration.file` names {}, which is not there (paths are relative to the setup)",
            path.display(),
            missing.display()
        );
    }
    Ok(setup)
}
