//! The sensor: light to electrons to digital numbers.

use rayon::prelude::*;
use retina_geometry::{NoiseSetup, Setup};
use retina_radiometry::QuantumEfficiency;
use retina_simd::{Kernel, Level, whole_number};

use crate::noise::Noise;
use crate::{Imperfections, hash};

/// Dark current doubles over so many kelvin.
const DARK_DOUBLING_K: f64 = 6.5;
/// Temperature of the stated dark current, degC.
const DARK_REFERENCE_C: f64 = 20.0;

/// Fills in a row of mean electrons of an image, given its number and work space.
pub(crate) type Rows<'a> = dyn Fn(usize, &mut [f32], &mut Vec<f32>) + Sync + 'a;

/// A sensor with its own fixed patterns.
#[derive(Debug, Clone)]
pub struct Sensor {
    size_px: [usize; 2],
    efficiency: QuantumEfficiency,
    /// Electrons a digital number.
    pub gain_e_per_dn: f64,
    /// The same at the setup's own gain.
    base_e_per_dn: f64,
    full_well_e: f64,
    read_noise_e: f64,
    offset_dn: f64,
    largest_dn: f64,
    /// Response of each pixel, 1 on average.
    response: Vec<f32>,
    /// Offset of each pixel, electrons.
    offset_e: Vec<f32>,
    /// Dark current of a pixel at 20 degC, electrons a second.
    dark_e_s: f32,
    /// That of hot pixels, and where they are, row by row.
    hot_e_s: Vec<Vec<(usize, f32)>>,
    nonlinearity: f64,
    blooming: f64,
    stray_e_s: [f64; 3],
}

/// The setup's quantum efficiency, by default that of the paper's camera.
pub(crate) fn efficiency_of(noise: &NoiseSetup) -> QuantumEfficiency {
    noise.quantum_efficiency.clone().map_or_else(QuantumEfficiency::paper_camera, QuantumEfficiency::new)
}

impl Sensor {
    /// The setup's sensor; `seed` fixes its patterns.
    pub fn new(setup: &Setup, wrong: &Imperfections, seed: u64) -> Self {
        let noise = &setup.noise;
        let size_px = [setup.camera.width_px as usize, setup.camera.height_px as usize];
        let largest_dn = 2f64.powi(setup.camera.bits as i32) - 1.0;
        let count = (size_px[0] * size_px[1]) as u64;
        let pattern = |f: &(dyn Fn(u64) -> f64 + Sync)| -> Vec<f32> {
            (0..count).into_par_iter().map(|i| f(i) as f32).collect()
        };
        let hot = |y: usize| {
            let of = |x: usize| {
                let i = (y * size_px[0] + x) as u64;
                let hot = hash::uniform(seed ^ 0x686f_7400, i) < noise.hot_pixels;
                let times = || 10f64.powf(2.0 + 2.0 * hash::uniform(seed ^ 0x686f_7401, i));
                hot.then(|| (x, (noise.dark_e_s * times()) as f32))
            };
            (0..size_px[0]).filter_map(of).collect()
        };
        let efficiency = efficiency_of(noise);
        let base_e_per_dn =
            noise.gain_e_per_dn.unwrap_or(noise.full_well_e / (largest_dn - noise.offset_dn).max(1.0));
        Self {
            size_px,
            efficiency,
            gain_e_per_dn: base_e_per_dn,
            base_e_per_dn,
            full_well_e: noise.full_well_e,
            read_noise_e: noise.read_noise_e,
            offset_dn: noise.offset_dn,
            largest_dn,
            response: pattern(&|i| 1.0 + noise.prnu * hash::normal(seed ^ 0x7072_6e75, i)),
            offset_e: pattern(&|i| noise.dsnu_e * hash::normal(seed ^ 0x6473_6e75, i)),
            dark_e_s: noise.dark_e_s as f32,
            hot_e_s: (0..size_px[1]).into_par_iter().map(hot).collect(),
            nonlinearity: wrong.nonlinearity,
            blooming: wrong.blooming,
            stray_e_s: wrong.stray_e_s,
        }
    }

    /// Sets the gain: `factor` times the setup's digital numbers for the same charge.
    pub fn set_gain(&mut self, factor: f64) {
        self.gain_e_per_dn = self.base_e_per_dn / factor;
    }

    /// Its quantum efficiency.
    pub fn efficiency(&self) -> &QuantumEfficiency {
        &self.efficiency
    }

    /// Charge at which a pixel is full, electrons.
    pub fn full_well_e(&self) -> f64 {
        self.full_well_e
    }

    /// Digital number at which a pixel is full or the digitiser ends.
    pub fn saturation_dn(&self) -> f64 {
        let full = self.full_well_e * (1.0 + self.nonlinearity) / self.gain_e_per_dn + self.offset_dn;
        full.min(self.largest_dn)
    }

    /// Largest digital number.
    pub fn largest_dn(&self) -> u16 {
        self.largest_dn as u16
    }

    /// Digital numbers of an exposure in which the light makes these mean electrons. The noise depends on `seed` and
    /// `frame` alone.
    pub(crate) fn read(
        &self,
        light_e: &Rows<'_>,
        exposure_s: f64,
        temperature_c: f64,
        seed: u64,
        frame: u64,
    ) -> Vec<u16> {
        let [width, height] = self.size_px;
        let warm = (exposure_s * 2f64.powf((temperature_c - DARK_REFERENCE_C) / DARK_DOUBLING_K)) as f32;
        let mut dn = vec![0u16; width * height];
        let key = hash::mix(seed ^ hash::mix(frame));
        let noise_of = |y: usize| Noise::new(hash::mix(key ^ hash::mix(y as u64)));
        let level = Level::detect();
        let exposed = |y: usize, noise: &mut Noise, charge: &mut [f32], space: &mut Vec<f32>| {
            light_e(y, charge, space);
            level.run(Exposed { sensor: self, y, exposure_s, warm, noise, charge, space });
        };
        let digitised =
            |y: usize, charge: &[f32], noise: &mut Noise, space: &mut Vec<f32>, dn: &mut [u16]| {
                space.resize(width, 0.0);
                level.run(Digitised { sensor: self, y, charge, noise, normals: space, dn });
            };
        if self.blooming == 0.0 {
            dn.par_chunks_exact_mut(width).enumerate().for_each_init(
                || [vec![0f32; width], Vec::new()],
                |[charge, space], (y, row)| {
                    let mut noise = noise_of(y);
                    exposed(y, &mut noise, charge, space);
                    digitised(y, charge, &mut noise, space, row);
                },
            );
            return dn;
        }
        // Charge above full well runs along the column: all rows first.
        let (mut charge, mut noises): (Vec<Vec<f32>>, Vec<Noise>) = (0..height)
            .into_par_iter()
            .map_init(Vec::new, |space, y| {
                let (mut noise, mut charge) = (noise_of(y), vec![0f32; width]);
                exposed(y, &mut noise, &mut charge, space);
                (charge, noise)
            })
            .unzip();
        for x in 0..width {
            self.bloom(&mut charge, x);
        }
        dn.par_chunks_exact_mut(width)
            .zip(charge)
            .zip(&mut noises)
            .enumerate()
            .for_each_init(Vec::new, |space, (y, ((row, charge), noise))| {
                digitised(y, &charge, noise, space, row)
            });
        dn
    }

    /// Digital numbers of mean electrons without noise, fixed patterns and dark current.
    pub fn noiseless(&self, light_e: &[f32]) -> Vec<u16> {
        let (full, bend) = (self.full_well_e as f32, (self.nonlinearity / self.full_well_e) as f32);
        let (per_e, offset) = ((1.0 / self.gain_e_per_dn) as f32, self.offset_dn as f32 + 0.5);
        let dn = |light: &f32| {
            let held = light.min(full);
            (held * (1.0 + bend * held) * per_e + offset).clamp(0.0, self.largest_dn as f32) as u16
        };
        light_e.par_iter().map(dn).collect()
    }

    /// Mean electrons of row `y`, from those of the light: with stray light and dark current. `dark` is work space.
    #[inline(always)]
    fn mean_charge(&self, y: usize, exposure_s: f64, warm: f32, mean: &mut [f32], dark: &mut Vec<f32>) {
        let [width, height] = self.size_px;
        let response = &self.response[y * width..(y + 1) * width];
        dark.clear();
        dark.resize(width, self.dark_e_s);
        self.hot_e_s[y].iter().for_each(|&(x, hot)| dark[x] = hot);
        for ((mean, response), dark) in mean.iter_mut().zip(response).zip(&dark[..]) {
            *mean = *mean * response + dark * warm;
        }
        if self.stray_e_s == [0.0; 3] {
            return;
        }
        let [even, along_x, along_y] = self.stray_e_s.map(|e| e * exposure_s);
        let from_minus_one = |i: usize, size: usize| 2.0 * (i as f64 + 0.5) / size as f64 - 1.0;
        let even = even + along_y * from_minus_one(y, height);
        for (x, (mean, response)) in mean.iter_mut().zip(response).enumerate() {
            *mean += (even + along_x * from_minus_one(x, width)).max(0.0) as f32 * response;
        }
    }

    /// Digital numbers of a row's charge; `normals` is work space.
    #[inline(always)]
    fn digitise(&self, y: usize, charge: &[f32], noise: &mut Noise, normals: &mut [f32], dn: &mut [u16]) {
        noise.normals(normals);
        let full = self.full_well_e as f32;
        let bend = (self.nonlinearity / self.full_well_e) as f32;
        let (read, per_e) = (self.read_noise_e as f32, (1.0 / self.gain_e_per_dn) as f32);
        let (offset, largest) = (self.offset_dn as f32, self.largest_dn as f32);
        let offsets = &self.offset_e[y * dn.len()..];
        for (((dn, charge), normal), offset_e) in dn.iter_mut().zip(charge).zip(normals).zip(offsets) {
            let held = charge.min(full);
            let bent = held * (1.0 + bend * held);
            let volts = bent + offset_e + read * *normal;
            *dn = whole_number((volts * per_e + offset).clamp(0.0, largest)) as u16;
        }
    }

    /// Half of what a pixel cannot hold, times `blooming`, goes up the column and half down, until it finds
    /// room.
    fn bloom(&self, charge: &mut [Vec<f32>], x: usize) {
        let (full, share) = (self.full_well_e as f32, (0.5 * self.blooming) as f32);
        for downwards in [true, false] {
            let mut carried = 0.0;
            for k in 0..charge.len() {
                let y = if downwards { k } else { charge.len() - 1 - k };
                let own = charge[y][x];
                let excess = (own - full).max(0.0);
                let room = (full - own).max(0.0);
                let taken = room.min(carried);
                charge[y][x] = own + taken;
                carried = carried - taken + share * excess;
            }
        }
    }
}

/// A row's charge in an exposure, where the light's is.
struct Exposed<'a> {
    sensor: &'a Sensor,
    y: usize,
    exposure_s: f64,
    warm: f32,
    noise: &'a mut Noise,
    charge: &'a mut [f32],
    space: &'a mut Vec<f32>,
}

impl Kernel for Exposed<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.sensor.mean_charge(self.y, self.exposure_s, self.warm, self.charge, self.space);
        self.noise.poisson(self.charge);
    }
}

/// A row's digital numbers.
struct Digitised<'a> {
    sensor: &'a Sensor,
    y: usize,
    charge: &'a [f32],
    noise: &'a mut Noise,
    normals: &'a mut [f32],
    dn: &'a mut [u16],
}

impl Kernel for Digitised<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.sensor.digitise(self.y, self.charge, self.noise, self.normals, self.dn);
    }
}
