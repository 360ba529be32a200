//! SPICE kernels beside SPK: how bodies and spacecraft are turned and how large bodies are, leap seconds, and
//! meta-kernels that name all of them.

mod attitudes;
mod bpc;
mod ck;
mod clock;
mod constants;
mod contents;
pub(crate) mod daf;
mod frames;
mod leap;
mod meta;
mod names;
mod text;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use glam::{DQuat, DVec3};
use retina_files::{InputError, hash_bytes, read_bytes};

use self::attitudes::Attitudes;
use self::bpc::AxesSegment;
use self::constants::Constants;
pub use self::contents::kernel_contents;
use self::frames::{Asked, Base, Frame};
use self::text::Pool;
use crate::ephemeris::{EphemerisError, KernelFile, SPK_KIND};
use crate::orientation;

/// The bytes with which other binary kernels begin, and what is to be done about them.
const UNREAD: [(&[u8], &str, &str); 2] = [
    (b"DAS/DSK ", "a DSK kernel (a body's shape)", "name it as a body's `model`"),
    (b"DAF/", "a binary kernel of a kind that is not read", "RETINA reads SPK, CK and binary PCK kernels"),
];

/// Most frames from a spacecraft's axes to inertial ones, each turned against the next by a CK kernel.
const MOST_TURNS: usize = 8;

/// How bodies and spacecraft are turned, and how large bodies are, by kernels.
#[derive(Debug, Clone, Default)]
pub(crate) struct Axes {
    pool: Pool,
    constants: BTreeMap<i32, Constants>,
    segments: Vec<AxesSegment>,
    attitudes: Attitudes,
    /// By NAIF's number of the body.
    frames: BTreeMap<i32, Frame>,
    files: Vec<KernelFile>,
}

/// Kernels that were told apart.
pub(crate) struct Sorted {
    /// All of them in their order; a meta-kernel's list is in its place, without itself.
    pub(crate) files: Vec<KernelFile>,
    pub(crate) axes: Axes,
}

/// Reads kernels and those that meta-kernels name; `spk` takes each SPK kernel.
///
/// # Errors
/// A file cannot be read, is of a kind that is not read, or does not fit.
pub(crate) fn read(
    paths: &[PathBuf],
    mut spk: impl FnMut(KernelFile, &[u8]) -> Result<(), InputError>,
) -> Result<Sorted, InputError> {
    let mut sorted = Sorted { files: Vec::new(), axes: Axes::default() };
    for path in paths {
        let bytes = read_bytes(path)?;
        match sorted.add(path, &bytes, &mut spk)? {
            None => {}
            Some(named) => {
                for kernel in named {
                    let by_meta = |error: InputError| error.named_by(path, "KERNELS_TO_LOAD");
                    let bytes = read_bytes(&kernel).map_err(by_meta)?;
                    if sorted.add(&kernel, &bytes, &mut spk).map_err(by_meta)?.is_some() {
                        return Err(by_meta(
                            InputError::new(&kernel, "a meta-kernel names another one")
                                .help("name the kernels themselves"),
                        ));
                    }
                }
            }
        }
    }
    sorted.axes.finish(&sorted.files)?;
    Ok(sorted)
}

impl Sorted {
    /// Adds a kernel, or says which kernels it names.
    fn add(
        &mut self,
        path: &Path,
        bytes: &[u8],
        spk: &mut impl FnMut(KernelFile, &[u8]) -> Result<(), InputError>,
    ) -> Result<Option<Vec<PathBuf>>, InputError> {
        let file = KernelFile { path: path.to_path_buf(), hash: hash_bytes(bytes) };
        if bytes.starts_with(SPK_KIND.identity) {
            spk(file.clone(), bytes)?;
        } else if bytes.starts_with(bpc::PCK_KIND.identity) {
            let index = self.files.len();
            self.axes.segments.extend(bpc::segments(path, bytes, index)?);
        } else if bytes.starts_with(ck::CK_KIND.identity) {
            let index = self.files.len();
            self.axes.attitudes.extend(ck::segments(path, bytes, index)?);
        } else {
            check_text(path, bytes)?;
            let mut own = Pool::default();
            own.read(path, bytes)?;
            if let Some(named) = meta::named_kernels(path, &own)? {
                return Ok(Some(named));
            }
            // Once more into the pool that all share: `+=` adds to what is there.
            self.axes.pool.read(path, bytes)?;
        }
        self.files.push(file);
        Ok(None)
    }
}

/// Refuses what is no text kernel.
fn check_text(path: &Path, bytes: &[u8]) -> Result<(), InputError> {
    let is_text_kernel = bytes.starts_with(b"KPL/")
        || bytes.split(|&byte| byte == b'\n').any(|line| line.trim_ascii() == b"\\begindata");
    if is_text_kernel {
        return Ok(());
    }
    let begins = bytes.get(..8).unwrap_or(bytes);
    if let Some((_, what, mend)) = UNREAD.iter().find(|(start, ..)| bytes.starts_with(start)) {
        return Err(InputError::new(path, format!("{what} is not read here"))
            .found(format!("`{}`", begins.escape_ascii()))
            .expected("an SPK, CK, PCK, frame, clock, leap-second or meta-kernel")
            .help(mend));
    }
    let error = InputError::new(path, "is no SPICE kernel")
        .found(format!("{} bytes that begin with `{}`", bytes.len(), begins.escape_ascii()))
        .expected("a binary kernel, which begins with `DAF/SPK `, `DAF/PCK ` or `DAF/CK `, or a text kernel with `\\begindata`");
    Err(if begins.starts_with(b"DAFETF") {
        error.help("this is a transfer file: NAIF's program `tobin` makes a binary kernel of it")
    } else {
        error.help("give a planetary ephemeris such as de440s.bsp, as JPL publishes it, or a meta-kernel")
    })
}

impl Axes {
    /// Interprets what was read.
    fn finish(&mut self, files: &[KernelFile]) -> Result<(), InputError> {
        leap::check(&self.pool)?;
        self.constants = constants::constants(&self.pool)?;
        self.attitudes.find_clocks(&self.pool)?;
        files.clone_into(&mut self.files);
        // Axes of binary kernels, then what frames make of them: the Moon's mean Earth axes where they are defined.
        for segment in &self.segments {
            if let Some((body, name)) = frames::body_of_axes(segment.axes) {
                let base = Base::Pck(segment.axes);
                let own = Frame { name: name.to_owned(), base, frame_from_base: DQuat::IDENTITY };
                self.frames.insert(body, own);
            }
        }
        let mut found = BTreeMap::new();
        for (name, variable) in &self.pool.variables {
            if name == "FRAME_MOON_ME" {
                found
                    .entry(301)
                    .or_insert(self.frame(&|name, problem| variable.error(name, problem), "MOON_ME")?);
            }
            let Some(body) = name.strip_prefix("OBJECT_").and_then(|rest| rest.strip_suffix("_FRAME")) else {
                continue;
            };
            let number = body.parse().ok().or_else(|| names::number(&self.pool, body));
            // Spacecraft have negative numbers; nothing here asks for their axes.
            let Some(number) = number.filter(|&number| number > 0) else { continue };
            let asked = match &variable.values[..] {
                [text::Value::Text(name)] => name.trim().to_owned(),
                [text::Value::Number(number)] => number.to_string(),
                _ => {
                    return Err(variable.error(name, "no frame").expected("one frame's name or number"));
                }
            };
            found.insert(number, self.frame(&|name, problem| variable.error(name, problem), &asked)?);
        }
        self.frames.extend(found);
        Ok(())
    }

    /// A frame, whose base must be there.
    fn frame(&self, asked: Asked<'_>, name: &str) -> Result<Frame, InputError> {
        let frame = frames::frame(&self.pool, asked, name)?;
        if let Base::Pck(axes) = frame.base
            && self.constants.get(&axes).is_none_or(|own| own.turning.is_none())
            && !self.segments.iter().any(|segment| segment.axes == axes)
        {
            return Err(asked(name, "no kernel turns these axes")
                .found(format!("nothing of axes {axes}"))
                .expected("a binary PCK kernel (.bpc) that has them, such as moon_pa_de440_200625.bpc")
                .help("name that kernel too, in a meta-kernel or beside this one"));
        }
        Ok(frame)
    }

    /// NAIF's number of a body or spacecraft by its name, or by the number itself.
    pub(crate) fn number(&self, name: &str) -> Option<i32> {
        name.trim().parse().ok().or_else(|| names::number(&self.pool, name))
    }

    /// How a body's axes are turned from ICRF's at an epoch; `None` where kernels do not say.
    pub(crate) fn body_from_inertial(&self, name: &str, tdb_s: f64) -> Result<Option<DQuat>, EphemerisError> {
        let Some(body) = self.number(name) else { return Ok(None) };
        match self.frames.get(&body) {
            None => Ok(self.iau(body, tdb_s)),
            Some(frame) => self.turned(frame, &names::name(body), tdb_s, MOST_TURNS),
        }
    }

    /// How the axes of a frame, by its name or number, are turned from ICRF's at an epoch.
    pub(crate) fn frame_from_inertial(&self, name: &str, tdb_s: f64) -> Result<DQuat, EphemerisError> {
        let untold = |reason: String| EphemerisError::Attitude { frame: name.to_owned(), tdb_s, reason };
        let asked = |at: &str, problem: &str| InputError::new(at, problem.to_owned());
        let frame = self.frame(&asked, name).map_err(|error| untold(error.to_string()))?;
        let turn = self.turned(&frame, name, tdb_s, MOST_TURNS)?;
        turn.ok_or_else(|| untold("no kernel turns these axes".to_owned()))
    }

    /// A frame's axes from ICRF's, over at most so many further frames; `whose` they are in errors.
    fn turned(
        &self,
        frame: &Frame,
        whose: &str,
        tdb_s: f64,
        turns: usize,
    ) -> Result<Option<DQuat>, EphemerisError> {
        let base = match frame.base {
            Base::Inertial(number) => bpc::reference_from_inertial(number),
            Base::Iau(body) => match self.iau(body, tdb_s) {
                Some(turn) => turn,
                None => return Ok(None),
            },
            Base::Pck(axes) => {
                let own = self.segments.iter().filter(|segment| segment.axes == axes);
                match own.clone().rev().find(|segment| segment.covers(tdb_s)) {
                    Some(segment) => segment.axes_from_inertial(tdb_s),
                    None if own.clone().next().is_none() => match self.iau(axes, tdb_s) {
                        Some(turn) => turn,
                        None => return Ok(None),
                    },
                    None => return Err(self.not_covered(whose, axes, tdb_s)),
                }
            }
            Base::Ck(instrument) => {
                let untold =
                    |reason: String| EphemerisError::Attitude { frame: whose.to_owned(), tdb_s, reason };
                let (reference, turn) = self.attitudes.at(instrument, tdb_s, &self.files).map_err(untold)?;
                let asked = |at: &str, problem: &str| InputError::new(at, problem.to_owned());
                let below = self.frame(&asked, &reference.to_string()).map_err(|error| {
                    untold(format!("its attitude is relative to frame {reference}: {error}"))
                })?;
                let Some(turns) = turns.checked_sub(1) else {
                    return Err(untold(format!("its frames, down to {reference}, do not end")));
                };
                match self.turned(&below, whose, tdb_s, turns)? {
                    Some(base) => turn * base,
                    None => return Ok(None),
                }
            }
        };
        Ok(Some((frame.frame_from_base * base).normalize()))
    }

    /// By text constants, or by the built-in elements of a body that a frame names.
    fn iau(&self, body: i32, tdb_s: f64) -> Option<DQuat> {
        match self.constants.get(&body).and_then(|own| own.turning.as_ref()) {
            Some(turning) => Some(turning.elements(tdb_s).body_from_inertial()),
            None => orientation::body_from_inertial(names::name(body).split(' ').next()?, tdb_s),
        }
    }

    fn not_covered(&self, whose: &str, axes: i32, tdb_s: f64) -> EphemerisError {
        let own = || self.segments.iter().filter(|segment| segment.axes == axes);
        let paths: BTreeSet<String> =
            own().map(|segment| self.files[segment.file].path.display().to_string()).collect();
        EphemerisError::AxesNotCovered {
            kernels: paths.into_iter().collect::<Vec<_>>().join(", "),
            body: whose.to_owned(),
            tdb_s,
            from_s: own().map(|segment| segment.span_s[0]).fold(f64::INFINITY, f64::min),
            to_s: own().map(|segment| segment.span_s[1]).fold(f64::NEG_INFINITY, f64::max),
        }
    }

    /// What turns a body: a frame or constants and the kernels that they are in; `None` where no kernel does.
    pub(crate) fn source(&self, name: &str) -> Option<String> {
        let body = self.number(name)?;
        let variable_file = |variable: String| {
            let own = self.pool.variables.get(&variable)?;
            own.file.file_name().map(|name| name.to_string_lossy().into_owned())
        };
        let constants = |body: i32| {
            self.constants.get(&body)?.turning.as_ref()?;
            variable_file(format!("BODY{body}_PM"))
        };
        let Some(frame) = self.frames.get(&body) else {
            return constants(body).map(|file| format!("IAU constants of {file}"));
        };
        let turned_by = match frame.base {
            Base::Inertial(_) => None,
            Base::Iau(body) => constants(body).or(Some("the built-in IAU elements".to_owned())),
            Base::Pck(axes) => {
                let files: BTreeSet<String> = self
                    .segments
                    .iter()
                    .filter(|segment| segment.axes == axes)
                    .map(|segment| self.files[segment.file].name())
                    .collect();
                if files.is_empty() { constants(axes) } else { Some(Vec::from_iter(files).join(", ")) }
            }
            Base::Ck(instrument) => {
                let files = self.attitudes.files(instrument).into_iter();
                Some(files.map(|file| self.files[file].name()).collect::<Vec<_>>().join(", "))
            }
        };
        let by_frame = variable_file(format!("FRAME_{}", frame.name));
        let files: Vec<String> = turned_by.into_iter().chain(by_frame).collect();
        Some(if files.is_empty() {
            frame.name.clone()
        } else {
            format!("{} ({})", frame.name, files.join(", "))
        })
    }

    /// A body's semi-axes by text kernels, m, along its own axes.
    pub(crate) fn semi_axes_m(&self, name: &str) -> Option<DVec3> {
        let body = self.number(name)?;
        self.constants.get(&body)?.radii_km.map(|radii_km| DVec3::from_array(radii_km) * 1e3)
    }

    /// The bodies that kernels turn, with what turns them, and those whose radii they give.
    pub(crate) fn bodies(&self) -> Vec<String> {
        let turned = self.constants.iter().filter(|(_, own)| own.turning.is_some()).map(|(body, _)| *body);
        let all: BTreeSet<i32> = turned.chain(self.frames.keys().copied()).collect();
        all.into_iter().map(names::name).collect()
    }
}
