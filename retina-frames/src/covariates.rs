//! What errors of pixels may depend on.

use retina_diagnosis::Covariate;

use crate::FrameSet;
use crate::layers::Angles;
use crate::model::Sight;

impl FrameSet {
    /// Places, angles, levels, and the table's own columns, NaN where a pixel has none; `level_dn` is the prediction.
    pub(crate) fn covariates(&self, level_dn: &[f64]) -> Vec<Covariate> {
        let mut out = Vec::new();
        let mut put = |name: &str, value: &dyn Fn(usize, usize) -> f64| {
            let values = self.rows.bins.iter().map(|&(frame, bin)| value(frame, bin)).collect();
            out.push(Covariate { name: name.to_owned(), values });
        };
        put("camera_x_px", &|frame, bin| self.sights[frame].bin_px(bin).x);
        put("camera_y_px", &|frame, bin| self.sights[frame].bin_px(bin).y);
        put("axis_r", &|frame, bin| self.sights[frame].axis_r(bin));
        let distances: Vec<Vec<f64>> = self
            .sights
            .iter()
            .map(|sight| {
                let body = sight.layers.coverage.as_ref().unwrap_or(&sight.layers.light);
                let top = body.values.iter().copied().fold(0.0, f32::max);
                let bins = body.averaged(sight.window.fine);
                let side = sight.window.bin as f64;
                bins.edge_distance(|v| v > 0.5 * top.min(1.0)).into_iter().map(|d| d * side).collect()
            })
            .collect();
        put("limb_distance_px", &|frame, bin| distances[frame][bin]);
        let middle = |sight: &Sight, bin: usize| -> usize {
            let (fine, columns) = (sight.window.fine, sight.window.columns);
            (bin / columns * fine + fine / 2) * columns * fine + bin % columns * fine + fine / 2
        };
        // Angles and places are those of the lit disc: the sky has none, and the night side sends no light.
        let lit = |sight: &Sight, bin: usize| {
            let at = middle(sight, bin);
            let on_body = sight.layers.coverage.as_ref().is_none_or(|coverage| coverage.values[at] > 0.5);
            let sunlit = sight.layers.angles.as_ref().is_none_or(|angles| angles[at].mu0 > 0.0);
            on_body && sunlit && sight.layers.light.values[at] > 0.0
        };
        if self.sights.iter().all(|sight| sight.layers.angles.is_some()) {
            let angle = |frame: usize, bin: usize, of: &dyn Fn(Angles) -> f32| -> f64 {
                let sight = &self.sights[frame];
                let angles = sight.layers.angles.as_ref().filter(|_| lit(sight, bin));
                angles.map_or(f64::NAN, |a| f64::from(of(a[middle(sight, bin)])).to_degrees())
            };
            put("incidence_deg", &|frame, bin| angle(frame, bin, &|a| a.mu0.min(1.0).acos()));
            put("emission_deg", &|frame, bin| angle(frame, bin, &|a| a.mu.min(1.0).acos()));
            if self.sights.len() > 1 {
                put("phase_deg", &|frame, bin| angle(frame, bin, &|a| a.phase_rad));
            }
        }
        if self.sights.iter().all(|sight| sight.layers.place_rad.is_some()) {
            let place = |frame: usize, bin: usize, k: usize| -> f64 {
                let sight = &self.sights[frame];
                let places = sight.layers.place_rad.as_ref().filter(|_| lit(sight, bin));
                places.map_or(f64::NAN, |p| f64::from(p[middle(sight, bin)][k]).to_degrees())
            };
            put("longitude_deg", &|frame, bin| place(frame, bin, 0));
            put("latitude_deg", &|frame, bin| place(frame, bin, 1));
        }
        for (name, values) in &self.numbers {
            put(name, &|frame, _| values[frame]);
        }
        out.push(Covariate { name: "level_dn".to_owned(), values: level_dn.to_vec() });
        out
    }
}
