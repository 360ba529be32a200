//! What a display must not be asked to show, and for how long.

use std::path::{Path, PathBuf};

use retina_files::InputError;
use serde::Deserialize;

/// Limits of a display, table `screen.limits` of a setup. None by default.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ScreenLimits {
    /// Largest digital count of a pixel.
    pub most_count: u8,
    /// Largest mean of (count / 255)^gamma over pixels and channels: what the panel's supply and its heat allow.
    pub most_mean_light: f64,
    /// Longest time that a frame stays lit while nobody photographs it, s; then the display goes dark.
    pub longest_s: Option<f64>,
    /// Burn-in budget: hours at count 255 that any place may shine in all, whatever its counts were, weighted by their
    /// light.
    pub budget_h: Option<f64>,
    /// Folder in which what was shown adds up, relative to the setup's file.
    pub log: Option<PathBuf>,
}

impl Default for ScreenLimits {
    fn default() -> Self {
        Self { most_count: 255, most_mean_light: 1.0, longest_s: None, budget_h: None, log: None }
    }
}

impl ScreenLimits {
    pub(crate) fn check(&self, path: &Path) -> Result<(), InputError> {
        for (key, value, (least, most)) in [
            ("most_count", f64::from(self.most_count), (1.0, 255.0)),
            ("most_mean_light", self.most_mean_light, (1e-4, 1.0)),
            ("longest_s", self.longest_s.unwrap_or(1.0), (1.0, 1e6)),
            ("budget_h", self.budget_h.unwrap_or(1.0), (1e-6, 1e6)),
        ] {
            if !(least..=most).contains(&value) {
                return Err(InputError::new(path, "the value is out of range")
                    .at(format!("key `screen.limits.{key}`"))
                    .found(value)
                    .expected(format!("{least} to {most}")));
            }
        }
        if self.budget_h.is_some() && self.log.is_none() {
            return Err(InputError::new(path, "a burn-in budget needs a log that adds up what was shown")
                .at("table `screen.limits`")
                .expected("`log`, a folder relative to the setup, beside `budget_h`"));
        }
        Ok(())
    }

    /// Largest count that the whole display may show at once, for an exponent of its response.
    pub fn most_even_count(&self, gamma: f64) -> u8 {
        // Rounded down, with room for the rounding of the power.
        let even = (255.0 * self.most_mean_light.powf(1.0 / gamma) + 1e-9).floor();
        (even as u8).min(self.most_count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_even_frame_is_within_the_mean() {
        let limits = ScreenLimits { most_mean_light: 0.2, ..ScreenLimits::default() };
        let even = f64::from(limits.most_even_count(2.2));
        assert!((even / 255.0).powf(2.2) <= 0.2 && ((even + 1.0) / 255.0).powf(2.2) > 0.2);
        assert_eq!(ScreenLimits::default().most_even_count(2.2), 255);
        assert_eq!(ScreenLimits { most_count: 90, ..limits }.most_even_count(2.2), 90);
    }

    #[test]
    fn a_budget_without_a_log_is_refused() {
        let path = Path::new("setup.toml");
        let budget = ScreenLimits { budget_h: Some(100.0), ..ScreenLimits::default() };
        assert!(budget.check(path).unwrap_err().to_string().contains("`log`"));
        assert!(ScreenLimits { log: Some("log".into()), ..budget }.check(path).is_ok());
        let dark = ScreenLimits { most_count: 0, ..ScreenLimits::default() };
        assert!(dark.check(path).unwrap_err().to_string().contains("screen.limits.most_count"));
    }
}
