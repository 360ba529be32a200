//! The WGSL modules, put together from their shared parts. Each function returns the source of one stage.
//!
//! The photometric laws and phase functions are retina-radiometry's: their sources are put in, and the two functions
//! that choose among them are generated from its registers.

use std::collections::BTreeSet;

use retina_radiometry::{Law, PhaseFunction, Photometry, Registered};

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

/// The laws and phase functions that a stage can evaluate. Software drivers run every branch of a choice for every
/// sample, so a scene's shaders hold those of its bodies alone.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Kinds {
    /// Indices in the register of laws.
    laws: BTreeSet<usize>,
    /// Indices in the register of phase functions.
    phase_functions: BTreeSet<usize>,
}

impl Kinds {
    /// All that are registered.
    pub fn all() -> Self {
        Self { laws: (0..Law::ALL.len()).collect(), phase_functions: (0..PhaseFunction::ALL.len()).collect() }
    }

    /// Those of these bodies.
    pub fn of<'a>(photometries: impl IntoIterator<Item = &'a Photometry>) -> Self {
        let (laws, phase_functions) = photometries
            .into_iter()
            .map(|photometry| (photometry.law.index() as usize, photometry.phase_function.index() as usize))
            .unzip();
        Self { laws, phase_functions }
    }
}

fn shading(stage: &str, kinds: &Kinds) -> String {
    let laws = chooser::<Law>("law_value", "law", &["mu0", "mu", "phase", "cos_phase"], &kinds.laws);
    let phase_functions =
        chooser::<PhaseFunction>("phase_value", "phase_law", &["phase", "cos_phase"], &kinds.phase_functions);
    let photometry = [PHOTOMETRY, &laws, &phase_functions].concat();
    module(&[TYPES, CAMERA, INTERSECT, &photometry, TEXTURE, SURFACE, OUTPUT, stage])
}

/// The WGSL of these kinds of a register, and a function that calls the one that `field` of the body numbers.
fn chooser<T: Registered>(
    function: &str,
    field: &str,
    arguments: &[&str],
    kinds: &BTreeSet<usize>,
) -> String {
    let sources: String = kinds.iter().map(|&index| format!("\n{}", T::ALL[index].wgsl)).collect();
    let parameters: String = arguments.iter().map(|name| format!(", {name}: f32")).collect();
    let passed: String = arguments.iter().map(|name| format!(", {name}")).collect();
    let value = |index: usize| format!("return {}(body{passed});", T::ALL[index].function);
    let choice = match kinds.first() {
        Some(&only) if kinds.len() == 1 => value(only),
        _ => {
            let cases: String = kinds
                .iter()
                .map(|&index| format!("        case {index}u: {{ {} }}\n", value(index)))
                .collect();
            format!("switch bodies[body].{field} {{\n{cases}        default: {{ return 0.0; }}\n    }}")
        }
    };
    format!("{sources}\nfn {function}(body: u32{parameters}) -> f32 {{\n    {choice}\n}}\n")
}

/// Shades the samples, and lists the pixels that need rays.
pub fn shade(kinds: &Kinds) -> String {
    shading(include_str!("shade.wgsl"), kinds)
}

/// Samples the listed pixels anew by rays.
pub fn refine(kinds: &Kinds) -> String {
    shading(include_str!("refine.wgsl"), kinds)
}

/// Plans the dispatches of `refine`.
pub fn refine_plan(kinds: &Kinds) -> String {
    shading(include_str!("refine_plan.wgsl"), kinds)
}

/// Resamples the radiance through the distortion D.
pub fn warp() -> String {
    module(&[TYPES, CAMERA, include_str!("warp.wgsl")])
}

#[cfg(test)]
mod tests {
    use super::Kinds;
    use naga::valid::{Capabilities, ValidationFlags, Validator};
    use retina_radiometry::{Kind, Law, PhaseFunction, Registered};

    /// naga's module has the kind's function, with that many arguments, and the chooser calls it once, in its place.
    fn check<T>(module: &naga::Module, chooser: &str, index: usize, kind: &Kind<T>, arguments: usize) {
        let find = |name: &str| module.functions.iter().find(|(_, f)| f.name.as_deref() == Some(name));
        let (own, function) = find(kind.function).unwrap_or_else(|| panic!("no WGSL for {}", kind.name));
        assert_eq!(function.arguments.len(), arguments, "{}", kind.name);
        let (_, chooser) = find(chooser).expect("the chooser is generated");
        let cases = chooser.body.iter().find_map(|statement| match statement {
            naga::Statement::Switch { cases, .. } => Some(cases),
            _ => None,
        });
        let value = naga::SwitchValue::U32(index as u32);
        let mut chosen = cases.into_iter().flatten().filter(|case| case.value == value);
        let case = chosen.next().unwrap_or_else(|| panic!("no case for {}", kind.name));
        let calls =
            |s: &naga::Statement| matches!(s, naga::Statement::Call { function, .. } if *function == own);
        assert!(case.body.iter().any(calls) && chosen.next().is_none(), "{}", kind.name);
    }

    #[test]
    fn every_law_and_phase_function_has_a_valid_wgsl_function() {
        for source in [super::shade(&Kinds::all()), super::refine(&Kinds::all())] {
            let module = naga::front::wgsl::parse_str(&source)
                .unwrap_or_else(|error| panic!("{}", error.emit_to_string(&source)));
            let capabilities = Capabilities::PRIMITIVE_INDEX | Capabilities::SHADER_FLOAT16_IN_FLOAT32;
            Validator::new(ValidationFlags::all(), capabilities).validate(&module).expect("it is valid");
            for (index, kind) in Law::ALL.iter().enumerate() {
                check(&module, "law_value", index, kind, 5);
            }
            for (index, kind) in PhaseFunction::ALL.iter().enumerate() {
                check(&module, "phase_value", index, kind, 3);
            }
        }
    }

    #[test]
    fn every_permutation_of_every_shader_is_valid() {
        let none = Kinds { laws: [].into(), phase_functions: [].into() };
        let one = Kinds { laws: [4].into(), phase_functions: [1].into() };
        let mut sources = vec![("visibility", super::visibility()), ("warp", super::warp())];
        for kinds in [Kinds::all(), none, one] {
            sources.push(("shade", super::shade(&kinds)));
            sources.push(("refine", super::refine(&kinds)));
            sources.push(("refine_plan", super::refine_plan(&kinds)));
        }
        for (name, source) in sources {
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
