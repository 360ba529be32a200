//! A scene's trajectory about its one body, from the keys of the table.

use std::path::Path;

use retina_files::InputError;
use retina_sky::Trajectory;
use retina_sky::ephemeris::Ephemeris;
use retina_sky::near_body::{CameraPath, NearBody, Spin};

use crate::file::{GeneratedTable, GeneratorKind, SpinTable};
use crate::keys::{Keys, STEP_S};
use crate::sequence::epoch_s;

const AU_M: f64 = 149_597_870_700.0;
const HOUR_S: f64 = 3600.0;

/// The trajectory. With stars the ephemeris says where the Sun is, and all places become barycentric.
///
/// # Errors
/// A key is missing or out of range; the scene has no body, or several; the ephemeris does not reach the epoch.
pub(crate) fn near_body(
    scene: &Path,
    table: &GeneratedTable,
    bodies: &[String],
    stars: Option<&Ephemeris>,
) -> Result<Trajectory, InputError> {
    let keys = Keys { scene, kind: table.kind.name() };
    let [body] = bodies else {
        return Err(InputError::new(scene, format!("the trajectory `{}` is about one body", keys.kind))
            .at("key `trajectory`")
            .found(format!("{} bodies in the scene", bodies.len()))
            .help("write the table with `retina trajectory --scene` for one of them, add the others' columns, and name the table here"));
    };
    let path = path(&keys, table)?;
    let sun_direction = keys.unit("sun_direction", table.sun_direction.unwrap_or([1.0, 0.0, 0.0]))?;
    let sun_au = keys.within("sun_distance_au", table.sun_distance_au.unwrap_or(1.0), [1e-3, 1e3], "au")?;
    let epoch_tdb_s = table.epoch.as_ref().map_or(Ok(0.0), |text| epoch_s(scene, "epoch", text))?;
    let wanted = NearBody {
        body: body.clone(),
        path,
        frames: table.frames,
        step_s: keys.within("step_s", table.step_s.unwrap_or(STEP_S), [1e-6, 1e9], "s")?,
        epoch_tdb_s,
        sun_m: sun_au * AU_M * sun_direction,
        normal: keys.unit("normal", table.normal.unwrap_or([0.0, 0.0, 1.0]))?,
        spin: table.spin.as_ref().map(|spin| read_spin(&keys, spin)).transpose()?,
    };
    let mut made = wanted.generate();
    if let Some(ephemeris) = stars {
        for frame in &mut made.frames {
            let sky = ephemeris
                .solar_system(frame.time_s)
                .map_err(|error| InputError::new(scene, error.to_string()).at("key `trajectory.epoch`"))?;
            // The Sun is where it is; body and camera are about it.
            let moved_m = sky.sun.position_m - wanted.sun_m;
            frame.camera_position_m += moved_m;
            frame.sun_position_m = Some(sky.sun.position_m);
            for pose in frame.bodies.values_mut() {
                pose.position_m += moved_m;
            }
        }
    }
    Ok(made)
}

fn path(keys: &Keys<'_>, table: &GeneratedTable) -> Result<CameraPath, InputError> {
    let distance = || {
        let value =
            keys.required("distance_m", table.distance_m, "the distance from the body's centre, m")?;
        keys.distance("distance_m", value)
    };
    let phase_rad = |otherwise: f64| keys.phase_rad("phase_deg", table.phase_deg.unwrap_or(otherwise));
    Ok(match table.kind {
        GeneratorKind::Orbit => {
            let period_h = keys.required("period_h", table.period_h, "the time of a revolution, h")?;
            CameraPath::Orbit {
                distance_m: distance()?,
                period_s: HOUR_S * keys.within("period_h", period_h, [1e-6, 1e7], "h")?,
                start_rad: keys
                    .within("start_deg", table.start_deg.unwrap_or(0.0), [-360.0, 360.0], "deg")?
                    .to_radians(),
            }
        }
        GeneratorKind::Flyby => {
            let closest_m =
                keys.required("closest_m", table.closest_m, "the least distance from the body's centre, m")?;
            let speed_m_s = keys.required("speed_m_s", table.speed_m_s, "the speed, m s^-1")?;
            CameraPath::Flyby {
                closest_m: keys.distance("closest_m", closest_m)?,
                speed_m_s: keys.within("speed_m_s", speed_m_s, [1e-9, 3e8], "m s^-1")?,
                phase_rad: phase_rad(45.0)?,
                direction: table.direction.map(|value| keys.unit("direction", value)).transpose()?,
            }
        }
        GeneratorKind::Approach => {
            let [first, last] = keys.required(
                "distances_m",
                table.distances_m,
                "the first and the last distance from the body's centre, m",
            )?;
            CameraPath::Approach {
                distances_m: [keys.distance("distances_m", first)?, keys.distance("distances_m", last)?],
                phase_rad: phase_rad(45.0)?,
            }
        }
        _ => {
            let [first, last] = table.phases_deg.unwrap_or([0.0, 150.0]);
            CameraPath::PhaseSweep {
                distance_m: distance()?,
                phases_rad: [keys.phase_rad("phases_deg", first)?, keys.phase_rad("phases_deg", last)?],
            }
        }
    })
}

fn read_spin(keys: &Keys<'_>, spin: &SpinTable) -> Result<Spin, InputError> {
    if spin.period_h == 0.0 || !spin.period_h.is_finite() {
        return Err(keys.refuse(
            "spin.period_h",
            "the value does not fit that",
            spin.period_h.to_string(),
            "hours, not 0",
        ));
    }
    let angle = |key: &str, value: f64, most: f64| {
        keys.within(&format!("spin.{key}"), value, [-most, most], "deg").map(f64::to_radians)
    };
    Ok(Spin {
        pole_rad: [
            angle("pole_ra_deg", spin.pole_ra_deg, 360.0)?,
            angle("pole_dec_deg", spin.pole_dec_deg, 90.0)?,
        ],
        w_rad: angle("w_deg", spin.w_deg, 360.0)?,
        period_s: HOUR_S * spin.period_h,
    })
}
