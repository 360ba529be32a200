//! Setups as the commands read them.

use std::path::Path;

use retina_files::InputError;
use retina_geometry::Setup;

use crate::output::tell;

/// Reads a setup, and says so where the calibration that it names is not there: a copy of a setup loses it easily, and
/// nothing but a compensating command would notice.
///
/// The name of a setup that ships stands for it where no file has that name; a folder may. The calibration that it names
/// is a file, and is left out.
pub(crate) fn read_setup(path: &Path) -> Result<Setup, InputError> {
    let setup = Setup::named(path, Path::new(""))?;
    if let Some(missing) = setup.calibration_path().filter(|file| !file.exists()) {
        tell!(
            "warning: {}: key `calibration.file` names {}, which is not there (paths are relative to the setup)",
            path.display(),
            missing.display()
        );
    }
    Ok(setup)
}
