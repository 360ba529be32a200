//! SPK kernels of the user's own, evaluated by anise.

use std::fmt;
use std::path::{Path, PathBuf};

use anise::almanac::Almanac;
use anise::naif::SPK;
use anise::prelude::{Epoch, Frame};
use glam::DVec3;
use retina_files::InputError;

use super::spk::{Segment, segments};
use super::{EphemerisError, State};
use crate::planets::Planet;
use crate::time::format_epoch_tdb;

/// NAIF's number of the Solar System's barycentre, where every chain of segments ends.
const BARYCENTRE: i32 = 0;
/// NAIF's number of the Sun.
const SUN: i32 = 10;
/// Links from a body to the barycentre: two in planetary kernels, one or two more in others.
const MOST_LINKS: usize = 8;

/// A kernel that was read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct KernelFile {
    /// Where.
    pub path: PathBuf,
    /// BLAKE3 of its content.
    pub hash: String,
}

impl KernelFile {
    /// Its name without folders.
    pub fn name(&self) -> String {
        self.path.file_name().unwrap_or_default().to_string_lossy().into_owned()
    }
}

/// Kernels in memory; where two of them give the same body at the same time, the later one counts.
pub(crate) struct Kernels {
    files: Vec<KernelFile>,
    /// With the file's index.
    segments: Vec<(usize, Segment)>,
    /// NAIF's numbers of the bodies of [`Planet::ALL`].
    planets: [i32; Planet::ALL.len()],
    almanac: Almanac,
}

impl fmt::Debug for Kernels {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Kernels").field(&self.files).finish()
    }
}

/// The planet's own centre and the barycentre of its system. The Earth's is 4700 km from its centre: there is
/// no taking it for the Earth.
fn numbers(planet: Planet) -> (i32, Option<i32>) {
    match planet {
        Planet::Mercury => (199, Some(1)),
        Planet::Venus => (299, Some(2)),
        Planet::Earth => (399, None),
        Planet::Moon => (301, None),
        Planet::Mars => (499, Some(4)),
        Planet::Jupiter => (599, Some(5)),
        Planet::Saturn => (699, Some(6)),
        Planet::Uranus => (799, Some(7)),
        Planet::Neptune => (899, Some(8)),
    }
}

/// Whether a body of this number may be asked for, or be a link on the way to the barycentre.
pub(super) fn is_used(target: i32) -> bool {
    (1..=SUN).contains(&target) || Planet::ALL.iter().any(|planet| numbers(*planet).0 == target)
}

/// Nearest and farthest that a body comes to the Solar System's barycentre, km: its perihelion and aphelion with their
/// changes in some thousand years, and the Sun's own way (Allen, Astrophysical Quantities, 4th edition, 12.2).
fn distance_km(target: i32) -> Option<[f64; 2]> {
    let system = if target > SUN { target / 100 } else { target };
    Some(match system {
        SUN => [0.0, 3e6],
        1 => [4.0e7, 7.5e7],
        2 => [1.0e8, 1.16e8],
        3 => [1.4e8, 1.6e8],
        4 => [1.95e8, 2.6e8],
        5 => [7.2e8, 8.4e8],
        6 => [1.3e9, 1.56e9],
        7 => [2.65e9, 3.1e9],
        8 => [4.35e9, 4.65e9],
        9 => [4.2e9, 7.6e9],
        _ => return None,
    })
}

/// A body's name with NAIF's number.
pub(super) fn body_name(target: i32) -> String {
    let of = |(centre, barycentre): (i32, Option<i32>), planet: Planet| {
        if centre == target {
            Some(planet.name().to_owned())
        } else {
            (barycentre == Some(target)).then(|| format!("the barycentre of {}", planet.name()))
        }
    };
    let name = match target {
        SUN => Some("the Sun".to_owned()),
        3 => Some("the barycentre of Earth and Moon".to_owned()),
        _ => Planet::ALL.into_iter().find_map(|planet| of(numbers(planet), planet)),
    };
    name.map_or_else(|| format!("body {target}"), |name| format!("{name} (NAIF {target})"))
}

impl Kernels {
    /// None yet.
    pub(super) fn new() -> Self {
        Self { files: Vec::new(), segments: Vec::new(), planets: [0; _], almanac: Almanac::default() }
    }

    /// Adds a kernel.
    ///
    /// # Errors
    /// It is no SPK kernel, or is damaged.
    pub(super) fn add(&mut self, file: KernelFile, bytes: &[u8]) -> Result<(), InputError> {
        let (index, path) = (self.files.len(), &file.path);
        self.segments.extend(segments(path, bytes)?.into_iter().map(|segment| (index, segment)));
        let spk = SPK::parse(bytes)
            .map_err(|error| InputError::new(path, format!("the kernel is damaged: {error}")))?;
        self.almanac = std::mem::take(&mut self.almanac).with_spk_as(spk, Some(index.to_string()));
        self.files.push(file);
        Ok(())
    }

    /// With all kernels added; `None` where there was none.
    ///
    /// # Errors
    /// A body is where it cannot be.
    pub(super) fn finish(mut self) -> Result<Option<Self>, InputError> {
        if self.files.is_empty() {
            return Ok(None);
        }
        let given = |target: i32| self.segments.iter().any(|(_, segment)| segment.target == target);
        self.planets = Planet::ALL.map(|planet| {
            let (centre, barycentre) = numbers(planet);
            barycentre.filter(|_| !given(centre)).unwrap_or(centre)
        });
        self.check_places()?;
        Ok(Some(self))
    }

    /// Refuses kernels that have a body where it cannot be: a number that has changed, or a body of another number.
    fn check_places(&self) -> Result<(), InputError> {
        for (file, Segment { target, span_s: [from_s, to_s], .. }) in &self.segments {
            let Some([least_km, most_km]) = distance_km(*target) else { continue };
            for tdb_s in [*from_s, 0.5 * (from_s + to_s), *to_s] {
                // What leads on to the barycentre may be in another kernel, for other epochs.
                let Ok(state) = self.state(*target, tdb_s) else { continue };
                let found_km = state.position_m.length() / 1e3;
                if !(least_km..=most_km).contains(&found_km) || !state.velocity_m_s.is_finite() {
                    return Err(InputError::new(&self.files[*file].path, "the kernel is damaged")
                        .at(format!("segment of {}", body_name(*target)))
                        .found(format!(
                            "{found_km:.4e} km from the Solar System's barycentre at {}",
                            format_epoch_tdb(tdb_s)
                        ))
                        .expected(format!("{least_km:.2e} to {most_km:.2e} km"))
                        .help("fetch the file again"));
                }
            }
        }
        Ok(())
    }

    /// The Sun's geometric barycentric state.
    ///
    /// # Errors
    /// The kernels do not have it at this epoch.
    pub(super) fn sun(&self, tdb_s: f64) -> Result<State, EphemerisError> {
        self.state(SUN, tdb_s)
    }

    /// A planet's geometric barycentric state: of its centre where a kernel has it, otherwise of its system's
    /// barycentre.
    ///
    /// # Errors
    /// As [`Kernels::sun`].
    pub(crate) fn planet(&self, planet: Planet, tdb_s: f64) -> Result<State, EphemerisError> {
        self.state(self.planets[planet as usize], tdb_s)
    }

    /// The geometric barycentric state of a body or spacecraft by NAIF's number.
    ///
    /// # Errors
    /// As [`Kernels::sun`].
    pub(super) fn body(&self, number: i32, tdb_s: f64) -> Result<State, EphemerisError> {
        self.state(number, tdb_s)
    }

    /// Along the chain of segments from a body to the Solar System's barycentre.
    fn state(&self, body: i32, tdb_s: f64) -> Result<State, EphemerisError> {
        let mut sum = State { position_m: DVec3::ZERO, velocity_m_s: DVec3::ZERO };
        if !tdb_s.is_finite() {
            return Err(self.lacking(body, tdb_s, "the epoch is not finite"));
        }
        // The argument of a planetary kernel is TDB. SPICE calls it ET, and hifitime's scale of that name is the
        // one that is not converted on the way.
        let epoch = Epoch::from_et_seconds(tdb_s);
        let mut at = body;
        for _ in 0..MOST_LINKS {
            let unread =
                self.segments.iter().find_map(|(_, own)| own.unread.as_ref().filter(|_| own.target == at));
            if let Some(reason) = unread {
                return Err(self.lacking(at, tdb_s, reason));
            }
            let link = self
                .almanac
                .translate_to_parent(Frame::from_ephem_j2000(at), epoch)
                .map_err(|error| self.lacking(at, tdb_s, &error.to_string()))?;
            sum.position_m += DVec3::from_array(link.radius_km.into()) * 1e3;
            sum.velocity_m_s += DVec3::from_array(link.velocity_km_s.into()) * 1e3;
            at = link.frame.ephemeris_id;
            if at == BARYCENTRE {
                return Ok(sum);
            }
        }
        Err(self.lacking(body, tdb_s, "its segments do not lead to the Solar System's barycentre"))
    }

    /// Why a body is not to be had at an epoch; `reason` where a segment covers it.
    fn lacking(&self, target: i32, tdb_s: f64, reason: &str) -> EphemerisError {
        let own: Vec<&(usize, Segment)> = self.segments.iter().filter(|(_, s)| s.target == target).collect();
        let names = |indices: &mut dyn Iterator<Item = usize>| {
            let mut paths: Vec<&Path> = indices.map(|index| self.files[index].path.as_path()).collect();
            paths.dedup();
            paths.iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(", ")
        };
        let body = body_name(target);
        if own.is_empty() {
            return EphemerisError::NoBody { kernels: names(&mut (0..self.files.len())), body };
        }
        let kernels = names(&mut own.iter().map(|(file, _)| *file));
        if own.iter().any(|(_, Segment { span_s: [from, to], .. })| (*from..=*to).contains(&tdb_s)) {
            return EphemerisError::Kernel { kernels, body, tdb_s, reason: reason.to_owned() };
        }
        let mut spans: Vec<[f64; 2]> = own.iter().map(|(_, segment)| segment.span_s).collect();
        spans.sort_by(|a, b| a[0].total_cmp(&b[0]));
        spans.dedup_by(|next, last| {
            let joined = next[0] <= last[1];
            last[1] = if joined { last[1].max(next[1]) } else { last[1] };
            joined
        });
        let covered = spans
            .iter()
            .map(|[from, to]| format!("{} to {}", format_epoch_tdb(*from), format_epoch_tdb(*to)));
        let covered = covered.collect::<Vec<_>>().join(", and ");
        EphemerisError::NotCovered { kernels, body, tdb_s, covered }
    }
}
