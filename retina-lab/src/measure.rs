//! Measurements that the workbench proposes, carried out: screens, exposures, times, rolls and temperatures of a plan.

use std::path::Path;
use std::time::{Duration, Instant};

use retina_calibration::geometry::{PLAN_FILE, points_from_images};
use retina_files::InputError;
use retina_formats::PointsTable;
use retina_geometry::Setup;
use retina_image::DetectOptions;

use crate::{CaptureOptions, LabError, Planned, Rig, Sequence, Upcoming, capture};

/// A condition that screen and shutter cannot set.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Condition {
    /// The camera's roll in its mount, deg, and how it stood before where that is known.
    Roll {
        /// Before.
        from_deg: Option<f64>,
        /// Wanted.
        to_deg: f64,
    },
    /// The bench's temperature, degC.
    Temperature(f64),
    /// The camera is taken out and mounted anew, for the time of this number.
    Mounting(f64),
    /// The next exposure is due in so many seconds.
    Wait(f64),
}

/// Temperatures that are the same, degC.
const SAME_C: f64 = 0.05;
/// How often a wait looks for an end that the user wants.
const BEAT: Duration = Duration::from_millis(50);

/// Takes the exposures of a round's plan into `round/images` and makes `round/points.csv` of them. `arrange` sets a
/// condition before an exposure where it differs from that of the exposure before, or tells a person to. Where `wait`,
/// exposures are made when the plan says, otherwise one after another. What an interrupted run left is kept.
///
/// # Errors
/// The folder holds no plan, a device fails, the user wants an end, or the images do not show the plan's screens.
pub fn measure_round(
    setup: &Setup,
    rig: &mut Rig<'_>,
    round: &Path,
    wait: bool,
    arrange: &mut dyn FnMut(&mut Rig<'_>, Condition) -> Result<(), LabError>,
    progress: impl FnMut(usize, usize),
) -> Result<PointsTable, LabError> {
    if !round.join(PLAN_FILE).is_file() {
        return Err(InputError::new(round, format!("holds no {PLAN_FILE}"))
            .expected("a round of `retina decide`")
            .help("give the folder `round_01`, or the one that holds the rounds")
            .into());
    }
    let sequence = Sequence::read(round, setup)?;
    let first_s = sequence.frames.first().and_then(|frame| frame.planned.time_s);
    let mut stands: Option<Planned> = None;
    let mut before = |rig: &mut Rig<'_>, next: &Upcoming<'_>| {
        let planned = next.frame.planned;
        for condition in changes(stands.as_ref(), &planned) {
            arrange(rig, condition)?;
        }
        stands = Some(planned);
        if let (true, Some(elapsed_s), Some(first_s), Some(due_s)) =
            (wait, next.elapsed_s, first_s, planned.time_s)
        {
            let left_s = due_s - first_s - elapsed_s;
            if left_s > 0.0 {
                arrange(rig, Condition::Wait(left_s))?;
                let end = Instant::now() + Duration::from_secs_f64(left_s);
                while Instant::now() < end {
                    rig.go_on()?;
                    std::thread::sleep(BEAT.min(end.saturating_duration_since(Instant::now())));
                }
            }
        }
        Ok(())
    };
    capture(&sequence, rig, &CaptureOptions::default(), round, &mut before, progress)?;
    let (table, _) = points_from_images(&round.join("images"), round, setup, &DetectOptions::default())?;
    table.write(&round.join("points.csv"), setup)?;
    Ok(table)
}

/// What is to be set for an exposure, after another one.
fn changes(before: Option<&Planned>, wanted: &Planned) -> Vec<Condition> {
    let mut changes = Vec::new();
    let from_deg = before.and_then(|before| before.camera_roll_deg);
    if let Some(to_deg) = wanted.camera_roll_deg.filter(|to| from_deg != Some(*to)) {
        changes.push(Condition::Roll { from_deg, to_deg });
    } else if let (Some(before), Some(number)) = (before, wanted.mounting)
        && before.mounting != Some(number)
    {
        changes.push(Condition::Mounting(number));
    }
    let was_c = before.and_then(|before| before.temperature_c);
    if let Some(wanted_c) =
        wanted.temperature_c.filter(|wanted| was_c.is_none_or(|was| (was - wanted).abs() > SAME_C))
    {
        changes.push(Condition::Temperature(wanted_c));
    }
    changes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_changes_is_arranged() {
        let at = |roll: f64, temperature: f64, mounting: f64| Planned {
            time_s: Some(0.0),
            temperature_c: Some(temperature),
            camera_roll_deg: Some(roll),
            mounting: Some(mounting),
        };
        let first = changes(None, &at(0.0, 20.0, 0.0));
        assert_eq!(first, [Condition::Roll { from_deg: None, to_deg: 0.0 }, Condition::Temperature(20.0)]);
        assert!(changes(Some(&at(0.0, 20.0, 0.0)), &at(0.0, 20.01, 0.0)).is_empty());
        // A roll is a mounting of its own.
        let rolled = changes(Some(&at(0.0, 20.0, 0.0)), &at(90.0, 20.0, 1.0));
        assert_eq!(rolled, [Condition::Roll { from_deg: Some(0.0), to_deg: 90.0 }]);
        assert_eq!(changes(Some(&at(90.0, 20.0, 1.0)), &at(90.0, 20.0, 2.0)), [Condition::Mounting(2.0)]);
    }
}
