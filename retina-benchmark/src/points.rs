//! Campaigns of points: exposures of a display, effects, noise that depends on brightness, common shifts, outliers.

use std::fmt::Write as _;

use glam::DVec2;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, StandardNormal};

use crate::algebra::{beside, rms};
use crate::forms::{HALF, Nature, Point, distorted, seen};

pub(crate) const ARCSEC: f64 = 1.0 / retina_geometry::ARCSEC_PER_RAD;
/// The wide configuration: 25 mm, 3.45 um, 2048 x 1536; K_f over 1200 rows.
const CAMERA_FOCAL_PX: f64 = 25.0 / 0.003_45;
const CAMERA_PX: DVec2 = DVec2::new(2048.0, 1536.0);
const SCREEN_FOCAL_PX: f64 = CAMERA_FOCAL_PX * 1200.0 / 1536.0;
const SCREEN_CENTRE_PX: DVec2 = DVec2::new(960.0, 600.0);
/// Noise per axis of a bright point.
pub(crate) const NOISE_ARCSEC: f64 = 1.5;
const COUNTS: [f64; 6] = [18.0, 32.0, 60.0, 110.0, 180.0, 255.0];
const INTERVAL_S: f64 = 90.0;

/// Time constant of the mount that lags, in intervals between exposures.
const LAG: std::ops::Range<f64> = 1.5..5.0;

/// An exposure that is planned.
pub(crate) struct Shot {
    pub(crate) time_s: f64,
    pub(crate) temperature_c: f64,
    pub(crate) roll_deg: f64,
    pub(crate) mounting: usize,
    /// 0, 1, 2: r, g, b; 3: w.
    pub(crate) channel: usize,
    /// Place on the screen, px, and digital count.
    pub(crate) points: Vec<(DVec2, f64)>,
}

/// How the bench's temperature goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub(crate) enum Chamber {
    /// A control that hunts, with a disturbance.
    Hunting,
    /// One approach to a new temperature.
    WarmUp,
    /// Two cycles.
    Cycles,
}

/// A campaign without its effects.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Campaign {
    pub(crate) rows: usize,
    pub(crate) exposures: usize,
    /// Of each exposure, per axis, in units of the noise.
    pub(crate) jitter: f64,
    pub(crate) outliers: f64,
    pub(crate) colours: bool,
    pub(crate) chamber: Chamber,
    pub(crate) roll_deg: f64,
    pub(crate) seed: u64,
    /// Correlation of an exposure's shift with that of the one before.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub(crate) wander: f64,
}

/// Plans without a wandering mount read as they always did, and so does the hash of their truth.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde asks for a reference")]
fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

/// A hidden effect with its size: rms per axis over the noise, after the baseline.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub(crate) struct Hidden {
    pub(crate) id: String,
    pub(crate) strength: f64,
}

/// What a campaign gives.
pub(crate) struct Made {
    /// The table.
    pub(crate) text: String,
    /// What each effect adds to a row's line of sight in the facility's axes, both axes side by side, arcsec.
    pub(crate) fields: Vec<Vec<f64>>,
    /// Square of the correlation with the textbook's template beside the baseline, of each effect.
    pub(crate) r_squared: Vec<f64>,
    /// By how many sigmas each effect is found by who knows its true form and the noise, in these very data.
    pub(crate) oracle_sigma: Vec<f64>,
    /// Amplitudes that each effect was given, rad.
    pub(crate) amplitudes: Vec<f64>,
}

fn normal(random: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(random)
}

/// Constants of the effects of a facility; `stream` tells two of one set apart.
pub(crate) fn nature(seed: u64, stream: u64) -> Nature {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(100 + stream);
    Nature {
        along: DVec2::from_angle(random.random_range(0.0..std::f64::consts::TAU)),
        shape: random.random_range(0.0..1.0),
        step: random.random_range(0.2..0.8),
        seed: random.random(),
    }
}

impl Campaign {
    /// Points with their exposure, before effects and noise.
    fn points(&self, random: &mut ChaCha8Rng) -> Vec<(usize, Point)> {
        let temperatures = self.temperatures(random);
        let mut out = Vec::with_capacity(self.rows);
        let (mut lagged, lag) = (temperatures[0], random.random_range(LAG));
        let roll_rad = self.roll_deg.to_radians();
        let mut humidity = 50.0;
        for (exposure, &temperature_c) in temperatures.iter().enumerate() {
            lagged += (temperature_c - lagged) * (1.0 - f64::exp(-1.0 / lag));
            humidity += 0.2 * (50.0 - humidity) + 6.0 * normal(random);
            let count = (exposure + 1) * self.rows / self.exposures - exposure * self.rows / self.exposures;
            for _ in 0..count {
                let aim = DVec2::new(
                    random.random_range(20.0..CAMERA_PX.x - 20.0),
                    random.random_range(20.0..CAMERA_PX.y - 20.0),
                );
                let u = DVec2::from_angle(roll_rad).rotate((aim - 0.5 * CAMERA_PX) / CAMERA_FOCAL_PX);
                let count = COUNTS[random.random_range(0..COUNTS.len())];
                let mut point = Point {
                    r: distorted(u),
                    camera_px: DVec2::ZERO,
                    screen_px: u * SCREEN_FOCAL_PX + SCREEN_CENTRE_PX,
                    count,
                    f: (count / 255.0).powf(2.2),
                    time_s: INTERVAL_S * exposure as f64,
                    passed: exposure as f64 / (self.exposures as f64 - 1.0),
                    temperature_c,
                    lagged_c: lagged,
                    row_load: random.random_range(0.0..1.0),
                    humidity,
                    channel: if self.colours { random.random_range(0..3usize) } else { 3 },
                    roll_rad,
                };
                point.camera_px = camera_px(point.r, roll_rad, 0);
                out.push((exposure, point));
            }
        }
        out
    }

    fn temperatures(&self, random: &mut ChaCha8Rng) -> Vec<f64> {
        let mut now = 20.0;
        (0..self.exposures)
            .map(|exposure| {
                let passed = exposure as f64 / self.exposures as f64;
                match self.chamber {
                    Chamber::Hunting => {
                        let aim = 20.0 + 2.0 * (exposure as f64 * std::f64::consts::TAU / 17.0).sin();
                        now += 0.2 * (aim - now) + 0.05 * normal(random);
                        now
                    }
                    Chamber::WarmUp => 18.0 + 4.0 * (1.0 - (-3.0 * passed).exp()),
                    Chamber::Cycles => 20.0 + 2.0 * (2.0 * std::f64::consts::TAU * passed).sin(),
                }
            })
            .collect()
    }

    /// The campaign with effects; those of one facility keep their `natures` and, where they are given, `amplitudes`.
    pub(crate) fn make(&self, hidden: &[Hidden], natures: &[Nature], amplitudes: Option<&[f64]>) -> Made {
        let mut random = ChaCha8Rng::seed_from_u64(self.seed);
        let points = self.points(&mut random);
        let sigma: Vec<f64> = points.iter().map(|(_, p)| noise_arcsec(p.count)).collect();
        let weight: Vec<f64> = sigma.iter().flat_map(|s| [s.powi(-2); 2]).collect();
        let only: Vec<Point> = points.iter().map(|(_, p)| *p).collect();
        let base = baseline(&only);
        let field = |h: &Hidden, nature: &Nature, a: f64| -> Vec<f64> {
            let moved = |p: &Point| ((seen(&h.id, nature, a, p) - p.r) / ARCSEC).to_array();
            only.iter().flat_map(moved).collect()
        };
        let size = |field: &[f64]| rms(&beside(&base, field, &weight)) / NOISE_ARCSEC;
        let mut found: Vec<f64> = Vec::new();
        let mut fields: Vec<Vec<f64>> = Vec::new();
        for (k, (h, nature)) in hidden.iter().zip(natures).enumerate() {
            let mut a = NOISE_ARCSEC * ARCSEC;
            match amplitudes {
                Some(given) => a = given[k],
                // A form's size is nearly its amplitude's multiple.
                None => (0..6).for_each(|_| a *= h.strength / size(&field(h, nature, a)).max(1e-12)),
            }
            found.push(a);
            fields.push(field(h, nature, a));
        }
        let (noise, wild) = self.noise(&points, &sigma, &mut random);
        let mut text = String::from(
            "image,screen_x_px,screen_y_px,digital_count,camera_x_px,camera_y_px,channel,time_s,temperature_c,row_load,humidity,camera_roll_deg\n",
        );
        for (row, (exposure, p)) in points.iter().enumerate() {
            let off = off_arcsec(&fields, &noise, &wild, row);
            let px = camera_px(p.r + off * ARCSEC, p.roll_rad, 0);
            let _ = writeln!(text, "e{exposure:04},{},{}", cells(p, px), self.roll_deg);
        }
        let r_squared = hidden
            .iter()
            .zip(&fields)
            .zip(natures)
            .map(|((h, field), nature)| {
                let templates = crate::templates::of(&h.id, nature, &only);
                if templates.is_empty() {
                    return 0.0;
                }
                let own = beside(&base, field, &weight);
                let projected: Vec<Vec<f64>> = templates.iter().map(|t| beside(&base, t, &weight)).collect();
                1.0 - (rms(&beside(&projected, &own, &weight)) / rms(&own)).powi(2)
            })
            .collect();
        let exposure: Vec<usize> = points.iter().map(|(exposure, _)| *exposure).collect();
        let whiten = |values: &[f64]| self.whitened(values, &exposure, &sigma, &wild);
        let white_base: Vec<Vec<f64>> = base.iter().map(|column| whiten(column)).collect();
        let ones = vec![1.0; 2 * points.len()];
        let measured: Vec<f64> =
            (0..noise.len()).map(|at| noise[at] + fields.iter().map(|f| f[at]).sum::<f64>()).collect();
        let left = beside(&white_base, &whiten(&measured), &ones);
        let own: Vec<Vec<f64>> = fields.iter().map(|f| beside(&white_base, &whiten(f), &ones)).collect();
        let oracle_sigma = (0..own.len())
            .map(|k| {
                let others: Vec<Vec<f64>> =
                    own.iter().enumerate().filter(|(j, _)| *j != k).map(|(_, f)| f.clone()).collect();
                let alone = beside(&others, &own[k], &ones);
                let length = alone.iter().map(|v| v * v).sum::<f64>().sqrt().max(1e-300);
                alone.iter().zip(&left).map(|(a, b)| a * b).sum::<f64>() / length
            })
            .collect();
        Made { text, fields, r_squared, oracle_sigma, amplitudes: found }
    }

    /// Noise of each row, both axes side by side, with the shift that all points of an exposure share; and how far outliers
    /// are off.
    fn noise(
        &self,
        points: &[(usize, Point)],
        sigma: &[f64],
        random: &mut ChaCha8Rng,
    ) -> (Vec<f64>, Vec<DVec2>) {
        let mut noise = Vec::with_capacity(2 * points.len());
        let mut shift = DVec2::ZERO;
        let mut last = usize::MAX;
        let mut wild = vec![DVec2::ZERO; points.len()];
        for (row, (exposure, _)) in points.iter().enumerate() {
            if *exposure != last {
                let new = DVec2::new(normal(random), normal(random)) * self.jitter * NOISE_ARCSEC;
                let kept = if last == usize::MAX { 0.0 } else { self.wander };
                shift = shift * kept + new * (1.0 - kept * kept).sqrt();
                last = *exposure;
            }
            let own = DVec2::new(normal(random), normal(random)) * sigma[row];
            noise.extend((own + shift).to_array());
            if random.random_range(0.0..1.0) < self.outliers {
                let angle = random.random_range(0.0..std::f64::consts::TAU);
                wild[row] = DVec2::from_angle(angle) * random.random_range(15.0..200.0);
            }
        }
        (noise, wild)
    }

    /// Exposures that are planned, after the campaign and with its effects: a table with the camera's mountings. Points that
    /// the camera does not see are left out.
    pub(crate) fn follow(
        &self,
        shots: &[Shot],
        hidden: &[Hidden],
        natures: &[Nature],
        amplitudes: &[f64],
        seed: u64,
    ) -> String {
        let mut before = ChaCha8Rng::seed_from_u64(self.seed);
        let temperatures = self.temperatures(&mut before);
        let lag: f64 = before.random_range(LAG);
        let step = |lagged: f64, now: f64, intervals: f64| {
            lagged + (now - lagged) * (1.0 - f64::exp(-intervals / lag))
        };
        let mut lagged = temperatures.iter().fold(temperatures[0], |lagged, now| step(lagged, *now, 1.0));
        let mut last_s = INTERVAL_S * (self.exposures - 1) as f64;
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut points = Vec::new();
        let mut mountings = Vec::new();
        for (exposure, shot) in shots.iter().enumerate() {
            lagged = step(lagged, shot.temperature_c, (shot.time_s - last_s) / INTERVAL_S);
            last_s = shot.time_s;
            let roll_rad = shot.roll_deg.to_radians();
            for &(screen_px, count) in &shot.points {
                let r = distorted((screen_px - SCREEN_CENTRE_PX) / SCREEN_FOCAL_PX);
                let point = Point {
                    r,
                    camera_px: camera_px(r, roll_rad, shot.mounting),
                    screen_px,
                    count,
                    f: (count / 255.0).powf(2.2),
                    time_s: shot.time_s,
                    passed: shot.time_s / INTERVAL_S / (self.exposures as f64 - 1.0),
                    temperature_c: shot.temperature_c,
                    lagged_c: lagged,
                    row_load: random.random_range(0.0..1.0),
                    humidity: 50.0,
                    channel: shot.channel,
                    roll_rad,
                };
                let seen = point.camera_px;
                if seen.cmpge(DVec2::ZERO).all() && seen.cmple(CAMERA_PX).all() {
                    points.push((exposure, point));
                    mountings.push((shot.roll_deg, shot.mounting));
                }
            }
        }
        let sigma: Vec<f64> = points.iter().map(|(_, p)| noise_arcsec(p.count)).collect();
        let moved =
            |h: &Hidden, nature: &Nature, a: f64, p: &Point| (seen(&h.id, nature, a, p) - p.r) / ARCSEC;
        let fields: Vec<Vec<f64>> = hidden
            .iter()
            .zip(natures)
            .zip(amplitudes)
            .map(|((h, nature), a)| {
                points.iter().flat_map(|(_, p)| moved(h, nature, *a, p).to_array()).collect()
            })
            .collect();
        let (noise, wild) = self.noise(&points, &sigma, &mut random);
        let mut text = String::from(
            "image,screen_x_px,screen_y_px,digital_count,camera_x_px,camera_y_px,channel,time_s,temperature_c,row_load,humidity,camera_roll_deg,mounting\n",
        );
        for (row, (exposure, p)) in points.iter().enumerate() {
            let (roll_deg, mounting) = mountings[row];
            let off = off_arcsec(&fields, &noise, &wild, row);
            let px = camera_px(p.r + off * ARCSEC, p.roll_rad, mounting);
            let _ = writeln!(text, "f{exposure:04},{},{roll_deg},{mounting}", cells(p, px));
        }
        text
    }

    /// V^(-1/2) with the true noise and jitter; outliers do not count.
    fn whitened(&self, values: &[f64], exposure: &[usize], sigma: &[f64], wild: &[DVec2]) -> Vec<f64> {
        let mut out = values.to_vec();
        let variance = (self.jitter * NOISE_ARCSEC).powi(2);
        let weight = |row: usize| if wild[row] == DVec2::ZERO { sigma[row].powi(-2) } else { 0.0 };
        let mut start = 0;
        while start < exposure.len() {
            let end = start + exposure[start..].iter().take_while(|e| **e == exposure[start]).count();
            let sum: f64 = (start..end).map(weight).sum();
            let part = 1.0 - 1.0 / (1.0 + variance * sum).sqrt();
            for axis in 0..2 {
                let mean = (start..end).map(|row| weight(row) * values[2 * row + axis]).sum::<f64>()
                    / sum.max(1e-300);
                for row in start..end {
                    out[2 * row + axis] = weight(row).sqrt() * (values[2 * row + axis] - part * mean);
                }
            }
            start = end;
        }
        out
    }
}

/// Camera pixel of a line of sight in the facility's axes: the camera is turned, and a little beside its place, at each
/// mounting another one.
fn camera_px(r: DVec2, roll_rad: f64, mounting: usize) -> DVec2 {
    let anew = DVec2::from_angle(2.4 * mounting as f64) * 1e-4 * mounting.min(1) as f64;
    let turned = DVec2::from_angle(0.01 + anew.x - roll_rad).rotate(r) * 1.002;
    (turned + DVec2::new(3e-4, -2e-4) + anew) * CAMERA_FOCAL_PX + 0.5 * CAMERA_PX
}

/// How far a row's line of sight is off.
fn off_arcsec(fields: &[Vec<f64>], noise: &[f64], wild: &[DVec2], row: usize) -> DVec2 {
    let effect: DVec2 = fields.iter().map(|f| DVec2::new(f[2 * row], f[2 * row + 1])).sum();
    effect + DVec2::new(noise[2 * row], noise[2 * row + 1]) + wild[row]
}

/// A row's cells, but for the exposure's name and the camera's mounting.
fn cells(p: &Point, camera_px: DVec2) -> String {
    format!(
        "{:.5},{:.5},{},{:.6},{:.6},{},{},{:.4},{:.4},{:.3}",
        p.screen_px.x,
        p.screen_px.y,
        p.count,
        camera_px.x,
        camera_px.y,
        ["r", "g", "b", "w"][p.channel],
        p.time_s,
        p.temperature_c,
        p.row_load,
        p.humidity,
    )
}

/// Noise per axis of a point.
fn noise_arcsec(count: f64) -> f64 {
    NOISE_ARCSEC * (1.0 + 0.3 * (255.0 / count - 1.0).min(8.0) / 8.0)
}

/// Shift, linear terms and radial k1 over the points.
fn baseline(points: &[Point]) -> Vec<Vec<f64>> {
    columns(points.iter().map(|p| p.screen_px))
}

fn columns(screen_px: impl Iterator<Item = DVec2>) -> Vec<Vec<f64>> {
    let forms: [fn(DVec2) -> DVec2; 7] = [
        |_| DVec2::X,
        |_| DVec2::Y,
        |u| DVec2::new(u.x, 0.0),
        |u| DVec2::new(u.y, 0.0),
        |u| DVec2::new(0.0, u.x),
        |u| DVec2::new(0.0, u.y),
        |u| u * u.length_squared(),
    ];
    let mut out = vec![Vec::new(); forms.len()];
    for px in screen_px {
        let u = (px - SCREEN_CENTRE_PX) / SCREEN_FOCAL_PX / HALF;
        for (column, form) in out.iter_mut().zip(forms) {
            column.extend(form(u).to_array());
        }
    }
    out
}

/// Baseline columns of a table's rows, and arcsec of a camera pixel.
pub(crate) fn baseline_of_table(text: &str) -> (Vec<Vec<f64>>, f64) {
    let points: Vec<DVec2> = text
        .lines()
        .skip(1)
        .filter_map(|line| {
            let mut cells = line.split(',').skip(1);
            Some(DVec2::new(cells.next()?.parse().ok()?, cells.next()?.parse().ok()?))
        })
        .collect();
    (columns(points.into_iter()), 1.0 / (CAMERA_FOCAL_PX * ARCSEC))
}

/// A campaign of white points as a table, with an effect of three times the noise or none.
pub fn campaign_table(rows: usize, exposures: usize, effect: Option<&str>, seed: u64) -> String {
    let campaign = Campaign {
        rows,
        exposures,
        jitter: 0.3,
        outliers: 0.02,
        colours: false,
        chamber: Chamber::Hunting,
        roll_deg: 0.0,
        seed,
        wander: 0.0,
    };
    let hidden: Vec<Hidden> =
        effect.iter().map(|id| Hidden { id: (*id).to_owned(), strength: 3.0 }).collect();
    campaign.make(&hidden, &[nature(seed, 0)], None).text
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may fail")]

    use std::path::Path;

    use retina_geometry::Setup;

    use super::*;

    /// What a data set says of its rows, put into the order of the lines, is what the lines say: its own order is another.
    #[test]
    fn rows_come_back_in_the_tables_order() {
        let text = campaign_table(400, 8, None, 3);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.csv");
        std::fs::write(&path, &text).unwrap();
        let named = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/setups/wide-fov.toml");
        let data = crate::run::read(&Setup::named(&named, Path::new("")).unwrap(), &[path]).unwrap();
        let light = &data.covariate("log10_irradiance").unwrap().values;
        let pairs: Vec<f64> = light.iter().flat_map(|l| [*l, *l]).collect();
        let counts: Vec<f64> =
            text.lines().skip(1).map(|line| line.split(',').nth(3).unwrap().parse().unwrap()).collect();
        let found = data.in_table_order(&pairs);
        let of_line = |l: f64| (255.0 * 10f64.powf(l / 2.2)).round();
        let off = counts.iter().enumerate().filter(|(k, count)| of_line(found[2 * k]) != **count).count();
        assert_eq!(off, 0, "of {}", counts.len());
        assert_ne!(found, pairs);
    }
}
