//! Frames of text kernels (NAIF, Frames Required Reading): PCK frames (class 2), CK frames (class 3) and fixed offsets
//! (class 4).

use std::f64::consts::PI;

use glam::{DMat3, DQuat, DVec3};
use retina_files::InputError;

use super::bpc::{ECLIPJ2000, J2000};
use super::names;
use super::text::Pool;

/// Most fixed offsets from a body's axes to those that a kernel turns.
const MOST_OFFSETS: usize = 10;
/// How far a matrix or a quaternion may be from a rotation: NAIF's kernels have six digits and more.
const ROTATION_TOLERANCE: f64 = 1e-5;
/// NAIF's number of ITRF93 among the frames, and among the axes of binary PCK kernels. SPICE has it built in.
const ITRF93: [i32; 2] = [13_000, 3000];

/// What turns axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Base {
    /// The inertial axes of this number.
    Inertial(i32),
    /// The axes of this number in binary PCK kernels, or of the body of this number in text ones.
    Pck(i32),
    /// The IAU axes of the body of this number.
    Iau(i32),
    /// The axes of this number in CK kernels.
    Ck(i32),
}

/// A frame down to what turns it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Frame {
    pub(super) name: String,
    pub(super) base: Base,
    /// The rotation from the base's axes to the frame's.
    pub(super) frame_from_base: DQuat,
}

/// Makes an error about a frame: its name, and the problem.
pub(super) type Asked<'a> = &'a dyn Fn(&str, &str) -> InputError;

/// The frame whose number or name this is.
///
/// # Errors
/// The kernels do not define it, or by means that are not read. `asked` says who asked for it.
pub(super) fn frame(pool: &Pool, asked: Asked<'_>, name_or_number: &str) -> Result<Frame, InputError> {
    let (mut at, mut turn) = (name_or_number.to_owned(), DQuat::IDENTITY);
    for _ in 0..MOST_OFFSETS {
        if let Some(base) = built_in(pool, &at) {
            return Ok(Frame { name: name_or_number.to_owned(), base, frame_from_base: turn });
        }
        let Some(number) = number(pool, &at)? else {
            return Err(asked(name_or_number, "the axes are not defined")
                .found(format!("no FRAME_{at}"))
                .expected("a text frame kernel (.tf) that defines them")
                .help("name that kernel too, in a meta-kernel or beside this one"));
        };
        let class_name = format!("FRAME_{number}_CLASS");
        match pool.integer(&class_name)? {
            Some(class @ (2 | 3)) => {
                let id = format!("FRAME_{number}_CLASS_ID");
                let Some(axes) = pool.integer(&id)? else {
                    return Err(asked(&at, "the frame is not complete").found(format!("no {id}")));
                };
                return Ok(Frame {
                    name: name_or_number.to_owned(),
                    base: if class == 2 { Base::Pck(axes) } else { Base::Ck(axes) },
                    frame_from_base: turn,
                });
            }
            Some(4) => {
                let (relative_from_frame, relative) = offset(pool, asked, number, &at)?;
                turn *= relative_from_frame.inverse();
                at = relative;
            }
            Some(class) => {
                return Err(pool.variables[&class_name]
                    .error(&class_name, "frames of this class are not read")
                    .found(class)
                    .expected("2 (PCK), 3 (CK) or 4 (a fixed offset)")
                    .help("give these axes as columns of the trajectory"));
            }
            None => {
                return Err(asked(&at, "the frame is not complete").found(format!("no {class_name}")));
            }
        }
    }
    Err(asked(name_or_number, "the offsets of the frame do not end")
        .expected(format!("{MOST_OFFSETS} at most")))
}

/// The number of a frame by its name, or its number as text.
fn number(pool: &Pool, name: &str) -> Result<Option<i32>, InputError> {
    match name.parse::<i32>() {
        Ok(number) => Ok(Some(number)),
        // Names of frames are the same in small letters.
        Err(_) => match pool.integer(&format!("FRAME_{name}"))? {
            None => pool.integer(&format!("FRAME_{}", name.to_ascii_uppercase())),
            number => Ok(number),
        },
    }
}

/// Frames that SPICE has without a kernel.
fn built_in(pool: &Pool, name: &str) -> Option<Base> {
    match name {
        "J2000" | "1" => Some(Base::Inertial(J2000)),
        "ECLIPJ2000" | "17" => Some(Base::Inertial(ECLIPJ2000)),
        "ITRF93" | "13000" => Some(Base::Pck(ITRF93[1])),
        _ if pool.variables.contains_key(&format!("FRAME_{name}")) => None,
        _ => names::number(pool, name.strip_prefix("IAU_")?).map(Base::Iau),
    }
}

/// The body whose axes the axes of a binary PCK kernel are where no frame says so: ITRF93, and the Moon's
/// principal axes of the DE ephemerides (31001 to 31999).
pub(super) fn body_of_axes(axes: i32) -> Option<(i32, &'static str)> {
    match axes {
        3000 => Some((399, "ITRF93")),
        31_001..=31_999 => Some((301, "MOON_PA")),
        _ => None,
    }
}

/// The rotation from a frame of class 4 to the one that it is relative to, and that one's name.
fn offset(pool: &Pool, asked: Asked<'_>, number: i32, name: &str) -> Result<(DQuat, String), InputError> {
    let of = |item: &str| {
        let by_number = format!("TKFRAME_{number}_{item}");
        if pool.variables.contains_key(&by_number) { by_number } else { format!("TKFRAME_{name}_{item}") }
    };
    let missing =
        |item: &str| asked(name, "the fixed offset is not complete").found(format!("no {}", of(item)));
    let relative = pool.text(&of("RELATIVE"))?.ok_or_else(|| missing("RELATIVE"))?.to_owned();
    let spec = pool.text(&of("SPEC"))?.ok_or_else(|| missing("SPEC"))?.to_ascii_uppercase();
    let numbers =
        |item: &str, count: usize| pool.numbers(&of(item), count..=count)?.ok_or_else(|| missing(item));
    let no_rotation = |item: &str| {
        pool.variables[&of(item)].error(&of(item), "no rotation").expected("a rotation to 1e-5 or better")
    };
    let turn = match spec.as_str() {
        "MATRIX" => {
            // Column by column.
            let own = numbers("MATRIX", 9)?;
            let columns: [DVec3; 3] = std::array::from_fn(|k| DVec3::from_slice(&own[3 * k..3 * k + 3]));
            let matrix = DMat3::from_cols(columns[0], columns[1], columns[2]);
            let off = matrix.transpose() * matrix - DMat3::IDENTITY;
            let largest = off.to_cols_array().iter().fold(0.0f64, |most, value| most.max(value.abs()));
            if !(largest <= ROTATION_TOLERANCE && matrix.determinant() > 0.0) {
                return Err(no_rotation("MATRIX"));
            }
            DQuat::from_mat3(&matrix).normalize()
        }
        "ANGLES" => {
            let angles = numbers("ANGLES", 3)?;
            let axes = numbers("AXES", 3)?;
            let units = pool.text(&of("UNITS"))?.unwrap_or("RADIANS").to_ascii_uppercase();
            let unit_rad = match units.as_str() {
                "RADIANS" => 1.0,
                "DEGREES" => PI / 180.0,
                "ARCMINUTES" => PI / 10_800.0,
                "ARCSECONDS" => PI / 648_000.0,
                _ => {
                    return Err(pool.variables[&of("UNITS")]
                        .error(&of("UNITS"), "the unit is not read")
                        .found(units)
                        .expected("RADIANS, DEGREES, ARCMINUTES or ARCSECONDS"));
                }
            };
            let mut turn = DQuat::IDENTITY;
            for (angle, axis) in angles.iter().zip(&axes) {
                let axis = match *axis {
                    1.0 => DVec3::X,
                    2.0 => DVec3::Y,
                    3.0 => DVec3::Z,
                    other => {
                        return Err(pool.variables[&of("AXES")]
                            .error(&of("AXES"), "no axis")
                            .found(other)
                            .expected("1, 2 or 3"));
                    }
                };
                turn *= DQuat::from_axis_angle(axis, -angle * unit_rad);
            }
            turn
        }
        "QUATERNION" => {
            let own = numbers("Q", 4)?;
            let turn = DQuat::from_xyzw(own[1], own[2], own[3], own[0]);
            if (turn.length() - 1.0).abs() > ROTATION_TOLERANCE {
                return Err(no_rotation("Q"));
            }
            turn.normalize()
        }
        _ => {
            return Err(pool.variables[&of("SPEC")]
                .error(&of("SPEC"), "the fixed offset is not read")
                .found(spec)
                .expected("MATRIX, ANGLES or QUATERNION"));
        }
    };
    Ok((turn, relative))
}
