//! What errors of pixels may depend on.

use retina_diagnosis::Covariate;

use crate::FrameSet;
use crate::model::Sight;

impl FrameSet {
    /// Places, angles, levels, and the table's own columns; `level_dn` is the prediction.
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
        if self.sights.iter().all(|sight| sight.layers.angles.is_some()) {
            // Beside the body: at the horizon.
            let angle = |frame: usize, bin: usize| {
                let sight = &self.sights[frame];
                sight.layers.angles.as_ref().map_or_else(Default::default, |a| a[middle(sight, bin)])
            };
            let degrees = |cosine: f32| f64::from(cosine.clamp(0.0, 1.0)).acos().to_degrees();
            put("incidence_deg", &|frame, bin| degrees(angle(frame, bin).mu0));
            put("emission_deg", &|frame, bin| degrees(angle(frame, bin).mu));
            if self.sights.len() > 1 {
                put("phase_deg", &|frame, bin| f64::from(angle(frame, bin).phase_rad).to_degrees());
            }
        }
        if self.sights.iter().all(|sight| sight.layers.place_rad.is_some()) {
            // Beside the body: below all longitudes and latitudes.
            let place = |frame: usize, bin: usize, k: usize, beside: f64| {
                let sight = &self.sights[frame];
                let value = sight.layers.place_rad.as_ref().map_or(f32::NAN, |p| p[middle(sight, bin)][k]);
                if value.is_finite() { f64::from(value).to_degrees() } else { beside }
            };
            put("longitude_deg", &|frame, bin| place(frame, bin, 0, -181.0));
            put("latitude_deg", &|frame, bin| place(frame, bin, 1, -91.0));
        }
        for (name, values) in &self.numbers {
            put(name, &|frame, _| values[frame]);
        }
        out.push(Covariate { name: "level_dn".to_owned(), values: level_dn.to_vec() });
        out
    }
}
