//! Setups as the commands read them.

use std::path::Path;

use retina::assets::SETUPS;
use retina_files::InputError;
use retina_geometry::Setup;

use crate::output::tell;

/// Reads a setup, and says so where the calibration that it names is not there: a copy of a setup loses it easily, and
/// nothing but a compensating command would notice.
///
/// The name of a setup that ships stands for it where no file has that name; a folder may. The calibration that it names
/// is a file, and is left out.
pub(crate) fn read_setup(path: &Path) -> Result<Setup, InputError> {
    if let Some((name, text)) = SETUPS.iter().find(|(name, _)| Path::new(name) == path)
        && !path.is_file()
    {
        let mut setup = Setup::parse(text, format!("{name}.toml").as_ref())?;
        setup.calibration.file = None;
        return Ok(setup);
    }
    let setup = Setup::read(path).map_err(|error| {
        let names = SETUPS.map(|(name, _)| name);
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
