//! Point sources: an irradiance shared among neighbouring pixels so that its barycentre lies at a
//! sub-pixel position (paper, "Projection model").
//!
//! A source that three adjacent pixels can show takes three. A brighter one takes a disc of pixels at
//! the largest count with a dimmer rim, three pixels of which take up what rounding leaves. The counts
//! of the three are found jointly: the integers that minimise
//!
//! (|barycentre - wanted| / 0.05 px)^2 + ((magnitude - wanted) / 0.02)^2
//!
//! over all triples of counts, not three roundings.

use glam::{DMat3, DVec2, DVec3};
use retina_radiometry::ScreenResponse;

/// A position error that costs as much as [`MAGNITUDE_UNIT`].
const POSITION_UNIT_PX: f64 = 0.05;
/// A magnitude error that costs as much as [`POSITION_UNIT_PX`].
const MAGNITUDE_UNIT: f64 = 0.02;
/// A source dimmer than this part of the smallest count is not shown.
const LEAST_PART: f64 = 0.5;
/// A brighter source is no point any more; this many full pixels are shown of it.
const MOST_PIXELS: f64 = 10_000.0;
/// Passes that centre a disc: each leaves a few per cent of the offset.
const DISC_PASSES: usize = 12;
/// Halvings that find its radius.
const RADIUS_PASSES: usize = 40;

/// A pixel of the screen and how much light it sends, against one on the boresight at equal count.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Site {
    column: u32,
    row: u32,
    /// Its centre less the wanted position, px.
    offset_px: DVec2,
    /// Solid angle, boresight = 1.
    relative_sr: f64,
}

/// A lit pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Lit {
    /// Column, from 0.
    pub column: u32,
    /// Row, from 0.
    pub row: u32,
    /// Digital count, equal in all channels; above 0.
    pub count: u8,
}

/// A point source on the screen.
#[derive(Debug, Clone, PartialEq)]
pub struct Splat {
    /// The lit pixels.
    pub pixels: Vec<Lit>,
    /// Barycentre of their light, px.
    pub displayed_px: DVec2,
    /// Their light at the pupil, W m^-2 nm^-1.
    pub displayed_w_m2_nm: f64,
}

/// The screen as point sources see it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ground<'a> {
    pub(crate) response: &'a ScreenResponse,
    pub(crate) width_px: u32,
    pub(crate) height_px: u32,
}

impl Ground<'_> {
    /// Shows an irradiance (W m^-2 nm^-1, at the pupil) at a position of the screen, of a very bright
    /// source as much as [`MOST_PIXELS`] send. `relative_sr`
    /// gives a pixel's solid angle, boresight = 1, for the position of its centre. `None`: the
    /// position is off the screen, or the source dimmer than half of what count 1 sends.
    pub(crate) fn splat(
        &self,
        wanted_px: DVec2,
        wanted_w_m2_nm: f64,
        relative_sr: impl Fn(DVec2) -> f64,
    ) -> Option<Splat> {
        let size = DVec2::new(f64::from(self.width_px), f64::from(self.height_px));
        let two_by_two = self.width_px > 1 && self.height_px > 1;
        let inside = two_by_two && wanted_px.cmpge(DVec2::ZERO).all() && wanted_px.cmplt(size).all();
        if !(inside && wanted_w_m2_nm.is_finite() && wanted_w_m2_nm > 0.0) {
            return None;
        }
        let site = |column: u32, row: u32| {
            let center_px = DVec2::new(f64::from(column) + 0.5, f64::from(row) + 0.5);
            Site { column, row, offset_px: center_px - wanted_px, relative_sr: relative_sr(center_px) }
        };
        let cell = self.cell(wanted_px).map(|(column, row)| site(column, row));
        let most = MOST_PIXELS * self.response.brightest_w_m2_nm() * cell[0].relative_sr;
        let wanted = Wanted { response: self.response, flux: wanted_w_m2_nm.min(most) };
        if wanted_w_m2_nm < LEAST_PART * wanted.light(&cell[0], 1) {
            return None;
        }
        let pixels: Vec<(Site, u8)> = match wanted.in_cell(&cell) {
            Some(best) => best.sites.into_iter().zip(best.counts).filter(|(_, count)| *count > 0).collect(),
            None => wanted.disc(&self.near(wanted_px, wanted.pixels_needed(&cell[0]), site)),
        };
        let light = |(site, count): &(Site, u8)| wanted.light(site, *count);
        let total: f64 = pixels.iter().map(light).sum();
        let moment: DVec2 = pixels.iter().map(|pixel| light(pixel) * pixel.0.offset_px).sum();
        Some(Splat {
            displayed_px: wanted_px + moment / total,
            displayed_w_m2_nm: total,
            pixels: pixels
                .iter()
                .map(|(site, count)| Lit { column: site.column, row: site.row, count: *count })
                .collect(),
        })
    }

    /// The four pixels whose centres surround a position (at the border the nearest four): the one
    /// that holds it, its neighbour in the row, in the column, and the one across.
    fn cell(&self, at_px: DVec2) -> [(u32, u32); 4] {
        // Low and high of the two centres on either side, and which holds the position.
        let pair = |at: f64, length: u32| {
            let own = (at as u32).min(length - 1);
            let below = own > 0 && (at - at.floor() < 0.5 || own + 1 == length);
            (own, if below { own - 1 } else { own + 1 })
        };
        let (column, next_column) = pair(at_px.x, self.width_px);
        let (row, next_row) = pair(at_px.y, self.height_px);
        [(column, row), (next_column, row), (column, next_row), (next_column, next_row)]
    }

    /// The pixels about a position: enough for a disc that fills `count` of them.
    fn near(&self, at_px: DVec2, count: f64, site: impl Fn(u32, u32) -> Site) -> Vec<Site> {
        // At a corner of the screen a quarter of the disc has to do.
        let reach = (count / std::f64::consts::PI).sqrt() * 2.0 + 4.0;
        let span = |at: f64, length: u32| {
            let low = (at - reach).max(0.0) as u32;
            low..((at + reach).ceil() as u32).min(length)
        };
        span(at_px.y, self.height_px)
            .flat_map(|row| span(at_px.x, self.width_px).map(move |column| (column, row)))
            .map(|(column, row)| site(column, row))
            .collect()
    }
}

/// What is to be shown, in a frame whose origin is the wanted position.
struct Wanted<'a> {
    response: &'a ScreenResponse,
    flux: f64,
}

/// Flux and first moment that are fixed already.
#[derive(Debug, Clone, Copy, Default)]
struct Fixed {
    flux: f64,
    moment: DVec2,
}

/// The counts of three pixels and what they cost.
#[derive(Debug, Clone, Copy)]
struct Triple {
    sites: [Site; 3],
    counts: [u8; 3],
    cost: f64,
}

impl Wanted<'_> {
    /// What a pixel sends into the pupil.
    fn light(&self, site: &Site, count: u8) -> f64 {
        self.response.irradiance_w_m2_nm([count; 3]) * site.relative_sr
    }

    fn brightest(&self, site: &Site) -> f64 {
        self.response.brightest_w_m2_nm() * site.relative_sr
    }

    /// How many pixels at the largest count the flux fills.
    fn pixels_needed(&self, site: &Site) -> f64 {
        self.flux / self.brightest(site)
    }

    /// The best three of the four pixels about the position; `None` where they cannot send so much.
    fn in_cell(&self, cell: &[Site; 4]) -> Option<Triple> {
        let mut triples = [[0, 1, 2], [1, 0, 3], [2, 0, 3], [3, 1, 2]].map(|k| k.map(|k| cell[k]));
        // Triples that can share the flux exactly come first: they give the others a low bound.
        let fits = |sites: &[Site; 3]| {
            self.share(sites, Fixed::default()).is_some_and(|shares| self.within(sites, shares))
        };
        triples.sort_by_key(|sites| !fits(sites));
        // Within half a pixel of the screen's border no pixels surround the position.
        let at_border = cell[1].offset_px.x.abs() > 1.0 || cell[2].offset_px.y.abs() > 1.0;
        let can_show = fits(&triples[0]) || (at_border && self.pixels_needed(&cell[0]) < 1.0);
        if !can_show {
            return None;
        }
        let mut best: Option<Triple> = None;
        for sites in triples {
            let found = self.best_counts(sites, Fixed::default(), best.map(|b| b.cost));
            best = found.or(best);
        }
        best
    }

    /// A disc of pixels at the largest count, dimmer at its rim, three of which take up what the
    /// rounding of the others leaves.
    fn disc(&self, sites: &[Site]) -> Vec<(Site, u8)> {
        let shares = self.disc_shares(sites);
        let mut lit: Vec<(Site, u8)> = sites
            .iter()
            .zip(&shares)
            .map(|(site, share)| (*site, self.nearest_count(site, *share)))
            .filter(|(_, count)| *count > 0)
            .collect();
        let Some(three) = rim_of(&lit) else { return lit };
        let mut fixed = Fixed::default();
        for (_, (site, count)) in lit.iter().enumerate().filter(|(k, _)| !three.contains(k)) {
            let light = self.light(site, *count);
            fixed.flux += light;
            fixed.moment += light * site.offset_px;
        }
        if let Some(best) = self.best_counts(three.map(|k| lit[k].0), fixed, None) {
            for (k, count) in three.into_iter().zip(best.counts) {
                lit[k].1 = count;
            }
        }
        lit.retain(|(_, count)| *count > 0);
        lit
    }

    /// The light of each pixel of a disc with a rim one pixel wide, of the wanted flux, its centre
    /// such that the barycentre is the wanted position.
    fn disc_shares(&self, sites: &[Site]) -> Vec<f64> {
        let mut center = DVec2::ZERO;
        let mut shares = vec![0.0; sites.len()];
        // At the screen's border the barycentre cannot follow: then the centre stays near it.
        for _ in 0..DISC_PASSES {
            let (mut low, mut high) = (0.0, 2.0 + self.pixels_needed(&sites[0]).sqrt() * 2.0);
            for _ in 0..RADIUS_PASSES {
                let radius = 0.5 * (low + high);
                for (share, site) in shares.iter_mut().zip(sites) {
                    let weight = (0.5 + radius - site.offset_px.distance(center)).clamp(0.0, 1.0);
                    *share = weight * self.brightest(site);
                }
                if shares.iter().sum::<f64>() < self.flux { low = radius } else { high = radius }
            }
            let moment: DVec2 = sites.iter().zip(&shares).map(|(site, share)| *share * site.offset_px).sum();
            let off = moment / shares.iter().sum::<f64>();
            center = (center - off).clamp_length_max(1.0);
        }
        shares
    }

    /// The light of each of three pixels that gives the wanted flux and barycentre exactly;
    /// `None` where the three stand in a line.
    fn share(&self, sites: &[Site; 3], core: Fixed) -> Option<[f64; 3]> {
        let inverse = shares_from_moments(sites)?;
        let rest = DVec3::new(self.flux - core.flux, -core.moment.x, -core.moment.y);
        Some((inverse * rest).to_array())
    }

    fn within(&self, sites: &[Site; 3], shares: [f64; 3]) -> bool {
        let slack = 1e-12 * self.flux;
        sites.iter().zip(shares).all(|(site, share)| share >= -slack && share <= self.brightest(site))
    }

    fn cost(&self, sites: &[Site; 3], counts: [u8; 3], core: Fixed) -> f64 {
        let (mut flux, mut moment) = (core.flux, core.moment);
        for (site, count) in sites.iter().zip(counts) {
            let light = self.light(site, count);
            flux += light;
            moment += light * site.offset_px;
        }
        if flux <= 0.0 {
            return f64::INFINITY;
        }
        let magnitude_error = 2.5 * (flux / self.flux).log10();
        (moment / flux).length_squared() / POSITION_UNIT_PX.powi(2)
            + (magnitude_error / MAGNITUDE_UNIT).powi(2)
    }

    /// The counts of least cost, below `bound` where one is given: every triple that may cost
    /// less than the best so far is tried. A cost C bounds the barycentre to 0.05 px sqrt(C) of
    /// the wanted one and the flux to 0.02 mag sqrt(C), and so the light of each pixel.
    fn best_counts(&self, sites: [Site; 3], core: Fixed, bound: Option<f64>) -> Option<Triple> {
        let inverse = shares_from_moments(&sites)?;
        let mut best: Option<Triple> = None;
        let mut limit = bound.unwrap_or(f64::INFINITY);
        let consider = |counts: [u8; 3], limit: &mut f64, best: &mut Option<Triple>| {
            let cost = self.cost(&sites, counts, core);
            if cost < *limit {
                *limit = cost;
                *best = Some(Triple { sites, counts, cost });
            }
        };
        let shares = inverse * DVec3::new(self.flux - core.flux, -core.moment.x, -core.moment.y);
        let rounded = [0, 1, 2].map(|k| self.nearest_count(&sites[k], shares[k]));
        consider(rounded, &mut limit, &mut best);
        for k in 0..3 {
            for step in [-1i16, 1] {
                let mut counts = rounded;
                counts[k] = (i16::from(counts[k]) + step).clamp(0, 255) as u8;
                consider(counts, &mut limit, &mut best);
            }
        }
        let ranges = [0, 1, 2].map(|k| self.counts_within(&sites[k], inverse.row(k), core, limit));
        for a in ranges[0].clone() {
            for b in ranges[1].clone() {
                for c in ranges[2].clone() {
                    consider([a, b, c], &mut limit, &mut best);
                }
            }
        }
        best
    }

    fn nearest_count(&self, site: &Site, light: f64) -> u8 {
        self.response.nearest_count((light / site.relative_sr).max(0.0) as f32)
    }

    /// The counts that a pixel may have in a triple that costs at most `limit`; `row` is its row
    /// of the inverse.
    fn counts_within(
        &self,
        site: &Site,
        row: DVec3,
        core: Fixed,
        limit: f64,
    ) -> std::ops::RangeInclusive<u8> {
        // Far from any solution the bound says nothing; 10 magnitudes are far.
        let root = limit.sqrt().min(10.0 / MAGNITUDE_UNIT);
        let reach_px = POSITION_UNIT_PX * root;
        let factor = 10f64.powf(0.4 * MAGNITUDE_UNIT * root);
        let gradient = DVec2::new(row.y, row.z);
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for flux in [self.flux / factor, self.flux * factor] {
            let share = row.x * (flux - core.flux) - gradient.dot(core.moment);
            let slack = gradient.length() * reach_px * flux;
            low = low.min(share - slack);
            high = high.max(share + slack);
        }
        // One count beyond on each side: the nearest count rounds.
        let first = self.nearest_count(site, low).saturating_sub(1);
        first..=self.nearest_count(site, high).saturating_add(1)
    }
}

/// Three pixels of a disc that are neither dark nor full, farthest from its middle in three
/// directions; `None` where it has no such three.
fn rim_of(lit: &[(Site, u8)]) -> Option<[usize; 3]> {
    let mut chosen = [0; 3];
    for (turn, place) in chosen.iter_mut().enumerate() {
        let direction = DVec2::from_angle(std::f64::consts::TAU * turn as f64 / 3.0);
        let rim = lit.iter().enumerate().filter(|(_, (_, count))| (16..240).contains(count));
        let along = |(_, (site, _)): &(usize, &(Site, u8))| site.offset_px.dot(direction);
        *place = rim.max_by(|a, b| along(a).total_cmp(&along(b)))?.0;
    }
    let [a, b, c] = chosen;
    (a != b && b != c && a != c).then_some(chosen)
}

/// Takes (flux, moment) to the light of each of three pixels; `None` where they stand in a line.
fn shares_from_moments(sites: &[Site; 3]) -> Option<DMat3> {
    let columns = sites.map(|site| DVec3::new(1.0, site.offset_px.x, site.offset_px.y));
    let moments = DMat3::from_cols_array_2d(&columns.map(|column| column.to_array()));
    (moments.determinant().abs() > 0.5).then(|| moments.inverse())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use retina_radiometry::{irradiance_of_magnitude_w_m2_nm, magnitude_of_irradiance};

    const SIZE_PX: u32 = 64;

    fn splat(response: &ScreenResponse, at_px: DVec2, magnitude: f64) -> Option<Splat> {
        let ground = Ground { response, width_px: SIZE_PX, height_px: SIZE_PX };
        ground.splat(at_px, irradiance_of_magnitude_w_m2_nm(magnitude), |_| 1.0)
    }

    fn wide() -> ScreenResponse {
        ScreenResponse::power_law(2.2, -1.44)
    }

    fn cost_of(splat: &Splat, at_px: DVec2, magnitude: f64) -> f64 {
        let off = magnitude_of_irradiance(splat.displayed_w_m2_nm) - magnitude;
        (splat.displayed_px.distance(at_px) / 0.05).powi(2) + (off / 0.02).powi(2)
    }

    /// The least cost of any counts in any three pixels of the cell, by trying them all.
    fn exhaustive(response: &ScreenResponse, at_px: DVec2, magnitude: f64, largest: u8) -> f64 {
        let wanted = irradiance_of_magnitude_w_m2_nm(magnitude);
        let low = (at_px - 0.5).floor();
        let centers = [(0.5, 0.5), (1.5, 0.5), (0.5, 1.5), (1.5, 1.5)].map(|(x, y)| low + DVec2::new(x, y));
        let mut least = f64::INFINITY;
        for skipped in 0..4 {
            let three: Vec<DVec2> = (0..4).filter(|&k| k != skipped).map(|k| centers[k]).collect();
            for a in 0..=largest {
                for b in 0..=largest {
                    for c in 0..=largest {
                        let light = [a, b, c].map(|n| response.irradiance_w_m2_nm([n; 3]));
                        let flux: f64 = light.iter().sum();
                        if flux == 0.0 {
                            continue;
                        }
                        let at: DVec2 = light.iter().zip(&three).map(|(e, p)| *e * *p).sum::<DVec2>() / flux;
                        let off = 2.5 * (flux / wanted).log10();
                        least = least.min((at.distance(at_px) / 0.05).powi(2) + (off / 0.02).powi(2));
                    }
                }
            }
        }
        least
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn no_counts_do_better(x in 20.0..21.0f64, y in 30.0..31.0f64, magnitude in 4.5..9.0f64) {
            let response = wide();
            let at = DVec2::new(x, y);
            let found = cost_of(&splat(&response, at, magnitude).unwrap(), at, magnitude);
            // 4.5 mag in one pixel is count 21.
            let least = exhaustive(&response, at, magnitude, 24);
            prop_assert!((found - least).abs() < 1e-6 * (1.0 + least), "{found} {least}");
        }

        #[test]
        fn bright_sources_are_shown_well_and_compactly(
            x in 20.0..40.0f64, y in 20.0..40.0f64, magnitude in -7.0..3.0f64,
        ) {
            let response = wide();
            let at = DVec2::new(x, y);
            let shown = splat(&response, at, magnitude).unwrap();
            // A step of a count near 50 is 4 % of a pixel's light: a few hundredths of the units.
            prop_assert!(cost_of(&shown, at, magnitude) < 0.3);
            // Not much wider than the disc of so many pixels.
            let filled = irradiance_of_magnitude_w_m2_nm(magnitude) / response.brightest_w_m2_nm();
            let reach = shown.pixels.iter().map(|p| {
                DVec2::new(f64::from(p.column) + 0.5, f64::from(p.row) + 0.5).distance(at)
            }).fold(0.0, f64::max);
            prop_assert!(reach < (filled / std::f64::consts::PI).sqrt() + 1.7, "{reach} for {filled} pixels");
            // Every pixel stands once.
            let mut places: Vec<_> = shown.pixels.iter().map(|p| (p.column, p.row)).collect();
            places.sort_unstable();
            places.dedup();
            prop_assert_eq!(places.len(), shown.pixels.len());
        }
    }

    #[test]
    fn jupiter_at_minus_2_26_takes_more_than_two_full_pixels() {
        // 10^((2.26 - 1.44) / 2.5) = 2.13 pixels at 255.
        let shown = splat(&wide(), DVec2::new(30.31, 30.77), -2.26).unwrap();
        assert!(shown.pixels.len() >= 3);
        assert!((magnitude_of_irradiance(shown.displayed_w_m2_nm) + 2.26).abs() < 1e-3);
    }

    #[test]
    fn what_cannot_be_shown_is_not() {
        let response = wide();
        // Count 1 is -1.44 + 5.5 log10 255 = 11.80; half of it 12.55.
        assert!(splat(&response, DVec2::new(9.3, 9.2), 12.5).is_some());
        assert!(splat(&response, DVec2::new(9.3, 9.2), 12.6).is_none());
        for off in [DVec2::new(-0.1, 5.0), DVec2::new(5.0, 64.0), DVec2::new(f64::NAN, 5.0)] {
            assert!(splat(&response, off, 3.0).is_none());
        }
    }

    #[test]
    fn at_the_border_the_flux_is_kept() {
        for (at, magnitude) in
            [(DVec2::new(0.1, 0.2), 5.0), (DVec2::new(63.9, 30.0), 2.0), (DVec2::new(0.1, 63.9), -3.0)]
        {
            let shown = splat(&wide(), at, magnitude).unwrap();
            let off = magnitude_of_irradiance(shown.displayed_w_m2_nm) - magnitude;
            assert!(off.abs() < 0.35 && shown.displayed_px.distance(at) < 1.6, "{at} {off} {shown:?}");
        }
    }
}
