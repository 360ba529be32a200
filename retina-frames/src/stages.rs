//! The light of a frame, stage by stage. Another state begins at the first stage that it changes: most tangents and trials
//! change a late one.

use std::sync::Arc;

use glam::DVec2;
use once_cell::race::OnceBox;

use crate::form::{Change, Stage};
use crate::grid::{Grid, Spline};
use crate::model::{Part, Sight, State};

/// Light after each stage but the detector.
#[derive(Debug, Clone)]
pub(crate) struct Stages {
    surface: Arc<Surface>,
    placed: Arc<Grid>,
    sharp: Arc<Grid>,
    /// Light of each bin before the detector.
    pub(crate) light: Arc<Grid>,
}

#[derive(Debug)]
struct Surface {
    cells: Grid,
    /// For moving them; made when first asked for.
    spline: OnceBox<Spline>,
}

/// How a frame is moved: shift in px, roll in rad, scale.
type Movement = (DVec2, f64, f64);

impl State {
    fn at(&self, stage: Stage) -> impl Iterator<Item = &Part> {
        self.parts.iter().filter(move |part| part.form.change.stage() == stage)
    }

    /// Whether both do the same at a stage, by the parts alone.
    fn alike(&self, other: &Self, stage: Stage) -> bool {
        self.at(stage).map(does).eq(other.at(stage).map(does))
    }

    fn movement(&self, frame: usize) -> Movement {
        let (mut shift, mut roll, mut scale) = (self.shift_px[frame], self.roll_rad, self.scale);
        for part in self.at(Stage::Place) {
            match part.form.change {
                Change::Shift => shift += DVec2::new(part.values[0], part.values[1]),
                Change::Roll => roll += part.values[0],
                _ => scale += part.values[0],
            }
        }
        (shift, roll, scale)
    }
}

/// What a part does to light.
fn does(part: &Part) -> (&Change, &[f64]) {
    (&part.form.change, &part.values)
}

impl Sight {
    /// Light of each bin before the detector.
    pub(crate) fn light(&self, frame: usize, state: &State) -> Arc<Grid> {
        self.stages(frame, state, None).light
    }

    /// All stages of a state; those that it shares with a known one are taken from there.
    pub(crate) fn stages(&self, frame: usize, state: &State, known: Option<(&State, &Stages)>) -> Stages {
        let known = known.filter(|(other, _)| state.alike(other, Stage::Surface));
        let surface = known.map_or_else(
            || Arc::new(Surface { cells: self.surface(&state.parts), spline: OnceBox::new() }),
            |(_, stages)| Arc::clone(&stages.surface),
        );
        let movement = state.movement(frame);
        let known = known.filter(|(other, _)| movement == other.movement(frame));
        let placed = known.map_or_else(
            || match movement {
                (DVec2::ZERO, 0.0, 0.0) => Arc::new(surface.cells.clone()),
                (shift, roll, scale) => {
                    let spline = surface.spline.get_or_init(|| Box::new(surface.cells.spline()));
                    Arc::new(self.moved(spline, shift, roll, scale))
                }
            },
            |(_, stages)| Arc::clone(&stages.placed),
        );
        let known = known.filter(|(other, _)| state.alike(other, Stage::Optics));
        let sharp = known.map_or_else(
            || {
                let through = |cells: Option<Grid>, part: &Part| {
                    Some(self.through_optics(cells.as_ref().unwrap_or(&placed), part))
                };
                let cells = state.at(Stage::Optics).fold(None, through);
                Arc::new(cells.as_ref().unwrap_or(&placed).averaged(self.window.fine))
            },
            |(_, stages)| Arc::clone(&stages.sharp),
        );
        let known = known.filter(|(other, _)| state.alike(other, Stage::Stray));
        let light = known.map_or_else(
            || {
                let stray = |bins: Option<Grid>, part: &Part| {
                    Some(self.scattered(bins.as_ref().unwrap_or(&sharp), part))
                };
                state.at(Stage::Stray).fold(None, stray).map_or_else(|| Arc::clone(&sharp), Arc::new)
            },
            |(_, stages)| Arc::clone(&stages.light),
        );
        Stages { surface, placed, sharp, light }
    }
}
