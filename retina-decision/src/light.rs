//! How bright the table's points were, and what a planned point of some brightness would give.

use retina_formats::{Channel, PointRow, PointsTable, log10_irradiance, measured_or_power_law};
use retina_geometry::Setup;
use retina_radiometry::ScreenResponse;

/// Points of a curve.
const CURVE: usize = 20;
/// Counts between which a display's light is known.
const BRIGHTEST: u8 = 255;
const FAINTEST: u8 = 8;
/// Share of the table's points that are fainter than a well exposed one.
const WELL_EXPOSED: f64 = 0.9;

/// Light of a table's points.
pub(crate) struct Light {
    response: ScreenResponse,
    /// Counts that the table has, brightest first; where exposure times are known, brighter and fainter ones too.
    counts: Vec<u8>,
    /// Irradiance times exposure time of a well exposed point; `None` where the table has no exposure times.
    exposed: Option<f64>,
    /// ln of irradiance times exposure, standard deviation of the centroid, DN over irradiance times exposure.
    curve: Vec<(f64, Option<f64>, Option<f64>)>,
}

impl Light {
    pub(crate) fn of(table: &PointsTable, setup: &Setup) -> Self {
        let response = measured_or_power_law(None, setup);
        let usable: Vec<&PointRow> = table.rows.iter().filter(|row| !row.saturated).collect();
        let mut counts: Vec<u8> = usable.iter().map(|row| row.digital_count.round().max(1.0) as u8).collect();
        let with_time = usable.iter().all(|row| row.exposure_s.is_some());
        if with_time {
            // The exposure time makes up for the brightness.
            counts.extend([BRIGHTEST, FAINTEST]);
        }
        counts.sort_unstable_by(|a, b| b.cmp(a));
        counts.dedup();
        let mut doses: Vec<(f64, &PointRow)> = usable
            .iter()
            .map(|row| {
                let irradiance = 10f64.powf(log10_irradiance(&response, row.channel, row.digital_count));
                (irradiance * row.exposure_s.unwrap_or(1.0), *row)
            })
            .collect();
        doses.sort_by(|a, b| a.0.total_cmp(&b.0));
        let at = ((doses.len() as f64 * WELL_EXPOSED) as usize).min(doses.len().saturating_sub(1));
        let exposed = doses.get(at).map(|(dose, _)| *dose).filter(|_| with_time);
        let size = doses.len().div_ceil(CURVE).max(1);
        let curve = doses
            .chunks(size)
            .map(|chunk| {
                let of = |value: &dyn Fn(f64, &PointRow) -> Option<f64>| {
                    let mut values: Vec<f64> =
                        chunk.iter().filter_map(|(dose, row)| value(*dose, row)).collect();
                    values.sort_by(f64::total_cmp);
                    values.get(values.len() / 2).copied()
                };
                let dose = chunk[chunk.len() / 2].0;
                (
                    dose.max(f64::MIN_POSITIVE).ln(),
                    of(&|_, row| row.sigma_px),
                    of(&|dose, row| row.flux_dn.map(|flux| flux / dose)),
                )
            })
            .collect();
        Self { response, counts, exposed, curve }
    }

    pub(crate) fn irradiance(&self, channel: Channel, count: u8) -> f64 {
        10f64.powf(log10_irradiance(&self.response, channel, f64::from(count)))
    }

    /// The table's counts, in groups that one exposure holds.
    pub(crate) fn counts_alike(&self, channel: Channel, holds: f64) -> Vec<Vec<u8>> {
        let mut out: Vec<Vec<u8>> = Vec::new();
        for &count in &self.counts {
            match out.last_mut() {
                Some(group)
                    if self.exposed.is_none()
                        || self.irradiance(channel, group[0]) <= holds * self.irradiance(channel, count) =>
                {
                    group.push(count);
                }
                _ => out.push(vec![count]),
            }
        }
        out
    }

    /// Some of the counts, evenly from the brightest to the faintest.
    pub(crate) fn single_counts(&self, most: usize) -> Vec<u8> {
        let last = self.counts.len().saturating_sub(1);
        let few = most.min(self.counts.len());
        let mut out: Vec<u8> =
            (0..few).map(|k| self.counts[k * last / few.saturating_sub(1).max(1)]).collect();
        out.dedup();
        out
    }

    /// The exposure time that suits the brightest of some counts, s.
    pub(crate) fn exposure_s(&self, channel: Channel, counts: &[u8], relative: f64) -> Option<f64> {
        let brightest = counts.iter().map(|&count| self.irradiance(channel, count)).fold(0.0, f64::max);
        let exposure_s = self.exposed? / brightest.max(f64::MIN_POSITIVE) * relative;
        // Three digits are what an operator types.
        let unit = 10f64.powf(exposure_s.log10().floor() - 2.0);
        Some((exposure_s / unit).round() * unit)
    }

    /// Standard deviation of a point's centroid, px, and its light, DN, as the table's points of its brightness have them.
    pub(crate) fn seen(&self, channel: Channel, count: u8, exposure_s: Option<f64>) -> [Option<f64>; 2] {
        let dose = self.irradiance(channel, count) * exposure_s.unwrap_or(1.0);
        let ln = dose.max(f64::MIN_POSITIVE).ln();
        let nearest = self.curve.iter().min_by(|a, b| (a.0 - ln).abs().total_cmp(&(b.0 - ln).abs()));
        let (_, sigma_px, per_dose) = nearest.copied().unwrap_or((0.0, None, None));
        [sigma_px, per_dose.map(|flux| flux * dose)]
    }
}
