//! The stars that an image of a certain scale can show: close ones merged, and which of them lie near a direction.

use glam::DVec3;
use retina_sky::catalogue::Star;

use super::sky_index::SkyIndex;

/// A star, or several that are seen as one.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Entry {
    /// Its brightest star, as an index into the catalogue's stars.
    star: u32,
    /// V of the whole.
    pub(crate) magnitude: f64,
    /// From the brightest star to the centre of light.
    pub(crate) offset: DVec3,
}

/// The catalogue as a camera sees it whose pixels part stars down to one angle.
#[derive(Debug, Clone)]
pub(crate) struct Sky {
    stars: &'static [Star],
    entries: Vec<Entry>,
    /// The places of all entries, of the brighter half, of its brighter half, and so on.
    nested: Vec<SkyIndex>,
}

/// Fewest entries of a nested index.
const FEWEST_NESTED: usize = 400;

impl Sky {
    /// Joins each of the `used` stars (at `directions`) with brighter ones closer than `blend_rad`.
    pub(crate) fn new(stars: &'static [Star], used: &[u32], directions: &[DVec3], blend_rad: f64) -> Self {
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
            entries.push(Entry {
                star: used[i],
                magnitude: -2.5 * sum.log10(),
                offset: place - directions[i],
            });
            places.push(place);
        }
        // Entries stay in the catalogue's order, brightest first but for what merging adds.
        let mut nested = Vec::new();
        let mut count = places.len();
        while nested.is_empty() || count >= FEWEST_NESTED {
            // Some two entries a cell.
            let cell_rad = (8.0 * std::f64::consts::PI / count.max(1) as f64).sqrt();
            nested.push(SkyIndex::new(places[..count].to_vec(), cell_rad));
            count /= 2;
        }
        Self { stars, entries, nested }
    }

    /// The entry of an index.
    pub(crate) fn entry(&self, at: usize) -> &Entry {
        &self.entries[at]
    }

    /// The brightest star of an entry.
    pub(crate) fn star(&self, at: usize) -> &'static Star {
        &self.stars[self.entries[at].star as usize]
    }

    /// All entries by place.
    pub(crate) fn all(&self) -> &SkyIndex {
        &self.nested[0]
    }

    /// The brightest entries by place: as few as have `wanted` within a cone on average.
    pub(crate) fn brightest(&self, cone_rad: f64, wanted: usize) -> &SkyIndex {
        let share = 0.5 * (1.0 - cone_rad.cos());
        let enough = |index: &&SkyIndex| index.directions().len() as f64 * share >= wanted as f64;
        self.nested.iter().rev().find(enough).unwrap_or(&self.nested[0])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use retina_sky::catalogue::{StarCatalogue, StarId};

    #[test]
    fn mizar_and_alcor_are_one_where_the_camera_cannot_part_them() {
        // Mizar (HIP 65378, V 2.23) and Alcor (HIP 65477, V 3.99) stand 708.5 arcsec apart (Hipparcos).
        let stars = StarCatalogue::embedded().stars();
        let used: Vec<u32> =
            (0..stars.len() as u32).filter(|at| !stars[*at as usize].notes.doubtful).collect();
        let directions: Vec<DVec3> =
            used.iter().map(|at| stars[*at as usize].direction_from(DVec3::ZERO, 0.0)).collect();
        let sky = |arcsec: f64| Sky::new(stars, &used, &directions, (arcsec / 3600.0).to_radians());
        let find = |sky: &Sky, hip: u32| {
            (0..sky.entries.len()).find(|&at| sky.star(at).id == StarId::Hipparcos(hip))
        };
        let apart = sky(650.0);
        assert!(find(&apart, 65378).is_some() && find(&apart, 65477).is_some());
        let joined = sky(740.0);
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

    #[test]
    fn the_brightest_are_a_beginning_of_all() {
        let stars = StarCatalogue::embedded().stars();
        let used: Vec<u32> = (0..stars.len() as u32).collect();
        let directions: Vec<DVec3> = stars.iter().map(|star| star.direction).collect();
        let sky = Sky::new(stars, &used, &directions, 0.0);
        // A cone of 0.1 rad is 0.0025 of the sky: 100 in it are 40 000 of it.
        let some = sky.brightest(0.1, 20);
        assert_eq!(some.directions(), &sky.all().directions()[..some.directions().len()]);
        assert!((8_000..16_100).contains(&some.directions().len()), "{}", some.directions().len());
        assert_eq!(sky.brightest(0.01, 1000).directions().len(), sky.all().directions().len());
    }
}
