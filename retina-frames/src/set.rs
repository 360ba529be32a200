//! Tables of frames: read, registered, and turned into pixels that the workbench explains.

use std::path::PathBuf;

use glam::DVec2;
use rayon::prelude::*;
use retina_diagnosis::{
    AddedEffect, Dataset, PixelColumn, PixelEffect, PixelForm, PixelPart, Pixels, Placement, White,
};
use retina_files::InputError;
use retina_formats::{Calibration, FrameRow, FramesEffect, FramesTable};
use retina_geometry::{Pinhole, Setup};

use crate::form::{Abilities, Change, Form, catalogue};
use crate::grid::Grid;
use crate::layers::Layers;
use crate::measured::Bins;
use crate::model::{Part, Sight, State};
use crate::photograph;
use crate::pixels::PixelRows;
use crate::place::{Placed, Scenes, first_state, place, windows};
use crate::predicted::{Predicted, View};
use crate::solve::{self, Parameter};
use crate::told::note_of;
use crate::window::Pose;

/// Where frames come from and what is done with them at first.
pub struct FramesSource<'a> {
    /// Tables of frames.
    pub files: &'a [PathBuf],
    /// The facility, or the camera alone.
    pub setup: &'a Setup,
    /// The facility's distortion, for predictions on the screen.
    pub calibration: Option<&'a Calibration>,
    /// Whether shift, roll, scale and offset are fitted always; otherwise the gain alone.
    pub register: bool,
}

/// Most images that are looked at together.
const MOST_FRAMES: usize = 40;
/// Movements in the fit beyond this, px, make the prediction anew.
const RENDERED_ANEW_PX: f64 = 0.3;
const PLACINGS: usize = 4;
/// Blur with which registration begins, px^2.
const FIRST_BLUR_PX2: f64 = 2.0;

/// Images with their predictions.
pub struct FrameSet {
    pub(crate) sights: Vec<Sight>,
    pub(crate) bins: Vec<Bins>,
    pub(crate) rows: PixelRows,
    pub(crate) state: State,
    /// The prediction before anything was added, and with each effect.
    pub(crate) history: Vec<(String, State)>,
    pub(crate) names: Vec<String>,
    /// Where each prediction was rendered.
    pub(crate) poses: Vec<Pose>,
    /// Middles of the bodies as the tables predict them, px.
    pub(crate) middles: Vec<DVec2>,
    pub(crate) numbers: Vec<(String, Vec<f64>)>,
    pub(crate) registered: bool,
    /// The pixels' noise, the same whatever is predicted later.
    white: Option<White>,
    /// Where the bodies are seen, by the best prediction.
    placements: Vec<Placement>,
    /// The state of that prediction.
    pub(crate) best: Option<State>,
    files: Vec<PathBuf>,
    notes: Vec<String>,
    saturated: usize,
    /// Pixels nearer than this share noise, px.
    pub(crate) shared_within_px: f64,
}

impl FrameSet {
    /// Reads tables, makes the predictions and registers them.
    ///
    /// # Errors
    /// A file that does not fit, an image without light, a prediction that looks nothing like it.
    pub fn read(source: &FramesSource<'_>) -> Result<Self, InputError> {
        let mut notes = Vec::new();
        let mut rows: Vec<(PathBuf, FrameRow)> = Vec::new();
        for file in source.files {
            let table = FramesTable::read(file)?;
            notes.extend(
                table.left_out.iter().map(|name| format!("column `{name}` has empty cells and is left out")),
            );
            rows.extend(table.rows.into_iter().map(|row| (file.clone(), row)));
        }
        let stride = rows.len().div_ceil(MOST_FRAMES);
        if stride > 1 {
            notes.push(format!("every {stride}-th of {} images was looked at", rows.len()));
            rows = rows.into_iter().step_by(stride).collect();
        }
        let camera = source.setup.camera_pinhole();
        let mut scenes = Scenes::new();
        let mut files = source.files.to_vec();
        let mut placed = Vec::new();
        for (file, row) in &rows {
            placed.push(place(source, &camera, file, row, &mut scenes, &mut files)?);
        }
        let columns: Vec<String> = rows[0].1.numbers.iter().map(|(name, _)| name.clone()).collect();
        let numbers = columns
            .into_iter()
            .filter(|name| name != "frame")
            .filter_map(|name| {
                let values: Option<Vec<f64>> = rows.iter().map(|(_, row)| row.number(&name)).collect();
                Some((name, values?))
            })
            .collect();
        Self::of_placed(source, &camera, placed, numbers, files, notes)
    }

    fn of_placed(
        source: &FramesSource<'_>,
        camera: &Pinhole,
        mut placed: Vec<Placed>,
        numbers: Vec<(String, Vec<f64>)>,
        files: Vec<PathBuf>,
        mut notes: Vec<String>,
    ) -> Result<Self, InputError> {
        let windows = windows(&placed, &mut notes);
        let full_scale_dn: Vec<f64> =
            placed.iter().map(|frame| f64::from(frame.measured.image.full_scale_dn)).collect();
        let bins: Vec<Bins> =
            placed.iter().zip(&windows).map(|(frame, window)| frame.measured.bins(window)).collect();
        let sum = |k: usize| bins.iter().map(|b| b.left_out[k]).sum::<usize>();
        notes.push(format!(
            "left out: {} saturated pixels, {} at 0 or beside one at 0, {} masked",
            sum(0),
            sum(1),
            sum(2)
        ));
        let shared_within_px = photograph::told(&placed, &mut notes);
        let exposures_s = photograph::exposures_s(&placed, &mut notes);
        let mut sights: Vec<Sight> = placed
            .iter()
            .zip(&windows)
            .zip(&full_scale_dn)
            .zip(exposures_s)
            .map(|(((frame, window), full), exposure_s)| Sight {
                window: *window,
                layers: frame.origin.outlines(camera, window, &frame.pose),
                axis_px: DVec2::new(camera.cx_px, camera.cy_px),
                half_width_px: 0.5 * f64::from(camera.width_px),
                full_scale_dn: *full,
                exposure_s,
            })
            .collect();
        let rows = PixelRows::new(&sights, &bins);
        if rows.bins.len() < 64 {
            return Err(InputError::new(&source.files[0], "too few pixels can be compared")
                .found(format!("{} of them; {}", rows.bins.len(), notes.join("; ")))
                .help("look at the mask and at the exposure"));
        }
        let mut state = first_state(&sights, &bins);
        let parameters = Parameter::baseline(sights.len(), source.register);
        if source.register {
            // Registered with a blur, so that edges are found whatever the optics are; the blur itself is an effect.
            let form = Form { change: Change::Blur, probe: 1.0, shape: Vec::new() };
            state.parts = vec![Part { id: FramesEffect::Defocus, form, values: vec![FIRST_BLUR_PX2] }];
            let with_blur: Vec<Parameter> =
                parameters.iter().copied().chain([Parameter::Part(0, 0)]).collect();
            for turn in 0..PLACINGS {
                let view = View { sights: &sights, rows: &rows };
                state = solve::fit(view, Predicted::of(view, state), &with_blur).state;
                let most = placed
                    .iter()
                    .zip(&state.shift_px)
                    .map(|(frame, shift)| {
                        let reach = 0.5 * (frame.bounds[2] - frame.bounds[0]) as f64;
                        shift.length() + state.roll_rad.abs() * reach
                    })
                    .fold(0.0, f64::max);
                if most < RENDERED_ANEW_PX || turn + 1 == PLACINGS {
                    break;
                }
                for (frame, placed) in placed.iter_mut().enumerate() {
                    let window = &sights[frame].window;
                    placed.pose = placed.pose.then(window.middle(), state.shift_px[frame], state.roll_rad);
                    sights[frame].layers = placed.origin.outlines(camera, window, &placed.pose);
                    state.shift_px[frame] = DVec2::ZERO;
                }
                state.roll_rad = 0.0;
            }
            let blur = state.parts[0].values[0].max(0.0).sqrt();
            notes.push(format!("registered with a blur of {blur:.2} px, which is no part of the prediction"));
            state.parts.clear();
        }
        for (sight, frame) in sights.iter_mut().zip(&placed) {
            sight.layers = frame.origin.layers(camera, &sight.window, &frame.pose);
        }
        let view = View { sights: &sights, rows: &rows };
        state = solve::fit(view, Predicted::of(view, state), &parameters).state;
        let mut set = Self {
            saturated: sum(0),
            shared_within_px,
            history: vec![("baseline".to_owned(), state.clone())],
            poses: placed.iter().map(|frame| frame.pose).collect(),
            middles: placed.iter().map(|frame| frame.middle).collect(),
            names: placed.into_iter().map(|frame| frame.name).collect(),
            sights,
            bins,
            rows,
            state,
            numbers,
            registered: source.register,
            white: None,
            placements: Vec::new(),
            best: None,
            files,
            notes,
        };
        let best = set.best();
        set.white = set.white_noise(&best);
        set.placements = set.placements_of(&best);
        set.best = Some(best.state);
        Ok(set)
    }

    /// Frame, x and y of each row, px.
    pub(crate) fn places(&self) -> Vec<[f64; 3]> {
        let place = |&(frame, bin): &(usize, usize)| {
            let px = self.sights[frame].bin_px(bin);
            [frame as f64, px.x, px.y]
        };
        self.rows.bins.iter().map(place).collect()
    }

    pub(crate) fn pitch_px(&self) -> f64 {
        self.sights.first().map_or(1.0, |sight| sight.window.bin as f64)
    }

    /// What the frames can show.
    pub(crate) fn abilities(&self) -> Abilities {
        let every = |able: &dyn Fn(&Layers) -> bool| self.sights.iter().all(|sight| able(&sight.layers));
        let lit: Vec<(usize, usize)> = self.lit_rows();
        let r = lit.iter().map(|&(frame, bin)| self.sights[frame].axis_r(bin));
        let axis = r.fold([f64::INFINITY, 0.0], |[l, h], r| [l.min(r), h.max(r)]);
        let mirrored = lit.iter().any(|&(frame, bin)| {
            let sight = &self.sights[frame];
            let window = &sight.window;
            let at =
                (2.0 * sight.axis_px - sight.bin_px(bin) - DVec2::new(window.left as f64, window.top as f64))
                    / window.bin as f64;
            at.cmpge(DVec2::ZERO).all() && at.x < window.columns as f64 && at.y < window.rows as f64
        });
        let varies = |values: &[f64]| {
            let (low, high) =
                values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
            high - low > 0.02 * high.abs()
        };
        let means: Vec<f64> = self
            .sights
            .iter()
            .enumerate()
            .map(|(frame, sight)| {
                let light = sight.light(frame, &self.state);
                self.state.gain[frame] * f64::from(light.values.iter().sum::<f32>())
            })
            .collect();
        let exposures: Vec<f64> = self.sights.iter().map(|sight| sight.exposure_s).collect();
        let brightest = self
            .rows
            .bins
            .iter()
            .zip(&self.rows.measured)
            .map(|(&(frame, _), dn)| dn / self.sights[frame].full_scale_dn)
            .fold(0.0, f64::max);
        Abilities {
            registered: self.registered,
            angles: every(&|layers| layers.angles.is_some() && layers.law.is_some()),
            map: every(&|layers| layers.map.is_some()),
            mesh: every(&|layers| layers.mesh.is_some()),
            places: every(&|layers| layers.place_rad.is_some()),
            axis,
            mirrored,
            exposures: varies(&exposures),
            levels: varies(&means),
            brightest,
            lambert: every(&|layers| {
                layers.law.is_some_and(|law| matches!(law.law, retina_radiometry::Law::Lambert(_)))
            }),
        }
    }

    /// Rows on which the prediction has light.
    fn lit_rows(&self) -> Vec<(usize, usize)> {
        let lights: Vec<Grid> = self.sights.iter().map(|s| s.layers.light.averaged(s.window.fine)).collect();
        let tops: Vec<f32> = lights.iter().map(|l| l.values.iter().copied().fold(0.0, f32::max)).collect();
        let lit = |&&(frame, bin): &&(usize, usize)| lights[frame].values[bin] > 0.05 * tops[frame];
        self.rows.bins.iter().filter(lit).copied().collect()
    }

    pub(crate) fn parameters(&self, state: &State) -> Vec<Parameter> {
        let mut out = Parameter::baseline(self.sights.len(), self.registered);
        out.extend(Parameter::of_parts(state));
        out
    }

    /// The images and the rows that are compared.
    pub(crate) fn view(&self) -> View<'_> {
        View { sights: &self.sights, rows: &self.rows }
    }

    /// Columns of a form beside what is predicted, per unit of its parameters.
    pub(crate) fn columns(&self, id: FramesEffect, form: &Form, now: &Predicted) -> Vec<PixelColumn> {
        let names = form.change.names();
        (0..names.len())
            .into_par_iter()
            .map(|k| {
                let mut values = vec![0.0; names.len()];
                values[k] = form.probe;
                let mut state = now.state.clone();
                state.parts.push(Part { id, form: form.clone(), values });
                let there = now.dn_of(self.view(), &state);
                let column = there.iter().zip(&now.dn).map(|(t, a)| (t - a) / form.probe).collect();
                PixelColumn { name: names[k].clone(), values: column, plausible: form.change.plausible() }
            })
            .collect()
    }

    /// The effects that are part of the prediction.
    pub fn parts(&self) -> Vec<&'static str> {
        self.state.parts.iter().map(|part| part.id.name()).collect()
    }

    /// The effects of `--effect`: catalogued ones become parts of the prediction.
    ///
    /// # Errors
    /// As [`FrameSet::add`]; a file that does not fit.
    pub fn with_effects(&mut self, effects: &[String]) -> Result<(Dataset, Vec<AddedEffect>), InputError> {
        for text in effects.iter().filter(|text| !text.ends_with(".toml")) {
            // Its own refusals name what is near.
            AddedEffect::read(text, &self.dataset(true)?)?;
            self.add(text)?;
        }
        let data = self.dataset(true)?;
        let added: Vec<AddedEffect> =
            effects.iter().map(|text| AddedEffect::read(text, &data)).collect::<Result<_, _>>()?;
        Ok((data, added))
    }

    /// The pixels at the present state; columns of effects that are no parts only where `candidates`.
    ///
    /// # Errors
    /// Too few pixels.
    pub fn dataset(&self, candidates: bool) -> Result<Dataset, InputError> {
        let state = &self.state;
        let frames = self.sights.len();
        let view = self.view();
        let now = Predicted::of(view, state.clone());
        let baseline = Parameter::baseline(frames, self.registered);
        let own = now.tangents(view, &baseline);
        let mut predicted_so_far = now.dn_of(view, &State { parts: Vec::new(), ..state.clone() });
        let predicted = predicted_so_far.clone();
        let mut parts: Vec<PixelPart> = Vec::new();
        for (i, part) in state.parts.iter().enumerate() {
            let upto = State { parts: state.parts[..=i].to_vec(), ..state.clone() };
            let there = now.dn_of(view, &upto);
            let names = part.form.change.names();
            let parameters: Vec<Parameter> = (0..names.len()).map(|k| Parameter::Part(i, k)).collect();
            let tangents = now.tangents(view, &parameters);
            parts.push(PixelPart {
                id: part.id,
                adds: there.iter().zip(&predicted_so_far).map(|(t, p)| t - p).collect(),
                tangents: names
                    .into_iter()
                    .zip(tangents)
                    .zip(&part.values)
                    .map(|((name, values), value)| {
                        (PixelColumn { name, values, plausible: part.form.change.plausible() }, *value)
                    })
                    .collect(),
                shape: part.form.shape.clone(),
            });
            predicted_so_far = there;
        }
        let open = catalogue(&self.abilities())
            .into_iter()
            .filter(|(id, _)| !state.parts.iter().any(|part| part.id == *id));
        let effects = open
            .map(|(id, forms)| {
                let forms = match forms {
                    Ok(forms) if candidates => Ok(forms
                        .iter()
                        .map(|form| {
                            let mut shape = form.shape.clone();
                            if form.change.range()[0] == 0.0 {
                                shape.push(("looked_for_at_px2", form.probe));
                            }
                            PixelForm { shape, leading: self.columns(id, form, &now) }
                        })
                        .collect()),
                    Ok(_) => Ok(Vec::new()),
                    Err(reason) => Err(reason),
                };
                PixelEffect { id, forms }
            })
            .collect();
        Dataset::of_pixels(Pixels {
            measured: self.rows.measured.clone(),
            predicted,
            place: self.places(),
            pitch_px: self.pitch_px(),
            groups: self.rows.tiles.clone(),
            covariates: self.covariates(&now.dn),
            noise_key: self.rows.noise_key(&self.sights, &now),
            least_noise: self.rows.least_noise,
            shared_within_px: self.shared_within_px,
            white: self.white.clone(),
            baseline: baseline
                .iter()
                .zip(own)
                .map(|(parameter, values)| {
                    let column = PixelColumn { name: self.told_name(*parameter), values, plausible: None };
                    (column, self.told_value(*parameter))
                })
                .collect(),
            effects,
            parts,
            saturated: self.saturated,
            files: self.files.clone(),
            notes: self.notes.iter().cloned().chain(self.placements.iter().map(note_of)).collect(),
            placements: self.placements.clone(),
        })
    }
}
