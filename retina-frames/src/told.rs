//! Where predictions lie, told as one thing: beside the table's own pose, whatever was rendered anew in between.

use glam::{DMat2, DVec2};

use retina_diagnosis::{Measure, Placement};

use crate::FrameSet;
use crate::model::State;
use crate::predicted::Predicted;
use crate::solve::{self, Parameter};

impl FrameSet {
    /// Where the body's middle is seen that the table's own prediction has at `middles[frame]`, px.
    fn seen_at(&self, frame: usize, state: &State) -> DVec2 {
        let (pose, window) = (&self.poses[frame], self.sights[frame].window.middle());
        let rendered = pose.to + DMat2::from_angle(pose.roll_rad) * (self.middles[frame] - pose.from);
        let turn = DMat2::from_angle(state.roll_rad) * (1.0 + state.scale);
        window + state.shift_px[frame] + turn * (rendered - window)
    }

    /// Whether the roll that is fitted to all images is each one's whole.
    fn one_roll(&self) -> bool {
        self.poses.iter().all(|pose| (pose.roll_rad - self.poses[0].roll_rad).abs() < 1e-12)
    }

    /// A parameter of the baseline, counted from the table's own prediction.
    pub(crate) fn told_value(&self, parameter: Parameter) -> f64 {
        let moved = |frame: usize| self.seen_at(frame, &self.state) - self.middles[frame];
        match parameter {
            Parameter::ShiftX(frame) => moved(frame).x,
            Parameter::ShiftY(frame) => moved(frame).y,
            Parameter::Roll if self.one_roll() => {
                // Between -180 and 180 deg.
                let turned = self.poses[0].roll_rad + self.state.roll_rad;
                turned.sin().atan2(turned.cos())
            }
            other => other.value(&self.state),
        }
    }

    pub(crate) fn told_name(&self, parameter: Parameter) -> String {
        match parameter {
            Parameter::Roll if !self.one_roll() => "roll_of_all_beside_each_rad".to_owned(),
            other => other.name(self.sights.len()),
        }
    }

    /// Where each image's body is seen by a state, with standard deviations under its model. Nothing where images are not
    /// registered.
    pub(crate) fn placements_of(&self, best: &Predicted) -> Vec<Placement> {
        if !self.registered {
            return Vec::new();
        }
        let state = &best.state;
        let parameters = self.parameters(state);
        let tangents = best.tangents(self.view(), &parameters);
        let weight = self.weights(best, &best.error(self.view()), parameters.len());
        let covariance = solve::covariance(&tangents, &weight);
        let sigma = |gradient: &[(Parameter, f64)]| -> f64 {
            let Some(covariance) = &covariance else { return f64::NAN };
            let at = |own: Parameter| parameters.iter().position(|p| *p == own);
            let known: Vec<(usize, f64)> = gradient.iter().filter_map(|(p, g)| Some((at(*p)?, *g))).collect();
            let sum =
                |(i, g): &(usize, f64)| known.iter().map(|(j, h)| g * h * covariance[(*i, *j)]).sum::<f64>();
            known.iter().map(sum).sum::<f64>().max(0.0).sqrt()
        };
        let placement = |frame: usize| {
            let (predicted, seen) = (self.middles[frame], self.seen_at(frame, state));
            let lever = seen - self.sights[frame].window.middle() - state.shift_px[frame];
            let turned = self.poses[frame].roll_rad + state.roll_rad;
            let along = |shift: Parameter, turn: f64, grow: f64| {
                sigma(&[(shift, 1.0), (Parameter::Roll, turn), (Parameter::Scale, grow)])
            };
            Placement {
                image: self.names[frame].clone(),
                predicted_px: predicted.to_array(),
                seen_px: [
                    Measure { value: seen.x, sigma: along(Parameter::ShiftX(frame), -lever.y, lever.x) },
                    Measure { value: seen.y, sigma: along(Parameter::ShiftY(frame), lever.x, lever.y) },
                ],
                roll_rad: Measure {
                    value: turned.sin().atan2(turned.cos()),
                    sigma: sigma(&[(Parameter::Roll, 1.0)]),
                },
                scale: Measure { value: state.scale, sigma: sigma(&[(Parameter::Scale, 1.0)]) },
            }
        };
        (0..self.sights.len()).map(placement).collect()
    }
}

/// A placement in words, with what it is beside the table's own.
pub(crate) fn note_of(placement: &Placement) -> String {
    let [x, y] = placement.seen_px;
    let [from_x, from_y] = placement.predicted_px;
    let (roll, scale) = (placement.roll_rad, placement.scale);
    format!(
        "{}: by the best prediction, the body that the table predicts at ({from_x:.2}, {from_y:.2}) px is seen at ({:.3} +- {:.3}, {:.3} +- {:.3}), turned by {:.3} +- {:.3} deg, {:.5} +- {:.5} times as large (shift_x_px {:.2}, shift_y_px {:.2}, scale_relative {:.5})",
        placement.image,
        x.value,
        x.sigma,
        y.value,
        y.sigma,
        roll.value.to_degrees(),
        roll.sigma.to_degrees(),
        1.0 + scale.value,
        scale.sigma,
        x.value - from_x,
        y.value - from_y,
        scale.value,
    )
}
