//! Where predictions lie, told as one thing: beside the table's own pose, whatever was rendered anew in between.

use glam::{DMat2, DVec2};

use crate::FrameSet;
use crate::solve::Parameter;

impl FrameSet {
    /// Where the body's middle is seen that the table's own prediction has at `middles[frame]`, px.
    fn seen_at(&self, frame: usize) -> DVec2 {
        let (pose, window) = (&self.poses[frame], self.sights[frame].window.middle());
        let rendered = pose.to + DMat2::from_angle(pose.roll_rad) * (self.middles[frame] - pose.from);
        let turn = DMat2::from_angle(self.state.roll_rad) * (1.0 + self.state.scale);
        window + self.state.shift_px[frame] + turn * (rendered - window)
    }

    /// Whether the roll that is fitted to all images is each one's whole.
    fn one_roll(&self) -> bool {
        self.poses.iter().all(|pose| (pose.roll_rad - self.poses[0].roll_rad).abs() < 1e-12)
    }

    /// A parameter of the baseline, counted from the table's own prediction.
    pub(crate) fn told_value(&self, parameter: Parameter) -> f64 {
        let moved = |frame: usize| self.seen_at(frame) - self.middles[frame];
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

    /// A note for each image: the same numbers as the baseline's parameters.
    pub(crate) fn placements(&self) -> Vec<String> {
        if !self.registered {
            return Vec::new();
        }
        let note = |frame: usize| {
            let (from, to) = (self.middles[frame], self.seen_at(frame));
            let turned = self.poses[frame].roll_rad + self.state.roll_rad;
            format!(
                "{}: the body that the table predicts at ({:.2}, {:.2}) px is seen at ({:.2}, {:.2}), turned by {:.3} deg, {:.5} times as large (shift_x_px {:.2}, shift_y_px {:.2}, scale_relative {:.5})",
                self.names[frame],
                from.x,
                from.y,
                to.x,
                to.y,
                turned.sin().atan2(turned.cos()).to_degrees(),
                1.0 + self.state.scale,
                to.x - from.x,
                to.y - from.y,
                self.state.scale,
            )
        };
        (0..self.sights.len()).map(note).collect()
    }
}
