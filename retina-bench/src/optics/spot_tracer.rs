//! What the display's depth and the objective's coma do to where a detector finds spots.

use std::f64::consts::PI;
use std::ops::Range;

use glam::{DMat2, DMat3, DVec2, DVec3};
use rayon::prelude::*;
use retina_geometry::{
    COMAS_MM, ComaForm, ComaShifts, ComaTracer, DEPTHS_MM, RADIAL_KNOTS, RadialTable, Setup, SpotShifts,
};
use retina_image::WidthMap;
use retina_optics::facility::{
    COMA, Kernel, KernelFrame, KernelGrid, SlopeFit, SpectralLine, WAVEFRONT_TERMS, Wavefront, clear_kernel,
};
use retina_optics::pupil::{PupilPoint, gaussian};
use retina_optics::{Clipping, Launcher, OpticsError, RayBatch, Tracer};

use super::windowed::{Window, windowed_as, windowed_in};
use super::{channel_lines, facility_system};
use crate::sensor::efficiency_of;
use crate::{BenchError, Display};

/// Depth over which the response to coma is taken, mm: that of the edge of a display tilted by a tenth of a degree.
const COMA_DEPTH_MM: f64 = 0.02;
/// Part of a coma by which it is changed for its derivative: bright cores move by steps that are finer than this.
const COMA_STEP: f64 = 0.05;
/// Half the even coma over which the response is taken, mm of path at the pupil's rim.
const EVEN_COMA_MM: f64 = 1e-4;
/// Rays over the pupil: they determine a wavefront.
const RINGS: usize = 9;
const ARMS: usize = 22;
/// Samples of an image a pixel, and how far it reaches, px.
const PER_PX: usize = 4;
const HALF_PX: usize = 10;
/// Azimuths at which sub-pixels side by side are seen, from the display's x, rad.
const AZIMUTHS: [f64; 5] = [0.0, 0.25 * PI, 0.5 * PI, 0.75 * PI, PI];
/// Azimuths at which the spots' widths are laid out over the camera.
const ROUND_THE_AXIS: usize = 16;
/// Step of a line of sight for its derivatives, tangents.
const STEP: f64 = 1e-4;

/// A facility as detectors see it: places of the display with the light that they send, from which follow what the
/// display's depth and the objective's coma do ([`SpotShifts`]). By images of points at the lit channels' wavelengths, seen
/// by a detector.
#[derive(Debug)]
pub struct SpotTracer {
    half_tan: f64,
    focal_px: f64,
    /// Half the camera's width.
    half_width_tan: f64,
    /// Width and height of the camera, px.
    size_px: [f64; 2],
    emission: Emission,
    /// From the first off the axis to the largest line of sight.
    places: Vec<Place>,
}

/// A place of the display.
#[derive(Debug)]
struct Place {
    /// Tangent of the line of sight on which its light is, on the average.
    tangent: f64,
    /// Height on the display over the tangent of the line of sight on which the detector finds it, mm.
    height_over_tangent_mm: f64,
    px_per_mm: f64,
    /// Its light with the display where it is, and [`COMA_DEPTH_MM`] away.
    waves: [Vec<Wave>; 2],
    /// Tangent of the line of sight on which it is found in a window as wide as its own spot.
    seen: f64,
    /// Its light at each of [`AZIMUTHS`], where sub-pixels stand side by side; empty where one channel is lit.
    turned: Vec<Vec<Wave>>,
    /// See [`SpotShifts`].
    per_depth: [f64; DEPTHS_MM.len()],
}

type Wave = (Wavefront, SpectralLine);

/// Lines of sight on which a detector finds the places, tangents, and the widths that it takes for the spots'.
struct Seen {
    at: Vec<DVec2>,
    widths_px: Vec<f64>,
}

/// What emits on the display, mm.
#[derive(Debug)]
struct Emission {
    /// Extent of a box of the whole light's second moments, the mean of both axes.
    whole_mm: f64,
    /// That of a sub-pixel along the display's axes.
    sub_pixel_mm: [f64; 2],
}

impl SpotTracer {
    /// Traces the setup's lenses. `half_tan` is the largest line of sight's tangent; `lit` are the channels (red, green,
    /// blue) of which points are made.
    ///
    /// # Errors
    /// As [`facility_system`]; a ray that does not arrive.
    pub fn new(setup: &Setup, half_tan: f64, lit: Range<usize>) -> Result<Self, BenchError> {
        let system = facility_system(setup)?;
        let launcher = Launcher::new(&system)?;
        let display = Display::new(setup, 0);
        // Three lines of one channel, one of each of several: all channels of white light make as many electrons.
        let lines = channel_lines(setup, &efficiency_of(&setup.noise), if lit.len() > 1 { 1 } else { 3 });
        let fans = lit
            .clone()
            .flat_map(|channel| lines[channel].iter().map(move |line| (channel, line)))
            .map(|(channel, &(nm, weight))| {
                let stripe_mm = display.stripe_px[channel] * display.pitch_mm[0];
                let weight = weight / lit.len() as f64;
                Ok(Fan { nm, weight, stripe_mm, tracer: Tracer::new(&system, nm, Clipping::Off)? })
            })
            .collect::<Result<Vec<_>, OpticsError>>()?;
        let pupil = gaussian(RINGS, ARMS, 0.0);
        let spots = Spots {
            pupil_radius_mm: launcher.ray([0.0; 2], [1.0, 0.0])?.position_mm.x,
            launcher,
            fans,
            slopes: SlopeFit::new(&pupil.iter().map(|point| point.at).collect::<Vec<_>>()),
            pupil,
        };
        let focal_px = setup.camera_pinhole().fx_px;
        let mut tracer = Self {
            half_tan,
            focal_px,
            half_width_tan: 0.5 * f64::from(setup.camera.width_px) / focal_px,
            size_px: [setup.camera.width_px, setup.camera.height_px].map(f64::from),
            emission: Emission {
                whole_mm: 12f64.sqrt() * display.emission_sigma_mm(lit),
                sub_pixel_mm: [0, 1].map(|axis| display.emission_px[axis] * display.pitch_mm[axis]),
            },
            places: Vec::new(),
        };
        tracer.places = (1..RADIAL_KNOTS)
            .into_par_iter()
            .map(|k| tracer.place(&spots, RadialTable::place(half_tan, k)))
            .collect::<Result<Vec<_>, _>>()?;
        Ok(tracer)
    }

    /// What depth and coma do. Coma takes most of the time, and is left out where it is not wanted.
    ///
    /// # Errors
    /// An image of a point reaches no detector's window.
    pub fn shifts(&self, with_coma: bool) -> Result<SpotShifts, BenchError> {
        Ok(SpotShifts {
            height_mm: heights(self.half_tan, &self.places),
            per_depth: std::array::from_fn(|k| self.table(&|place| place.per_depth[k])),
            coma: if with_coma { Some(self.coma_shifts()?) } else { None },
        })
    }

    fn coma_shifts(&self) -> Result<ComaShifts, OpticsError> {
        let still = self.both_depths(0.0)?;
        let mut forms = COMAS_MM
            .iter()
            .map(|&coma_mm| Ok(self.form(coma_mm, &self.both_depths(coma_mm)?, &still)))
            .collect::<Result<Vec<_>, OpticsError>>()?;
        // What more coma adds, from the next stronger one that has been traced; of the strongest, from the next weaker one.
        for k in 0..forms.len() {
            let (stronger, weaker) = if COMAS_MM[k] < 0.0 {
                (k.checked_sub(1), k + 1)
            } else {
                (Some(k + 1), k.saturating_sub(1))
            };
            let (own, other) = (&forms[k], stronger.and_then(|k| forms.get(k)).unwrap_or(&forms[weaker]));
            let step = other.coma_mm / own.coma_mm - 1.0;
            forms[k].beyond_proportion =
                own.tangent_per_coma.with(&other.tangent_per_coma, |own, other| (other - own) / step);
        }
        let even = self
            .places
            .par_iter()
            .map(|place| {
                let along = |axis: DVec2| -> Result<f64, OpticsError> {
                    let seen = |sign: f64| self.seen(place, &place.waves[0], sign * EVEN_COMA_MM * axis);
                    Ok((seen(1.0)? - seen(-1.0)?).dot(axis) / (2.0 * EVEN_COMA_MM))
                };
                Ok([along(DVec2::X)?, along(DVec2::Y)?])
            })
            .collect::<Result<Vec<_>, OpticsError>>()?;
        Ok(ComaShifts {
            growing: std::array::from_fn(|k| forms[k]),
            tangent_per_even_coma: [0, 1].map(|axis| self.table_of(even.iter().map(|of| of[axis]))),
        })
    }

    /// A coma's form, all round alike and in proportion: from the places with it and without, each with the display where
    /// it is and away.
    fn form(&self, coma_mm: f64, with: &[Seen; 2], still: &[Seen; 2]) -> ComaForm {
        let tangent_per_coma = self.added(&with[0], &still[0], coma_mm).0;
        let coma_per_depth = self
            .added(&with[1], &still[1], coma_mm)
            .0
            .with(&tangent_per_coma, |deep, own| (deep - own) / COMA_DEPTH_MM);
        let none = self.table(&|_| 0.0);
        ComaForm { coma_mm, tangent_per_coma, coma_per_depth, beyond_proportion: none, round: [none; 4] }
    }

    /// The same, with what more coma does and what sub-pixels side by side do round the axis.
    fn whole_form(&self, coma_mm: f64) -> Result<ComaForm, OpticsError> {
        let (still, with) = (self.both_depths(0.0)?, self.both_depths(coma_mm)?);
        let mut form = self.form(coma_mm, &with, &still);
        let changed = |step: f64| {
            let coma_mm = (1.0 + step) * coma_mm;
            Ok::<_, OpticsError>(self.added(&self.seen_round(0, coma_mm)?, &still[0], coma_mm).0)
        };
        form.beyond_proportion =
            changed(-COMA_STEP)?.with(&changed(COMA_STEP)?, |less, more| (more - less) / (2.0 * COMA_STEP));
        if self.places.iter().any(|place| place.turned.is_empty()) {
            return Ok(form);
        }
        // All azimuths together make the image that the widths are of.
        let mut at = Vec::with_capacity(AZIMUTHS.len());
        for k in 0..AZIMUTHS.len() {
            let seen = self.in_windows(&self.images(&Lit::Turned(k), coma_mm)?, &with[0].widths_px);
            let without = self.in_windows(&self.images(&Lit::Turned(k), 0.0)?, &still[0].widths_px);
            at.push(self.added(&seen, &without, coma_mm));
        }
        // Along the radius a0 + a1 cos + a2 cos 2, across it b1 sin + b2 sin 2 of the azimuth.
        let [right, up_right, up, up_left, left] = [0, 1, 2, 3, 4].map(|k| at[k]);
        let table = |of: &dyn Fn(usize) -> f64| self.table_of((1..RADIAL_KNOTS).map(of));
        form.tangent_per_coma = table(&|i| 0.5 * (up_right.0.values[i] + up_left.0.values[i]));
        form.round = [
            table(&|i| 0.5 * (right.0.values[i] - left.0.values[i])),
            table(&|i| 0.25 * (right.0.values[i] + left.0.values[i]) - 0.5 * up.0.values[i]),
            table(&|i| up.1.values[i]),
            table(&|i| 0.5 * (up_right.1.values[i] - up_left.1.values[i])),
        ];
        Ok(form)
    }

    /// What a coma adds to lines of sight along and across the radius, over r / u and the coma.
    fn added(&self, with: &Seen, without: &Seen, coma_mm: f64) -> (RadialTable, RadialTable) {
        let over = |place: &Place| coma_mm * place.tangent / self.half_width_tan;
        let seen = with.at.iter().zip(&without.at).zip(&self.places);
        let added: Vec<DVec2> =
            seen.map(|((with, without), place)| (*with - *without) / over(place)).collect();
        (self.table_of(added.iter().map(|a| a.x)), self.table_of(added.iter().map(|a| a.y)))
    }

    fn both_depths(&self, coma_mm: f64) -> Result<[Seen; 2], OpticsError> {
        Ok([self.seen_round(0, coma_mm)?, self.seen_round(1, coma_mm)?])
    }

    /// All places as a detector finds them, in windows as wide as one field of widths through the spots of an image has
    /// it: a comatic spot has another middle in another window.
    fn seen_round(&self, depth: usize, coma_mm: f64) -> Result<Seen, OpticsError> {
        let images = self.images(&Lit::Round(depth), coma_mm)?;
        let own_px: Vec<f64> = images.iter().map(|(_, window)| window.sigma).collect();
        Ok(self.in_windows(&images, &self.field_of_widths(&own_px)))
    }

    /// Images of all places, each with the window that is its own.
    fn images(&self, lit: &Lit, coma_mm: f64) -> Result<Vec<(Kernel, Window)>, OpticsError> {
        let image = |place: &Place| {
            let coma = DVec2::new(coma_mm * place.tangent / self.half_width_tan, 0.0);
            let image = self.image(place, lit, coma)?;
            let window = windowed_in(&image);
            Ok((image, window))
        };
        self.places.par_iter().map(image).collect()
    }

    fn in_windows(&self, images: &[(Kernel, Window)], widths_px: &[f64]) -> Seen {
        let middle = |((place, (image, own)), &wide): ((&Place, &(Kernel, Window)), &f64)| {
            let at = DVec2::from(windowed_as(image, *own, wide));
            DVec2::new(place.tangent, 0.0) + at / self.focal_px
        };
        Seen {
            at: self.places.iter().zip(images).zip(widths_px).map(middle).collect(),
            widths_px: widths_px.to_vec(),
        }
    }

    /// What a detector takes for the widths of the places' spots, from their own, px.
    fn field_of_widths(&self, own_px: &[f64]) -> Vec<f64> {
        let middle = DVec2::from_array(self.size_px) / 2.0;
        let radius = |place: &Place| self.focal_px * place.tangent;
        let spots: Vec<([f64; 2], f64)> = self
            .places
            .iter()
            .zip(own_px)
            .flat_map(|(place, &sigma)| {
                (0..ROUND_THE_AXIS).map(move |k| {
                    let azimuth = 2.0 * PI * (k as f64 + 0.5) / ROUND_THE_AXIS as f64;
                    (middle + radius(place) * DVec2::from_angle(azimuth), sigma)
                })
            })
            .filter(|(at, _)| at.cmpge(DVec2::ZERO).all() && at.cmplt(2.0 * middle).all())
            .map(|(at, sigma)| (at.to_array(), sigma))
            .collect();
        let map = WidthMap::through(self.size_px, &spots);
        // Round the axis the field is nearly the same.
        let at = |place: &Place| map.at_px((middle + radius(place) * middle.normalize()).to_array());
        self.places.iter().map(at).collect()
    }

    fn table(&self, of: &dyn Fn(&Place) -> f64) -> RadialTable {
        self.table_of(self.places.iter().map(of))
    }

    fn table_of(&self, mut values: impl Iterator<Item = f64>) -> RadialTable {
        RadialTable::new(self.half_tan, std::array::from_fn(|_| values.next().unwrap_or_default()))
    }

    /// The place whose light, on the average, is on the line of sight (r, 0).
    fn place(&self, spots: &Spots, r: f64) -> Result<Place, OpticsError> {
        let field = DVec2::new(r, 0.0);
        let meetings =
            spots.fans.iter().map(|fan| spots.meetings(&fan.tracer, field)).collect::<Result<Vec<_>, _>>()?;
        let mean = |of: &dyn Fn(&Meeting) -> DVec2| -> DVec2 {
            let sum = |fan: &[Meeting]| -> DVec2 {
                fan.iter().zip(&spots.pupil).map(|(meeting, point)| point.weight * of(meeting)).sum()
            };
            meetings.iter().zip(&spots.fans).map(|(rays, fan)| fan.weight * sum(rays)).sum::<DVec2>()
        };
        let place_mm = mean(&|meeting| meeting.at_mm);
        let px_per_mm = self.focal_px / mean(&|meeting| meeting.mm_per_tangent.x_axis).length();
        // The light of the place at a depth, as the camera's pupil receives it: each ray to first order in the spot's size.
        // The display is turned by 180 deg against the axes of the lines of sight.
        let waves = |depth_mm: f64, stripes: DVec2| -> Vec<Wave> {
            spots
                .fans
                .iter()
                .zip(&meetings)
                .map(|(fan, rays)| {
                    let from_mm = place_mm - fan.stripe_mm * stripes;
                    let cosines: Vec<f64> = rays
                        .iter()
                        .flat_map(|meeting| {
                            let miss_mm = from_mm - meeting.at_mm - depth_mm * meeting.slope;
                            let tangent = field + meeting.mm_per_tangent.inverse() * miss_mm;
                            (tangent / (1.0 + tangent.length_squared()).sqrt()).to_array()
                        })
                        .collect();
                    (spots.slopes.wavefront(&cosines, spots.pupil_radius_mm), (fan.nm, fan.weight))
                })
                .collect()
        };
        let mut place = Place {
            tangent: r,
            height_over_tangent_mm: 0.0,
            px_per_mm,
            waves: [0.0, COMA_DEPTH_MM].map(|depth_mm| waves(depth_mm, DVec2::ZERO)),
            seen: 0.0,
            turned: Vec::new(),
            per_depth: [0.0; DEPTHS_MM.len()],
        };
        let still = |waves: &[Wave]| Ok::<_, OpticsError>(self.seen(&place, waves, DVec2::ZERO)?.x);
        let seen = still(&place.waves[0])?;
        let mut per_depth = [0.0; DEPTHS_MM.len()];
        for (per_depth, depth_mm) in per_depth.iter_mut().zip(DEPTHS_MM) {
            *per_depth = (still(&waves(depth_mm, DVec2::ZERO))? - seen) / (depth_mm * seen);
        }
        if spots.fans.iter().any(|fan| fan.stripe_mm != spots.fans[0].stripe_mm) {
            // The display's x along and across the radius.
            let turned = |azimuth: f64| waves(0.0, DVec2::from_angle(-azimuth));
            place.turned = AZIMUTHS.map(turned).to_vec();
        }
        (place.seen, place.per_depth) = (seen, per_depth);
        place.height_over_tangent_mm = place_mm.x.abs() / seen;
        Ok(place)
    }

    /// The line of sight on which light of a place is found in a window as wide as its own spot, with coma.
    fn seen(&self, place: &Place, waves: &[Wave], coma_mm: DVec2) -> Result<DVec2, OpticsError> {
        let image = self.image_of(place, waves, coma_mm, [self.emission.whole_mm; 2])?;
        Ok(DVec2::new(place.tangent, 0.0) + DVec2::from(windowed_in(&image).at) / self.focal_px)
    }

    /// The image of a place, with coma.
    fn image(&self, place: &Place, lit: &Lit, coma_mm: DVec2) -> Result<Kernel, OpticsError> {
        match lit {
            Lit::Round(depth) => {
                self.image_of(place, &place.waves[*depth], coma_mm, [self.emission.whole_mm; 2])
            }
            Lit::Turned(k) => {
                let [x, y] = self.emission.sub_pixel_mm;
                let (sin, cos) = AZIMUTHS[*k].sin_cos();
                let emission_mm = [(x * cos).hypot(y * sin), (x * sin).hypot(y * cos)];
                self.image_of(place, &place.turned[*k], coma_mm, emission_mm)
            }
        }
    }

    fn image_of(
        &self,
        place: &Place,
        waves: &[Wave],
        coma_mm: DVec2,
        emission_mm: [f64; 2],
    ) -> Result<Kernel, OpticsError> {
        let mut terms = [0.0; WAVEFRONT_TERMS];
        (terms[COMA[0]], terms[COMA[1]]) = coma_mm.into();
        let with_coma: Vec<_> = waves.iter().map(|(wave, line)| (wave.plus(&terms), *line)).collect();
        let frame = KernelFrame { reference: [place.tangent, 0.0], roll_rad: 0.0 };
        let grid = KernelGrid { focal_px: self.focal_px, per_px: PER_PX, half_px: HALF_PX };
        let mut image = clear_kernel(&with_coma, frame, grid)?;
        image.spread([1.0; 2]);
        image.spread(emission_mm.map(|mm| mm * place.px_per_mm));
        Ok(image)
    }
}

/// Which light of the places.
enum Lit {
    /// All of it about one point, the display where it is (0) or [`COMA_DEPTH_MM`] away (1).
    Round(usize),
    /// Sub-pixels side by side, at one of [`AZIMUTHS`].
    Turned(usize),
}

impl ComaTracer for SpotTracer {
    fn coma_form(&self, coma_mm: f64) -> Option<ComaForm> {
        self.whole_form(coma_mm).ok()
    }
}

/// Light of one wavelength.
struct Fan {
    nm: f64,
    /// Its share of the electrons.
    weight: f64,
    /// Displacement of its sub-pixel along the display's x.
    stripe_mm: f64,
    tracer: Tracer,
}

struct Spots {
    launcher: Launcher,
    fans: Vec<Fan>,
    pupil: Vec<PupilPoint>,
    slopes: SlopeFit,
    pupil_radius_mm: f64,
}

/// A ray of a line of sight: where it meets the display (mm), its slope there, and what the line of sight moves it by.
struct Meeting {
    at_mm: DVec2,
    slope: DVec2,
    mm_per_tangent: DMat2,
}

impl Spots {
    /// The rays of a line of sight through the pupil's points.
    fn meetings(&self, tracer: &Tracer, field: DVec2) -> Result<Vec<Meeting>, OpticsError> {
        let traced = |field: DVec2| -> Result<RayBatch, OpticsError> {
            let mut rays = RayBatch::with_capacity(self.pupil.len());
            for point in &self.pupil {
                rays.push(&self.launcher.ray(field.to_array(), point.at)?);
            }
            tracer.trace_batch(&mut rays);
            match (0..rays.len()).find_map(|i| rays.failure(i)) {
                None => Ok(rays),
                Some(failure) => Err(OpticsError::Ray {
                    what: format!("a ray of the field ({:.4}, {:.4})", field.x, field.y),
                    failure,
                }),
            }
        };
        let steps = [DVec2::X, -DVec2::X, DVec2::Y, -DVec2::Y].map(|axis| traced(field + STEP * axis));
        let [right, left, up, down] = steps;
        let (middle, right, left, up, down) = (traced(field)?, right?, left?, up?, down?);
        let at = |rays: &RayBatch, i: usize| DVec2::new(rays.x_mm[i], rays.y_mm[i]);
        Ok((0..self.pupil.len())
            .map(|i| Meeting {
                at_mm: at(&middle, i),
                slope: DVec2::new(middle.l[i], middle.m[i]) / middle.n[i],
                mm_per_tangent: DMat2::from_cols(
                    (at(&right, i) - at(&left, i)) / (2.0 * STEP),
                    (at(&up, i) - at(&down, i)) / (2.0 * STEP),
                ),
            })
            .collect())
    }
}

/// h_0, h_1, h_2 of the heights over tangents, mm, by least squares.
fn heights(half_tan: f64, places: &[Place]) -> [f64; 3] {
    let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for place in places {
        // Of parts of the largest field so far.
        let part = place.seen / half_tan;
        let row = DVec3::new(1.0, part.powi(2), part.powi(4));
        normal += DMat3::from_cols(row * row.x, row * row.y, row * row.z);
        right += row * place.height_over_tangent_mm;
    }
    let h2 = half_tan * half_tan;
    let [a, b, c] = (normal.inverse() * right).to_array();
    [a, b / h2, c / (h2 * h2)]
}
