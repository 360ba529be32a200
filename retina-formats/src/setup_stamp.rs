//! Which setup a table was measured with: a comment line that tables carry.

use std::path::Path;

use retina_files::{InputError, hash_bytes};
use retina_geometry::Setup;

/// Name of a setup and a hash of what its measurements depend on: screen, camera and K_f.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SetupStamp {
    /// The setup's name.
    pub name: String,
    /// First 16 hexadecimal digits of a BLAKE3 over screen, camera and K_f. Noise, lenses and response may change.
    pub hash: String,
}

/// What the comment line begins with.
const MARK: &str = "# retina setup: ";

impl SetupStamp {
    /// Of a setup.
    pub fn of(setup: &Setup) -> Self {
        let (k, c) = (setup.facility_pinhole(), setup.camera_pinhole());
        let screen = &setup.screen;
        let text = format!(
            "{:.6} {:.6} {:.6} {:.6} {} {} {:.9} {:.9} | {:.6} {:.6} {} {}",
            k.fx_px,
            k.fy_px,
            k.cx_px,
            k.cy_px,
            k.width_px,
            k.height_px,
            screen.width_mm,
            screen.height_mm,
            c.fx_px,
            c.fy_px,
            c.width_px,
            c.height_px
        );
        Self { name: setup.name.clone(), hash: hash_bytes(text.as_bytes())[..16].to_owned() }
    }

    /// The comment line, with its end.
    pub fn line(&self) -> String {
        format!("{MARK}{} {}\n", self.hash, self.name.replace(['\n', '\r'], " "))
    }

    /// The stamp in a table's leading comments, where it has one.
    ///
    /// # Errors
    /// The comment is damaged.
    pub fn of_text(path: &Path, text: &str) -> Result<Option<Self>, InputError> {
        let comments = text.trim_start_matches('\u{feff}').lines().take_while(|line| line.starts_with('#'));
        for (number, line) in comments.enumerate() {
            let Some(rest) = line.strip_prefix(MARK) else { continue };
            let Some((hash, name)) = rest.split_once(' ').filter(|(hash, _)| hash.len() == 16) else {
                return Err(InputError::new(path, "the comment that names the setup is damaged")
                    .line(number + 1)
                    .found(format!("`{line}`"))
                    .expected(format!("`{MARK}` with 16 hexadecimal digits and a name"))
                    .help("delete the line if the setup is known to be right"));
            };
            return Ok(Some(Self { name: name.trim().to_owned(), hash: hash.to_owned() }));
        }
        Ok(None)
    }

    /// Refuses a table that says it was measured with another setup.
    ///
    /// # Errors
    /// It says so.
    pub fn check(&self, path: &Path, setup: &Setup) -> Result<(), InputError> {
        let expected = Self::of(setup);
        if *self == expected {
            return Ok(());
        }
        let problem = if self.name == expected.name {
            "the table was measured before the setup was changed"
        } else {
            "the table was measured with another setup"
        };
        Err(InputError::new(path, problem)
            .at("comment `# retina setup`")
            .found(format!("`{}` ({})", self.name, self.hash))
            .expected(format!("`{}` ({}), from {}", expected.name, expected.hash, setup.file.display()))
            .help("give the setup of the measurement; the hash is over screen, camera and K_f. Delete the comment to compare all the same"))
    }
}
