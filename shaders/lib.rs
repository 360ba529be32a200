//! The WGSL modules, put together from their shared parts. Each function returns the source of one stage.

const TYPES: &str = include_str!("shared/types.wgsl");
const CAMERA: &str = include_str!("shared/camera.wgsl");
const INTERSECT: &str = include_str!("shared/intersect.wgsl");
const PHOTOMETRY: &str = include_str!("shared/photometry.wgsl");
const TEXTURE: &str = include_str!("shared/texture.wgsl");
const SURFACE: &str = include_str!("shared/surface.wgsl");
const OUTPUT: &str = include_str!("shared/output.wgsl");

/// `//!` headers are ours to read; WGSL knows `//` alone, which they also are.
fn module(parts: &[&str]) -> String {
    parts.concat()
}

/// Rasterises every triangle: a sample keeps the index of its triangle.
pub fn visibility() -> String {
    // The enable directive must stand before everything else.
    module(&["enable primitive_index;\n", TYPES, CAMERA, include_str!("visibility.wgsl")])
}

fn shading(stage: &str) -> String {
    module(&[TYPES, CAMERA, INTERSECT, PHOTOMETRY, TEXTURE, SURFACE, OUTPUT, stage])
}

/// Shades the samples, and lists the pixels that need rays.
pub fn shade() -> String {
    shading(include_str!("shade.wgsl"))
}

/// Samples the listed pixels anew by rays.
pub fn refine() -> String {
    shading(include_str!("refine.wgsl"))
}

/// Plans the dispatches of `refine`.
pub fn refine_plan() -> String {
    shading(include_str!("refine_plan.wgsl"))
}

/// Resamples the radiance through the distortion D.
pub fn warp() -> String {
    module(&[TYPES, CAMERA, include_str!("warp.wgsl")])
}

#[cfg(test)]
mod tests {
    use naga::valid::{Capabilities, ValidationFlags, Validator};

    #[test]
    fn every_permutation_of_every_shader_is_valid() {
        for (name, source) in [
            ("visibility", super::visibility()),
            ("shade", super::shade()),
            ("refine", super::refine()),
            ("refine_plan", super::refine_plan()),
            ("warp", super::warp()),
        ] {
            let module = naga::front::wgsl::parse_str(&source)
                .unwrap_or_else(|error| panic!("{name}: {}", error.emit_to_string(&source)));
            let capabilities = Capabilities::PRIMITIVE_INDEX | Capabilities::SHADER_FLOAT16_IN_FLOAT32;
            let mut validator = Validator::new(ValidationFlags::all(), capabilities);
            let info = validator.validate(&module).unwrap_or_else(|error| panic!("{name}: {error:?}"));
            let permutations: &[f64] = if module.overrides.is_empty() { &[] } else { &[0.0, 1.0] };
            for &layers in permutations {
                let constants = naga::back::PipelineConstants::from_iter([("LAYERS".to_string(), layers)]);
                let (module, _) =
                    naga::back::pipeline_constants::process_overrides(&module, &info, None, &constants)
                        .unwrap_or_else(|error| panic!("{name}: {error:?}"));
                Validator::new(ValidationFlags::all(), capabilities)
                    .validate(&module)
                    .unwrap_or_else(|error| panic!("{name}, LAYERS = {layers}: {error:?}"));
            }
        }
    }
}
