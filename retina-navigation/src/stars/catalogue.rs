//! The catalogue as the identification wants it: places at an epoch, close stars merged, pairs by angle.

use std::f64::consts::PI;

use glam::DVec3;
use retina_sky::catalogue::{Star, StarCatalogue};
use retina_sky::observer::Observer;

use super::pairs::PairTable;
use super::sky_index::SkyIndex;

/// What a table of stars is made for.
#[derive(Debug, Clone, PartialEq)]
pub struct CatalogueOptions {
    /// Epoch of the places, TDB seconds since J2000.
    pub tdb_s: f64,
    /// Greatest angle of a pair: the field's diagonal, rad.
    pub diagonal_rad: f64,
    /// Solid angle of the field, sr: says how many stars it holds.
    pub field_sr: f64,
    /// Stars closer together are seen as one, rad.
    pub blend_rad: f64,
    /// Stars that pairs are made of, on average in a field.
    pub stars_in_field: f64,
}

/// A star, or several that are seen as one.
#[derive(Debug, Clone, Copy)]
pub struct Entry {
    /// Its brightest star, as an index into [`StarCatalogue::stars`].
    pub star: u32,
    /// V of the whole.
    pub magnitude: f64,
    /// From the brightest star to the centre of light.
    pub offset: DVec3,
}

/// The sky of a [`super::StarSolver`].
#[derive(Debug, Clone)]
pub struct SolverCatalogue {
    stars: &'static StarCatalogue,
    entries: Vec<Entry>,
    all: SkyIndex,
    bright: SkyIndex,
    pairs: PairTable,
}

impl SolverCatalogue {
    /// Builds it: places at the epoch as seen from the Sun's surroundings without aberration, which shifts a whole
    /// field alike to a few arcseconds.
    pub fn new(options: &CatalogueOptions) -> Self {
        let stars = StarCatalogue::embedded();
        let used: Vec<u32> = (0..stars.stars().len() as u32)
            .filter(|&at| !stars.stars()[at as usize].notes.doubtful)
            .collect();
        let place = |at: u32| stars.stars()[at as usize].direction_from(DVec3::ZERO, options.tdb_s);
        let directions: Vec<DVec3> = used.iter().map(|&at| place(at)).collect();
        let (entries, merged) = merged(stars.stars(), &used, &directions, options.blend_rad);
        // Entries stay in the catalogue's order, brightest first but for what merging adds.
        let wanted = (options.stars_in_field * 4.0 * PI / options.field_sr).round() as usize;
        let bright: Vec<DVec3> = merged[..wanted.clamp(2, merged.len())].to_vec();
        let pairs = PairTable::new(&bright, options.diagonal_rad);
        Self { stars, entries, all: SkyIndex::new(merged, 0.02), bright: SkyIndex::new(bright, 0.01), pairs }
    }

    /// The entry of an index.
    pub fn entry(&self, at: usize) -> &Entry {
        &self.entries[at]
    }

    /// The brightest star of an entry.
    pub fn star(&self, at: usize) -> &'static Star {
        &self.stars.stars()[self.entries[at].star as usize]
    }

    /// All entries by place.
    pub(crate) fn all(&self) -> &SkyIndex {
        &self.all
    }

    /// The entries of which pairs are made, by place: the first of all entries.
    pub(crate) fn bright(&self) -> &SkyIndex {
        &self.bright
    }

    /// Pairs of the bright entries.
    pub fn pairs(&self) -> &PairTable {
        &self.pairs
    }

    /// The apparent direction of an entry: with an observer as it is seen there and then, otherwise at the epoch of
    /// the table without aberration.
    pub(crate) fn direction(&self, at: usize, observer: Option<&Observer>) -> DVec3 {
        match observer {
            None => self.all.directions()[at],
            Some(observer) => {
                let geometric = self.star(at).direction_from(observer.position_m(), observer.tdb_s());
                observer.apparent_star((geometric + self.entries[at].offset).normalize())
            }
        }
    }
}

/// Joins each star with brighter ones closer than `blend_rad`: the entries and their centres of light.
fn merged(stars: &[Star], used: &[u32], directions: &[DVec3], blend_rad: f64) -> (Vec<Entry>, Vec<DVec3>) {
    let index = SkyIndex::new(directions.to_vec(), 0.01);
    let light = |i: usize| 10f64.powf(-0.4 * stars[used[i] as usize].v_magnitude);
    let mut taken = vec![false; used.len()];
    let (mut entries, mut places) = (Vec::new(), Vec::new());
    for i in 0..used.len() {
        if taken[i] {
            continue;
        }
        let (mut sum, mut centre) = (0.0, DVec3::ZERO);
        index.for_each_within(directions[i], blend_rad, |j| {
            if !taken[j] {
                taken[j] = true;
                sum += light(j);
                centre += directions[j] * light(j);
            }
        });
        let place = centre.normalize();
        entries.push(Entry { star: used[i], magnitude: -2.5 * sum.log10(), offset: place - directions[i] });
        places.push(place);
    }
    (entries, places)
}

#[cfg(test)]
mod tests {
    use super::*;
    use retina_sky::catalogue::StarId;

    #[test]
    fn mizar_and_alcor_are_one_where_the_camera_cannot_part_them() {
        // Mizar (HIP 65378, V 2.23) and Alcor (HIP 65477, V 3.99) stand 708.5 arcsec apart (Hipparcos).
        let table = |blend_arcsec: f64| {
            SolverCatalogue::new(&CatalogueOptions {
                tdb_s: 0.0,
                diagonal_rad: 0.1,
                field_sr: 0.01,
                blend_rad: (blend_arcsec / 3600.0).to_radians(),
                stars_in_field: 10.0,
            })
        };
        let find = |t: &SolverCatalogue, hip: u32| {
            (0..t.entries.len()).find(|&at| t.star(at).id == StarId::Hipparcos(hip))
        };
        let apart = table(650.0);
        assert!(find(&apart, 65378).is_some() && find(&apart, 65477).is_some());
        let joined = table(740.0);
        assert!(find(&joined, 65477).is_none());
        let at = find(&joined, 65378).unwrap();
        let entry = joined.entry(at);
        // Light 1 : 0.1977 (1.76 mag): 0.196 mag brighter (other faint neighbours add a few thousandths), the centre
        // 117 arcsec towards Alcor.
        let alone = joined.star(at).v_magnitude;
        assert!((alone - entry.magnitude - 0.196).abs() < 0.02, "{}", alone - entry.magnitude);
        let off_arcsec = entry.offset.length().to_degrees() * 3600.0;
        assert!((off_arcsec - 117.0).abs() < 6.0, "{off_arcsec}");
    }
}
