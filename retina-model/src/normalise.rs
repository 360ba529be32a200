//! The albedo's scale: one factor for the whole body, so that its mean over the surface is 1.

use glam::Vec2;

use retina_files::InputError;

use crate::body::Body;

/// Most samples that the mean takes, for each texel and triangle of the body: bounds the work for a
/// file whose texture coordinates repeat a map thousands of times on each triangle.
const SAMPLES_PER_TEXEL: f64 = 8.0;

/// A triangle's grid of samples is as fine as one sample in this many texels along its longest
/// edge: about one sample a texel of area on the usual right-angled half of a quad.
const TEXELS_PER_STEP: f64 = 1.5;

impl Body {
    /// Area-weighted mean over the surface of map times factor, relative albedo.
    ///
    /// Each triangle is cut into n x n equal ones and the map sampled at their centroids, n from
    /// the triangle's footprint in the texture.
    pub fn mean_albedo(&self) -> f64 {
        let steps = |t: usize| self.footprint_texels(t) / TEXELS_PER_STEP;
        let wanted = self.sum_triangles(|t| steps(t).max(1.0).powi(2));
        let texels: usize = self.albedo_maps.iter().map(|m| m.texels.len()).sum();
        let allowed = SAMPLES_PER_TEXEL * (texels + self.triangles.len()) as f64;
        let coarser = (allowed / wanted).sqrt().min(1.0);
        let sum = self.sum_triangles(|t| {
            let n = (steps(t) * coarser).ceil().max(1.0) as u32;
            self.doubled_area_m2(t).length() * self.triangle_mean(t, n)
        });
        sum / self.sum_triangles(|t| self.doubled_area_m2(t).length())
    }

    /// Length of the triangle's longest edge in the texture, texels; 0 without a map.
    fn footprint_texels(&self, triangle: usize) -> f64 {
        let surface = &self.surfaces[usize::from(self.triangle_surface[triangle])];
        let Some(map) = surface.albedo_map.map(|m| &self.albedo_maps[m]) else { return 0.0 };
        let size = Vec2::new(map.width as f32, map.height as f32);
        let [a, b, c] = self.triangles[triangle].map(|v| self.vertices[v as usize].uv * size);
        f64::from(a.distance(b).max(b.distance(c)).max(c.distance(a))).min(1e9)
    }

    /// Mean of map times factor over one triangle, from n * n samples.
    fn triangle_mean(&self, triangle: usize, n: u32) -> f64 {
        let surface = &self.surfaces[usize::from(self.triangle_surface[triangle])];
        let factor = f64::from(surface.albedo_factor);
        let Some(map) = surface.albedo_map.map(|m| &self.albedo_maps[m]) else { return factor };
        let [a, b, c] = self.triangles[triangle].map(|v| self.vertices[v as usize].uv);
        let (along, across) = ((b - a) / n as f32, (c - a) / n as f32);
        let mut sum = 0.0;
        for j in 0..n {
            for i in 0..n - j {
                let corner = a + along * i as f32 + across * j as f32;
                sum += f64::from(map.sample(corner + (along + across) / 3.0));
                if i + j + 1 < n {
                    sum += f64::from(map.sample(corner + (along + across) * (2.0 / 3.0)));
                }
            }
        }
        factor * sum / f64::from(n).powi(2)
    }

    /// Scales all factors by one number so that [`Body::mean_albedo`] is 1; `place` names the texture
    /// in errors.
    pub(crate) fn normalise_albedo(&mut self, path: &std::path::Path, place: &str) -> Result<(), InputError> {
        let mean = self.mean_albedo();
        // The darkest 8-bit grey is 3e-4: what lies far below it is black by accident or design.
        if !mean.is_finite() || mean < 1e-6 {
            return Err(InputError::new(path, "the body is black all over, so its albedo has no scale")
                .at(place)
                .found(format!("mean relative albedo {mean:.3e}"))
                .expected("a mean above 1e-6")
                .help("check that the texture is the albedo map and that the texture coordinates meet it"));
        }
        for surface in &mut self.surfaces {
            surface.albedo_factor = (f64::from(surface.albedo_factor) / mean) as f32;
        }
        Ok(())
    }
}
