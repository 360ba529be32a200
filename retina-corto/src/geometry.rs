//! `geometry.json`, and the point clouds in text that CORTO's users have too.

use std::path::Path;

use glam::DVec3;
use retina_files::{InputError, read_text};

use crate::node::{Node, read_json};
use crate::pose::{ObjectPose, Pose, unit_quaternion};

/// Columns of a point cloud: id or time, body position and quaternion, camera position and
/// quaternion, Sun position.
const CLOUD_COLUMNS: usize = 18;
const QUATERNION: &str = "a unit quaternion (w, x, y, z)";

/// Reads the poses of a geometry file: JSON, or a point cloud where the name ends in `.txt`.
///
/// # Errors
/// A key that is missing, a value of another kind, lists of unequal lengths, a quaternion that is
/// not unit; in a point cloud the same, with the line.
pub fn read_geometry(file: &Path, bodies: usize, notes: &mut Vec<String>) -> Result<Vec<Pose>, InputError> {
    let is_cloud = file.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("txt"));
    let poses = if is_cloud { cloud(file, bodies)? } else { json(file, bodies, notes)? };
    if poses.iter().any(|pose| pose.sun_position_bu == DVec3::ZERO) {
        notes.push(
            "a Sun at the world's origin has no direction; it shines along -z, as Blender's lamp without a turn"
                .into(),
        );
    }
    Ok(poses)
}

/// The one frame that CORTO assumes without a geometry file: all at the origin.
pub fn default_pose(bodies: usize) -> Pose {
    Pose {
        time_s: 0.0,
        sun_position_bu: DVec3::ZERO,
        camera: ObjectPose::default(),
        bodies: vec![ObjectPose::default(); bodies],
    }
}

fn json(file: &Path, bodies: usize, notes: &mut Vec<String>) -> Result<Vec<Pose>, InputError> {
    let document = read_json(file)?;
    let root = Node::root(file, &document);
    let mut lists = Lists { lengths: Vec::new() };
    let sun = root.key("sun", "the Sun's table")?;
    sun.name_unknown(&["position"], notes)?;
    let sun_positions = lists.positions(&sun)?;
    let camera = lists.object(&root, "camera", notes)?;
    let names: Vec<String> = if bodies == 1 && !root.has("body_1") {
        vec!["body".into()]
    } else {
        (1..=bodies).map(|i| format!("body_{i}")).collect()
    };
    let objects: Vec<Vec<ObjectPose>> =
        names.iter().map(|name| lists.object(&root, name, notes)).collect::<Result<_, _>>()?;
    lists.check(file)?;
    let mut known = vec!["sun", "camera"];
    known.extend(names.iter().map(String::as_str));
    root.name_unknown(&known, notes)?;
    Ok((0..sun_positions.len())
        .map(|frame| Pose {
            time_s: frame as f64,
            sun_position_bu: sun_positions[frame],
            camera: camera[frame],
            bodies: objects.iter().map(|object| object[frame]).collect(),
        })
        .collect())
}

/// The lists read so far and their lengths.
struct Lists {
    lengths: Vec<(String, usize)>,
}

impl Lists {
    fn positions(&mut self, table: &Node<'_>) -> Result<Vec<DVec3>, InputError> {
        let node = table.key("position", "a list of [x, y, z], one for each frame")?;
        let entries = node.list("a list of [x, y, z], one for each frame")?;
        self.lengths.push((node.path.clone(), entries.len()));
        entries.iter().map(|entry| Ok(DVec3::from_array(entry.vector()?))).collect()
    }

    fn object(
        &mut self,
        root: &Node<'_>,
        name: &str,
        notes: &mut Vec<String>,
    ) -> Result<Vec<ObjectPose>, InputError> {
        let table = root.key(name, "a table with `position` and `orientation`")?;
        table.name_unknown(&["position", "orientation"], notes)?;
        let positions = self.positions(&table)?;
        let node = table.key("orientation", "a list of [w, x, y, z], one for each frame")?;
        let entries = node.list("a list of [w, x, y, z], one for each frame")?;
        self.lengths.push((node.path.clone(), entries.len()));
        let mut poses = Vec::new();
        for (frame, entry) in entries.iter().enumerate() {
            let values = entry.vector()?;
            let Some(world_from_object) = unit_quaternion(values) else {
                return Err(entry
                    .error(format!("frame {frame}: the quaternion is not unit"))
                    .found(norm(values))
                    .expected(QUATERNION));
            };
            // Unequal lengths are reported together, once all are known.
            let position_bu = positions.get(frame).copied().unwrap_or_default();
            poses.push(ObjectPose { position_bu, world_from_object });
        }
        Ok(poses)
    }

    fn check(&self, file: &Path) -> Result<(), InputError> {
        let frames = self.lengths.first().map_or(0, |(_, length)| *length);
        if self.lengths.iter().all(|(_, length)| *length == 0) {
            return Err(InputError::new(file, "holds no frame")
                .at("key `sun.position`")
                .expected("one entry for each frame"));
        }
        if self.lengths.iter().all(|(_, length)| *length == frames) {
            return Ok(());
        }
        let each: Vec<String> =
            self.lengths.iter().map(|(path, length)| format!("`{path}` {length}")).collect();
        Err(InputError::new(file, "the lists have unequal lengths")
            .found(each.join(", "))
            .expected("one entry for each frame in all of them"))
    }
}

fn norm(values: [f64; 4]) -> String {
    let norm = values.iter().map(|v| v * v).sum::<f64>().sqrt();
    format!("{values:?} of norm {norm:.6}")
}

fn cloud(file: &Path, bodies: usize) -> Result<Vec<Pose>, InputError> {
    if bodies != 1 {
        return Err(InputError::new(file, "a point cloud holds the pose of one body")
            .found(format!("a scene of {bodies} bodies"))
            .help("give the geometry as JSON"));
    }
    let text = read_text(file)?;
    let mut poses = Vec::new();
    for (number, line) in text.lines().enumerate() {
        let line = line.split('#').next().unwrap_or_default();
        let words: Vec<&str> = line.split([' ', '\t', ',']).filter(|word| !word.is_empty()).collect();
        if words.is_empty() {
            continue;
        }
        let at = |error: InputError| error.line(number + 1);
        if words.len() != CLOUD_COLUMNS {
            return Err(at(InputError::new(
                file,
                "the row has another number of columns than a point cloud",
            )
            .found(words.len())
            .expected(CLOUD_COLUMNS)));
        }
        let mut values = [0.0; CLOUD_COLUMNS];
        for (column, word) in words.iter().enumerate() {
            values[column] = word.parse().ok().filter(|v: &f64| v.is_finite()).ok_or_else(|| {
                at(InputError::new(file, format!("column {} is not a finite number", column + 1))
                    .found(format!("`{}`", word.escape_default())))
            })?;
        }
        let object = |first: usize| {
            let q = [values[first + 3], values[first + 4], values[first + 5], values[first + 6]];
            let world_from_object = unit_quaternion(q).ok_or_else(|| {
                at(InputError::new(file, format!("frame {}: the quaternion is not unit", poses.len()))
                    .found(norm(q))
                    .expected(QUATERNION))
            })?;
            let position_bu = DVec3::new(values[first], values[first + 1], values[first + 2]);
            Ok(ObjectPose { position_bu, world_from_object })
        };
        let (body, camera) = (object(1)?, object(8)?);
        let sun_position_bu = DVec3::new(values[15], values[16], values[17]);
        poses.push(Pose { time_s: values[0], sun_position_bu, camera, bodies: vec![body] });
    }
    if poses.is_empty() {
        return Err(
            InputError::new(file, "holds no row").expected(format!("rows of {CLOUD_COLUMNS} numbers"))
        );
    }
    Ok(poses)
}
