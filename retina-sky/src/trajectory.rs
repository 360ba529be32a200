//! The trajectory table: one row a frame, in the machine interface's columns.
//!
//! `time_s` (TDB seconds since J2000), `camera_x_m` ..., `camera_from_inertial_w` ..., and
//! optionally `camera_vx_m_s` ..., `sun_x_m` ..., and for each body of the scene `NAME_x_m` ... and
//! `NAME_from_inertial_w` .... Columns stand in any order; inertial axes are ICRF.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use glam::{DMat3, DQuat, DVec3};
use retina_files::{InputError, Table, nearest, read_text};

/// How far a quaternion's norm may be off 1 before it is taken for a mistake.
const NORM_TOLERANCE: f64 = 1e-3;
/// Norms this near to 1 are rounding: such a quaternion is kept bit for bit.
const NORM_ROUNDING: f64 = 1e-14;

/// Where a body is and how it is turned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyPose {
    /// The body's centre, ICRF metres.
    pub position_m: DVec3,
    /// Unit quaternion from ICRF to body-fixed axes.
    pub body_from_inertial: DQuat,
}

/// One frame: the camera, the Sun and the bodies.
#[derive(Debug, Clone, PartialEq)]
pub struct FramePose {
    /// TDB seconds since J2000.
    pub time_s: f64,
    /// The camera, ICRF metres.
    pub camera_position_m: DVec3,
    /// Unit quaternion from ICRF to the camera's axes (+z boresight, +x right, +y down).
    pub camera_from_inertial: DQuat,
    /// The camera's velocity, metres a second (for aberration; `None`: there is none).
    pub camera_velocity_m_s: Option<DVec3>,
    /// The Sun, ICRF metres, in the frame of the positions.
    pub sun_position_m: Option<DVec3>,
    /// Bodies by name.
    pub bodies: BTreeMap<String, BodyPose>,
}

/// Which columns of a body the trajectory gives; what it does not give stands at the origin, aligned.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct BodyColumns {
    /// Its position.
    pub position: bool,
    /// Its orientation.
    pub orientation: bool,
}

/// The attitude of a camera that looks along `towards` with `up` up in its image.
pub(crate) fn look_at(towards: DVec3, up: DVec3) -> DQuat {
    let boresight = towards.normalize();
    // On the axis itself any up will do.
    let right = boresight.cross(up).try_normalize().unwrap_or_else(|| boresight.any_orthonormal_vector());
    let down = boresight.cross(right);
    DQuat::from_mat3(&DMat3::from_cols(right, down, boresight)).inverse().normalize()
}

/// A sequence of frames.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    /// The file, or the name of what made the frames.
    pub source: PathBuf,
    /// The frames.
    pub frames: Vec<FramePose>,
    /// For each body, what of it was given and not assumed.
    pub given: BTreeMap<String, BodyColumns>,
    /// Whether the ephemeris turned the bodies, and not a file or a spin.
    pub turned_by_ephemeris: bool,
    /// Lines of the frames in the file; empty where the frames were made.
    lines: Vec<usize>,
}

impl Trajectory {
    /// Frames made by a program, all their bodies given; `source` names them in errors.
    pub fn new(source: &Path, frames: Vec<FramePose>) -> Self {
        let whole = BodyColumns { position: true, orientation: true };
        let given =
            frames.iter().flat_map(|pose| pose.bodies.keys()).map(|name| (name.clone(), whole)).collect();
        Self { source: source.to_path_buf(), frames, given, turned_by_ephemeris: false, lines: Vec::new() }
    }

    /// Reads a trajectory table; `body_names` are the scene's bodies.
    ///
    /// A body may have position columns, orientation columns, both or none: without a position it
    /// stands at the origin, without an orientation it is aligned with the inertial axes (and
    /// [`Trajectory::given`] says so). A quaternion whose norm is off 1 by at most 1e-3 is normalised.
    ///
    /// # Errors
    /// A table that cannot be read or is empty, a column that is unknown or missing, three or four
    /// columns that belong together of which some are missing, a cell that is empty or not
    /// finite, a quaternion that is not unit, a body called `camera`.
    pub fn read(path: impl AsRef<Path>, body_names: &[String]) -> Result<Self, InputError> {
        let path = path.as_ref();
        Self::parse(path, &read_text(path)?, body_names)
    }

    /// As [`Trajectory::read`], from text already in memory; `path` only names it in errors.
    ///
    /// # Errors
    /// As [`Trajectory::read`].
    pub fn parse(path: &Path, text: &str, body_names: &[String]) -> Result<Self, InputError> {
        let table = Table::parse(path, text)?;
        if body_names.iter().any(|name| name == "camera") {
            return Err(InputError::new(path, "a body is called `camera`, as the camera's own columns are")
                .help("rename the body in the scene"));
        }
        let camera_position = position_columns("camera");
        let camera_attitude = attitude_columns("camera");
        let velocity = ["camera_vx_m_s", "camera_vy_m_s", "camera_vz_m_s"].map(str::to_owned);
        let sun = position_columns("sun");
        let bodies: BTreeMap<&str, _> = body_names
            .iter()
            .map(|name| (name.as_str(), (position_columns(name), attitude_columns(name))))
            .collect();

        let mut known = vec!["time_s"];
        known.extend([&camera_position, &velocity, &sun].into_iter().flatten().map(String::as_str));
        known.extend(camera_attitude.iter().map(String::as_str));
        for (position, attitude) in bodies.values() {
            known.extend(position.iter().chain(attitude).map(String::as_str));
        }
        refuse_unknown(&table, &known, body_names)?;
        table.require(&["time_s"])?;
        table.require(&camera_position.each_ref().map(String::as_str))?;
        table.require(&camera_attitude.each_ref().map(String::as_str))?;
        let has_velocity = whole_group(&table, &velocity)?;
        let has_sun = whole_group(&table, &sun)?;
        let mut given = BTreeMap::new();
        for (name, (position, attitude)) in &bodies {
            let columns = BodyColumns {
                position: whole_group(&table, position)?,
                orientation: whole_group(&table, attitude)?,
            };
            given.insert((*name).to_owned(), columns);
        }
        if table.is_empty() {
            return Err(InputError::new(path, "holds no frames").expected("one row a frame below the header"));
        }

        let mut frames = Vec::with_capacity(table.len());
        for row in 0..table.len() {
            let mut poses = BTreeMap::new();
            for (name, (position, attitude)) in &bodies {
                let columns = given.get(*name).copied().unwrap_or_default();
                let pose = BodyPose {
                    position_m: if columns.position { vector(&table, row, position)? } else { DVec3::ZERO },
                    body_from_inertial: if columns.orientation {
                        quaternion(&table, row, attitude)?
                    } else {
                        DQuat::IDENTITY
                    },
                };
                poses.insert((*name).to_owned(), pose);
            }
            frames.push(FramePose {
                time_s: table.number(row, "time_s")?,
                camera_position_m: vector(&table, row, &camera_position)?,
                camera_from_inertial: quaternion(&table, row, &camera_attitude)?,
                camera_velocity_m_s: has_velocity.then(|| vector(&table, row, &velocity)).transpose()?,
                sun_position_m: has_sun.then(|| vector(&table, row, &sun)).transpose()?,
                bodies: poses,
            });
        }
        let lines = (0..table.len()).map(|row| table.line(row)).collect();
        Ok(Self { source: path.to_path_buf(), frames, given, turned_by_ephemeris: false, lines })
    }

    /// An error about a frame (counted from 0), with its line where it came from a file.
    pub fn error_at(&self, frame: usize, problem: impl Into<String>) -> InputError {
        // Where there is a line, the place is that, and the problem says which frame it is.
        match self.lines.get(frame) {
            Some(&line) => {
                InputError::new(&self.source, format!("frame {frame}: {}", problem.into())).line(line)
            }
            None => InputError::new(&self.source, problem).at(format!("frame {frame}")),
        }
    }

    /// The table as text. Numbers are written so that reading them gives the same bits.
    ///
    /// A column stands where any frame has it; a frame that lacks it has an empty cell, which
    /// [`Trajectory::read`] refuses.
    pub fn to_csv(&self) -> String {
        let has_velocity = self.frames.iter().any(|pose| pose.camera_velocity_m_s.is_some());
        let has_sun = self.frames.iter().any(|pose| pose.sun_position_m.is_some());
        let mut header = vec!["time_s".to_owned()];
        header.extend(position_columns("camera"));
        header.extend(attitude_columns("camera"));
        if has_velocity {
            header.extend(["camera_vx_m_s", "camera_vy_m_s", "camera_vz_m_s"].map(str::to_owned));
        }
        if has_sun {
            header.extend(position_columns("sun"));
        }
        for (name, columns) in &self.given {
            if columns.position {
                header.extend(position_columns(name));
            }
            if columns.orientation {
                header.extend(attitude_columns(name));
            }
        }
        let mut text = header.iter().map(|name| quoted(name)).collect::<Vec<_>>().join(",");
        text.push('\n');
        for pose in &self.frames {
            let mut row = Row { text: &mut text, first: true };
            row.numbers(Some([pose.time_s]));
            row.numbers(Some(pose.camera_position_m.to_array()));
            row.numbers(Some(scalar_first(pose.camera_from_inertial)));
            if has_velocity {
                row.numbers(pose.camera_velocity_m_s.map(|v| v.to_array()));
            }
            if has_sun {
                row.numbers(pose.sun_position_m.map(|v| v.to_array()));
            }
            for (name, columns) in &self.given {
                let body = pose.bodies.get(name);
                if columns.position {
                    row.numbers(body.map(|body| body.position_m.to_array()));
                }
                if columns.orientation {
                    row.numbers(body.map(|body| scalar_first(body.body_from_inertial)));
                }
            }
            text.push('\n');
        }
        text
    }
}

/// A line that is being written.
struct Row<'a> {
    text: &'a mut String,
    first: bool,
}

impl Row<'_> {
    fn numbers<const N: usize>(&mut self, values: Option<[f64; N]>) {
        for i in 0..N {
            if !std::mem::take(&mut self.first) {
                self.text.push(',');
            }
            if let Some(value) = values.as_ref().and_then(|values| values.get(i)) {
                // Shortest digits that read back as the same f64. Writing to a String cannot fail.
                let _ = write!(self.text, "{value:?}");
            }
        }
    }
}

/// A column's name, in quotes where CSV needs them.
fn quoted(name: &str) -> String {
    if name.contains([',', '"']) { format!("\"{}\"", name.replace('"', "\"\"")) } else { name.to_owned() }
}

fn scalar_first(q: DQuat) -> [f64; 4] {
    [q.w, q.x, q.y, q.z]
}

fn position_columns(name: &str) -> [String; 3] {
    ["x", "y", "z"].map(|axis| format!("{name}_{axis}_m"))
}

fn attitude_columns(name: &str) -> [String; 4] {
    ["w", "x", "y", "z"].map(|part| format!("{name}_from_inertial_{part}"))
}

/// An error at the first column that is none of a trajectory's.
fn refuse_unknown(table: &Table, known: &[&str], body_names: &[String]) -> Result<(), InputError> {
    let Some(column) = table.columns().iter().find(|column| !known.contains(&column.as_str())) else {
        return Ok(());
    };
    let scene = match body_names {
        [] => "the scene has no bodies".to_owned(),
        names => format!("the scene's bodies are {}", names.join(", ")),
    };
    let help = match nearest(column, known.iter().copied()) {
        Some(near) => format!("is `{near}` meant, or a body's column? ({scene})"),
        None => format!("remove the column, or name its body in the scene ({scene})"),
    };
    Err(InputError::new(table.file(), format!("column `{column}` is not one of a trajectory's")).help(help))
}

/// Whether all columns of a group are there; an error where only some are.
fn whole_group(table: &Table, columns: &[String]) -> Result<bool, InputError> {
    let (there, missing): (Vec<&str>, Vec<&str>) =
        columns.iter().map(String::as_str).partition(|column| table.has(column));
    if there.is_empty() || missing.is_empty() {
        return Ok(missing.is_empty());
    }
    Err(InputError::new(table.file(), "some of the columns that belong together are missing")
        .found(there.join(", "))
        .expected(columns.join(", "))
        .help(format!("add {}, or remove the others", missing.join(", "))))
}

fn vector(table: &Table, row: usize, [x, y, z]: &[String; 3]) -> Result<DVec3, InputError> {
    Ok(DVec3::new(table.number(row, x)?, table.number(row, y)?, table.number(row, z)?))
}

/// A scalar-first quaternion, unit to within [`NORM_TOLERANCE`].
fn quaternion(table: &Table, row: usize, [w, x, y, z]: &[String; 4]) -> Result<DQuat, InputError> {
    let number = |column| table.number(row, column);
    let q = DQuat::from_xyzw(number(x)?, number(y)?, number(z)?, number(w)?);
    let norm = q.length();
    let off = (norm - 1.0).abs();
    if off <= NORM_ROUNDING {
        Ok(q)
    } else if off <= NORM_TOLERANCE {
        Ok(q.normalize())
    } else {
        Err(InputError::new(table.file(), "the quaternion is not unit")
            .cell(table.line(row), w.as_str())
            .found(format!("({:?}, {:?}, {:?}, {:?}) of norm {norm}", q.w, q.x, q.y, q.z))
            .expected("a norm of 1 to within 0.001, scalar first"))
    }
}

#[cfg(test)]
mod tests;
