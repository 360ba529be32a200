//! What `retina navigate stars` says of an image.

use retina_navigation::image::ImageResult;
use retina_navigation::planets::PlanetOutcome;

/// One line, and more for what goes with it.
pub(super) fn text(file: &str, result: &ImageResult) -> Vec<String> {
    let solution = match &result.solution {
        Err(refusal) => return vec![format!("{file}: refused: {}", result.refusal(refusal))],
        Ok(solution) => solution,
    };
    let [ra, dec, roll] = solution.ra_dec_roll_rad().map(f64::to_degrees);
    let mut lines = vec![format!(
        "{file}: right ascension {ra:.4} deg, declination {dec:.4} deg, roll {roll:.4} deg; {} stars, {:.2} arcsec rms, \
         focal length {:.1} px{}, false with probability 10^{:.0}; {:.2} ms after {:.2} ms for {} points",
        solution.matches.len(),
        solution.rms_rad.to_degrees() * 3600.0,
        result.camera.pinhole.fx_px * solution.fit.focal_ratio,
        solution.k1_sigma.map_or(String::new(), |_| format!(", k1 {:.4}", solution.fit.k1)),
        solution.log10_false_probability,
        result.solve_ms,
        result.detect_ms,
        result.points.len()
    )];
    if solution.mirrored {
        lines.push(
            "  the image is mirrored left to right: this is the attitude of its mirror image".to_owned(),
        );
    }
    if let Some(sigma) = solution.aspect_sigma {
        let aspect = result.pixel_aspect();
        lines.push(format!("  pixels are {aspect:.4} +- {:.4} times as high as wide", sigma * aspect));
    }
    lines.extend(result.warning().map(|warning| format!("  warning: {warning}")));
    for planet in &result.planets {
        let at = result.points[planet.point].pixel;
        lines.push(format!("  {} at ({:.2}, {:.2}) px", planet.planet.name(), at.x, at.y));
    }
    let silent = |outcome| matches!(outcome, PlanetOutcome::Identified | PlanetOutcome::Outside);
    for verdict in result.planet_verdicts.iter().filter(|verdict| !silent(verdict.outcome)) {
        lines.push(format!("  {} not identified: {}", verdict.expected.planet.name(), verdict.outcome));
    }
    lines
}
