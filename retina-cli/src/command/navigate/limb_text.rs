//! What `retina navigate limb` prints without `--json`.

use retina_navigation::limb::{AmongStars, LimbAnswer, LimbQuestion};

/// What lengths are given in: factor from metres, and unit. An asteroid's tens of kilometres are told in metres.
fn length_unit(length_m: f64) -> (f64, &'static str) {
    if length_m < 1e5 { (1.0, "m") } else { (1e-3, "km") }
}

/// What stars add to it.
pub(super) fn among_text(among: &AmongStars) -> Vec<String> {
    let mut lines = Vec::new();
    if let Ok(solution) = &among.stars.solution {
        let [ra, dec, roll] = solution.ra_dec_roll_rad().map(f64::to_degrees);
        lines.push(format!(
            "  attitude by {} stars: boresight at {ra:.4}, {dec:+.4} deg, roll {roll:.3} deg; residuals {:.1} arcsec rms",
            solution.matches.len(),
            solution.rms_rad.to_degrees() * 3600.0
        ));
    }
    if let Some(place) = &among.place {
        let (per_m, unit) = length_unit(place.from_body_m.length());
        let (at, sigma) = (place.from_body_m * per_m, place.sigma_m() * per_m);
        lines.push(format!(
            "  camera relative to the body, ICRF axes: ({:.1} +- {:.1}, {:.1} +- {:.1}, {:.1} +- {:.1}) {unit}",
            at.x, sigma.x, at.y, sigma.y, at.z, sigma.z
        ));
    }
    lines
}

/// What is printed without `--json`.
pub(super) fn text(file: &str, question: &LimbQuestion, answer: &LimbAnswer) -> Vec<String> {
    let sight = match &answer.sight {
        Err(refusal) => return vec![format!("{file}: refused: {}", question.refusal(refusal, answer))],
        Ok(sight) => sight,
    };
    let solution = &sight.solution;
    let (per_m, unit) = length_unit(sight.range_m[0]);
    let [range, sigma] = sight.range_m.map(|metres| per_m * metres);
    let [x, y, z] = sight.line_of_sight.to_array();
    let axes = solution.ellipse.semi_axes_px;
    let mut lines = vec![
        format!(
            "{file}: {} at ({:.2} +- {:.2}, {:.2} +- {:.2}) px, radius {:.2} +- {:.2} px (semi-axes {:.2}, {:.2}); {} \
             points over {:.0} deg of limb, {:.3} px rms",
            question.body.name,
            sight.center_px.x,
            solution.center_sigma_px.x,
            sight.center_px.y,
            solution.center_sigma_px.y,
            solution.radius_px[0],
            solution.radius_px[1],
            axes[0],
            axes[1],
            solution.points.iter().filter(|point| point.used).count(),
            solution.arc_rad.to_degrees(),
            solution.rms_px,
        ),
        format!(
            "  range {range:.1} +- {sigma:.1} {unit}; line of sight ({x:.6}, {y:.6}, {z:.6}), {:.2} arcsec per axis",
            sight.line_of_sight_sigma_rad().to_degrees() * 3600.0
        ),
        format!(
            "  sigma of the range ({unit}): {}",
            sight
                .range_terms_m()
                .map(|(name, sigma_m)| format!("{} {:.2}", name.replace('_', " "), per_m * sigma_m))
                .join(", ")
        ),
        format!(
            "  limb height {:.0} +- {:.0} m ({})",
            question.body.limb_height_m, question.body.limb_height_sigma_m, question.body.limb_height_source
        ),
        match sight.sun_angle_rad() {
            Some(angle) => format!("  the Sun is at {:.1} deg (0 up, 90 left)", angle.to_degrees()),
            None => "  the whole border is taken for limb: no terminator stands out of it".to_owned(),
        },
    ];
    if let Some(seen) = question.expected {
        lines.push(format!(
            "  expected by the ephemeris: range {:.1} km, which is {:.1} sigma off, radius {:.2} px, phase {:.2} deg",
            1e-3 * seen.distance_m,
            sight.off_sigma(&seen),
            question.expected_radius_px(&seen),
            seen.phase_angle_rad.to_degrees()
        ));
    }
    lines
}
