//! A state with what it predicts, from which others are reached.

use rayon::prelude::*;

use crate::model::{Sight, State};
use crate::pixels::PixelRows;
use crate::solve::Parameter;
use crate::stages::Stages;

/// The images and the rows that are compared.
#[derive(Clone, Copy)]
pub(crate) struct View<'a> {
    pub(crate) sights: &'a [Sight],
    pub(crate) rows: &'a PixelRows,
}

/// A state, its light, and the digital numbers of the rows.
pub(crate) struct Predicted {
    pub(crate) state: State,
    stages: Vec<Stages>,
    pub(crate) dn: Vec<f64>,
}

impl Predicted {
    pub(crate) fn of(view: View<'_>, state: State) -> Self {
        let stages = view
            .sights
            .par_iter()
            .enumerate()
            .map(|(frame, sight)| sight.stages(frame, &state, None))
            .collect();
        Self::of_stages(view, state, stages)
    }

    /// Another state, with what it shares with this one.
    pub(crate) fn beside(&self, view: View<'_>, state: State) -> Self {
        let stages = self.stages_of(view, &state);
        Self::of_stages(view, state, stages)
    }

    /// What another state predicts.
    pub(crate) fn dn_of(&self, view: View<'_>, state: &State) -> Vec<f64> {
        over_rows(view, state, &self.stages_of(view, state))
    }

    /// Light of a frame before the detector.
    pub(crate) fn light(&self, frame: usize) -> &crate::grid::Grid {
        &self.stages[frame].light
    }

    /// Measured less predicted.
    pub(crate) fn error(&self, view: View<'_>) -> Vec<f64> {
        view.rows.measured.iter().zip(&self.dn).map(|(m, p)| m - p).collect()
    }

    /// Derivatives by parameters.
    pub(crate) fn tangents(&self, view: View<'_>, parameters: &[Parameter]) -> Vec<Vec<f64>> {
        parameters.par_iter().map(|p| self.tangent(view, *p)).collect()
    }

    /// Derivative by a parameter.
    pub(crate) fn tangent(&self, view: View<'_>, parameter: Parameter) -> Vec<f64> {
        let state = &self.state;
        let mut step = parameter.step(state);
        let mut moved = parameter.moved(state, step);
        if moved == *state {
            // At the end of its range a parameter has a tangent towards the inside alone.
            step = -step;
            moved = parameter.moved(state, step);
        }
        if let Parameter::Part(part, k) = parameter {
            step = moved.parts[part].values[k] - state.parts[part].values[k];
        }
        let frames = parameter.frame().map_or(0..view.sights.len(), |frame| frame..frame + 1);
        let images: Vec<Option<Vec<f64>>> = (0..view.sights.len())
            .into_par_iter()
            .map(|frame| {
                let sight = &view.sights[frame];
                frames.contains(&frame).then(|| {
                    let known = Some((state, &self.stages[frame]));
                    sight.detected(frame, &moved, &sight.stages(frame, &moved, known).light)
                })
            })
            .collect();
        let derivative = |(&(frame, bin), before): (&(usize, usize), &f64)| {
            images[frame].as_ref().map_or(0.0, |image| (image[bin] - before) / step)
        };
        view.rows.bins.iter().zip(&self.dn).map(derivative).collect()
    }

    fn stages_of(&self, view: View<'_>, state: &State) -> Vec<Stages> {
        let frames = view.sights.par_iter().zip(&self.stages).enumerate();
        frames.map(|(frame, (sight, own))| sight.stages(frame, state, Some((&self.state, own)))).collect()
    }

    fn of_stages(view: View<'_>, state: State, stages: Vec<Stages>) -> Self {
        let dn = over_rows(view, &state, &stages);
        Self { state, stages, dn }
    }
}

fn over_rows(view: View<'_>, state: &State, stages: &[Stages]) -> Vec<f64> {
    let images: Vec<Vec<f64>> = view
        .sights
        .par_iter()
        .zip(stages)
        .enumerate()
        .map(|(frame, (sight, stages))| sight.detected(frame, state, &stages.light))
        .collect();
    view.rows.bins.iter().map(|&(frame, bin)| images[frame][bin]).collect()
}
