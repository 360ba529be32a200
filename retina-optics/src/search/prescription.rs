//! A design of the search as prescriptions, schema `retina.optics/1`.

use std::fmt::Write as _;

use super::SearchedDesign;
use super::exact::ConfigurationResult;
use super::request::{Configuration, SearchRequest};

impl SearchedDesign {
    /// A prescription for each configuration: its name and the TOML text, which reads back as the system that
    /// the search traced, to the last digit.
    pub fn prescriptions(&self, request: &SearchRequest) -> Vec<(String, String)> {
        let pairs = self.configurations.iter().zip(&request.configurations);
        pairs
            .map(|(result, asked)| (result.name.clone(), self.prescription(result, asked, request)))
            .collect()
    }

    fn prescription(
        &self,
        result: &ConfigurationResult,
        asked: &Configuration,
        request: &SearchRequest,
    ) -> String {
        let mut text = String::new();
        // Writing to a string cannot fail.
        let mut line = |arguments: std::fmt::Arguments<'_>| {
            let _ = writeln!(text, "{arguments}");
        };
        line(format_args!(
            "# Stock-lens search: worst RMS {:.3} um on the sensor, M {:.6}, camera and screen matched by {};",
            self.worst_rms_um,
            result.m,
            request.match_by.words()
        ));
        line(format_args!(
            "# collimator {:.4} mm, relay {:.4} mm at {} nm; s_cam {} mm.",
            self.collimator_efl_mm,
            self.relay_efl_mm,
            request.wavelengths_nm[request.primary()],
            request.pupil_collimator_mm
        ));
        line(format_args!("schema = \"retina.optics/1\"\nname = {}", quoted(&result.name)));
        line(format_args!("clear_fraction = {:?}\n", self.clear_aperture_fraction));
        line(format_args!("[beam]\nentrance_pupil_mm = {:?}", asked.pupil_mm));
        for (i, nm) in request.wavelengths_nm.iter().enumerate() {
            let primary = if i == request.primary() { "\nprimary = true" } else { "" };
            line(format_args!("\n[[wavelength]]\nnm = {nm:?}{primary}"));
        }
        for tan in &asked.field_tans {
            line(format_args!("\n[[field]]\ny_tan = {tan:?}"));
        }
        line(format_args!(
            "\n[[surface]]\nlabel = \"pupil\"\nstop = true\nsemi_diameter_mm = {:?}\nthickness_mm = {:?}",
            asked.pupil_mm / 2.0,
            result.pupil_to_first_vertex_mm
        ));
        // Behind the last lens of each group the configuration says the distance.
        let mut behind =
            [("collimator", result.collimator_to_relay_mm), ("relay", result.relay_to_screen_mm)]
                .into_iter()
                .peekable();
        for lens in &self.lenses {
            let Some(&(group, to_next_mm)) = behind.peek() else { break };
            line(format_args!(
                "\n[[surface]]\npart = {}\nreversed = {}\nthickness_mm = {:?}\ngroup = \"{group}\"",
                quoted(&lens.part),
                lens.reversed,
                lens.gap_after_mm.unwrap_or(to_next_mm)
            ));
            if lens.gap_after_mm.is_none() {
                behind.next();
            }
        }
        line(format_args!("\n[[surface]]\nlabel = \"screen\""));
        text
    }
}

/// A TOML string.
fn quoted(text: &str) -> String {
    // JSON's strings are TOML's basic strings.
    serde_json::Value::from(text).to_string()
}
