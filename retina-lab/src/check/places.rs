//! Places: which way round the image is, how far off, and how sharp.

use std::path::Path;

use glam::DVec2;
use retina_calibration::geometry::{Pattern, PatternOptions, match_points};
use retina_campaign::screen_image;
use retina_geometry::Setup;
use retina_image::{DetectOptions, LightPoint, detect_points};

use super::{Finding, Grade, median, write};
use crate::spots::{COARSE, model_spots};
use crate::{LabError, Rig, Turns, find_exposure};

const POINTS: usize = 400;
/// Shift of the image that a calibration takes up, and that costs field, camera px.
const SHIFT_PX: [f64; 2] = [8.0, 60.0];
/// The same for its turn, deg.
const ROLL_DEG: [f64; 2] = [0.3, 5.0];
/// ... and for its scale, of itself.
const SCALE: [f64; 2] = [0.01, 0.05];

/// A similarity: seen = shift + scale * turn * expected, mirrored first where the image is.
struct Similarity {
    shift_px: DVec2,
    roll_deg: f64,
    scale: f64,
}

impl Similarity {
    /// By least squares, about the image's centre.
    fn fit(pairs: &[(DVec2, DVec2)], centre: DVec2) -> Self {
        let count = pairs.len() as f64;
        let from = pairs.iter().map(|pair| pair.0).sum::<DVec2>() / count;
        let to = pairs.iter().map(|pair| pair.1).sum::<DVec2>() / count;
        let (mut along, mut across, mut squares) = (0.0, 0.0, 0.0);
        for (expected, seen) in pairs {
            let (a, b) = (*expected - from, *seen - to);
            along += a.dot(b);
            across += a.perp_dot(b);
            squares += a.length_squared();
        }
        let turned = DVec2::new(along, across) / squares;
        Self {
            shift_px: to + turned.rotate(centre - from) - centre,
            roll_deg: turned.y.atan2(turned.x).to_degrees(),
            scale: turned.length(),
        }
    }
}

pub(super) fn places(setup: &Setup, rig: &mut Rig<'_>, out: &Path) -> Result<Vec<Finding>, LabError> {
    let wanted =
        PatternOptions { points: POINTS, screens: Some(1), counts: vec![255], ..PatternOptions::default() };
    let pattern = Pattern::make(setup, &wanted)?;
    let image = screen_image(&pattern.screens[0], setup.screen.width_px, setup.screen.height_px);
    let exposure_s = find_exposure(rig, &image, 0.01)?;
    rig.show(&image)?;
    let taken = rig.take(exposure_s)?.image;
    write(&taken, &out.join("pattern.png"))?;
    let points = detect_points(&taken, &DetectOptions::default()).points;
    let (rows, recognition) = match_points(0, 0, &pattern, setup, &points);
    let Some(recognition) = recognition else {
        let found = format!("{} spots are seen, and not the pattern of {POINTS} points", points.len());
        let mend = "turn the focus by hand until spots are small; does the camera see the whole screen, pixel for pixel? \
                    Look at pattern.png";
        return Ok(vec![
            Finding::new("pattern", Grade::Bad, found, mend).with(&[("spots", points.len() as f64)]),
        ]);
    };
    let seen = rows.len() as f64 / POINTS as f64;
    let mut findings = vec![
        Finding::new(
            "pattern",
            Grade::of(1.0 - seen, 0.6, 0.9),
            format!("{} of {POINTS} points are seen", rows.len()),
            "is a part of the screen out of focus or covered? Look at pattern.png",
        )
        .with(&[("seen", rows.len() as f64)]),
        Finding::new(
            "mirror",
            if recognition.mirrored { Grade::Bad } else { Grade::Good },
            if recognition.mirrored { "the image is mirrored" } else { "none" }.to_owned(),
            "switch off mirroring in the camera or the display; or is there a mirror more or less in the path?",
        ),
    ];
    let (facility, camera) = (setup.facility_pinhole(), setup.camera_pinhole());
    let centre = DVec2::new(camera.cx_px, camera.cy_px);
    let expected = |screen_px: DVec2| {
        let at = camera.pixel(facility.line_of_sight(screen_px));
        if recognition.mirrored { DVec2::new(2.0 * centre.x - at.x, at.y) } else { at }
    };
    let pairs: Vec<(DVec2, DVec2)> =
        rows.iter().map(|row| (expected(row.screen_px), row.camera_px)).collect();
    let found = Similarity::fit(&pairs, centre);
    let (shift, roll, scale) = (found.shift_px, found.roll_deg, found.scale - 1.0);
    let turns = "`retina lab align` says which screw";
    findings.push(
        Finding::new(
            "centring",
            Grade::of(shift.length(), SHIFT_PX[0], SHIFT_PX[1]),
            format!("the image is off by {:+.1}, {:+.1} camera px", shift.x, shift.y),
            &format!("shift the screen or turn the camera; {turns}"),
        )
        .with(&[("x_px", shift.x), ("y_px", shift.y)]),
    );
    findings.push(
        Finding::new(
            "roll",
            Grade::of(roll.abs(), ROLL_DEG[0], ROLL_DEG[1]),
            format!("{roll:+.2} deg"),
            &format!("roll the camera; {turns}. Near 180 deg: the screen or the camera is upside down"),
        )
        .with(&[("roll_deg", roll)]),
    );
    findings.push(
        Finding::new(
            "scale",
            Grade::of(scale.abs(), SCALE[0], SCALE[1]),
            format!("{:+.2} %", 100.0 * scale),
            "does the setup state the focal lengths and the pixel sizes that are there? Does the display scale?",
        )
        .with(&[("scale", scale)]),
    );
    findings.extend(focus(
        setup,
        &pattern,
        &points,
        &rows.iter().map(|row| row.camera_px).collect::<Vec<_>>(),
    )?);
    Ok(findings)
}

/// The spots' width beside the design's.
fn focus(
    setup: &Setup,
    pattern: &Pattern,
    points: &[LightPoint],
    seen: &[DVec2],
) -> Result<Option<Finding>, LabError> {
    let image = screen_image(&pattern.screens[0], setup.screen.width_px, setup.screen.height_px);
    let Some(design) = model_spots(setup, pattern, &image, &Turns::default(), COARSE)? else {
        return Ok(None);
    };
    let wanted_px = median(design.iter().flatten().map(|spot| spot.variance_px2.sqrt()));
    let is_seen = |point: &&LightPoint| seen.iter().any(|at| (at.x, at.y) == (point.x_px, point.y_px));
    let width_px = median(points.iter().filter(is_seen).filter_map(|point| point.width_px));
    let ratio = width_px / wanted_px;
    Ok(Some(
        Finding::new(
            "focus",
            Grade::of(ratio, 1.15, 2.5),
            format!("spots of {width_px:.2} px (standard deviation), the design has {wanted_px:.2}"),
            "move the screen along the axis; `retina lab align` says how far",
        )
        .with(&[("width_px", width_px), ("expected_px", wanted_px)]),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_similarity_comes_back() {
        let centre = DVec2::new(1024.0, 768.0);
        let turn = DVec2::from_angle(0.02) * 1.01;
        let pairs: Vec<(DVec2, DVec2)> = (0..30)
            .map(|k| {
                let at = centre + DVec2::new(700.0 * f64::from(k).sin(), 500.0 * f64::from(3 * k).cos());
                (at, centre + DVec2::new(4.0, -7.0) + turn.rotate(at - centre))
            })
            .collect();
        let found = Similarity::fit(&pairs, centre);
        assert!((found.shift_px - DVec2::new(4.0, -7.0)).length() < 1e-9, "{}", found.shift_px);
        assert!((found.roll_deg - 0.02f64.to_degrees()).abs() < 1e-9 && (found.scale - 1.01).abs() < 1e-12);
    }
}
