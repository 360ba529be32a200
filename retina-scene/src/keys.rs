//! The keys of a generated trajectory's table, which are refused one by one.

use std::path::Path;

use glam::DVec3;
use retina_files::InputError;

/// Time between frames, s, where the table has none.
pub(crate) const STEP_S: f64 = 60.0;

/// Whose keys they are.
pub(crate) struct Keys<'a> {
    pub(crate) scene: &'a Path,
    pub(crate) kind: &'static str,
}

impl Keys<'_> {
    pub(crate) fn refuse(&self, key: &str, problem: &str, found: String, expected: &str) -> InputError {
        InputError::new(self.scene, format!("{problem} of the trajectory `{}`", self.kind))
            .at(format!("key `trajectory.{key}`"))
            .found(found)
            .expected(expected)
    }

    pub(crate) fn missing(&self, key: &str, expected: &str) -> InputError {
        InputError::new(self.scene, format!("the trajectory `{}` needs a key", self.kind))
            .at(format!("key `trajectory.{key}`"))
            .expected(expected)
    }

    pub(crate) fn required<T>(&self, key: &str, value: Option<T>, expected: &str) -> Result<T, InputError> {
        value.ok_or_else(|| self.missing(key, expected))
    }

    pub(crate) fn within(
        &self,
        key: &str,
        value: f64,
        [least, most]: [f64; 2],
        unit: &str,
    ) -> Result<f64, InputError> {
        match (least..=most).contains(&value) {
            true => Ok(value),
            false => Err(self.refuse(
                key,
                "the value does not fit that",
                value.to_string(),
                &format!("{least} to {most} {unit}"),
            )),
        }
    }

    pub(crate) fn unit(&self, key: &str, value: [f64; 3]) -> Result<DVec3, InputError> {
        let vector = DVec3::from_array(value);
        let length = vector.length();
        match length > 0.0 && length.is_finite() {
            true => Ok(vector / length),
            false => Err(self.refuse(
                key,
                "the direction has no length: that",
                format!("{value:?}"),
                "a vector that is not 0",
            )),
        }
    }

    pub(crate) fn distance(&self, key: &str, value: f64) -> Result<f64, InputError> {
        self.within(key, value, [1e-3, 1e13], "m")
    }

    pub(crate) fn phase_rad(&self, key: &str, value: f64) -> Result<f64, InputError> {
        Ok(self.within(key, value, [0.0, 180.0], "deg")?.to_radians())
    }
}
