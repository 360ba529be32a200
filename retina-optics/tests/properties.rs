//! Properties of any trace: reversibility, Fermat's principle, invariance under rotation.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

use glam::DVec3;
use proptest::prelude::*;
use retina_optics::{Clipping, Launcher, OpticalSystem, Ray, Shape, Tracer, shipped_design};

const DESIGNS: [&str; 4] =
    ["reference-1.3fc-wide", "reference-1.5fc-narrow", "cooke-triplet", "double-gauss"];

fn load(which: usize) -> OpticalSystem {
    shipped_design(DESIGNS[which]).unwrap().unwrap()
}

/// The system as light from the image sees it, in the same global frame after z -> track - z.
fn reversed(system: &OpticalSystem) -> OpticalSystem {
    let mut back = system.clone();
    let count = system.surfaces.len();
    back.surfaces = (0..count)
        .map(|i| {
            let mut surface = system.surfaces[count - 1 - i].clone();
            if let Shape::Conic { curvature_per_mm, .. } = &mut surface.shape {
                *curvature_per_mm = -*curvature_per_mm;
            }
            let gap = (i + 1 < count).then(|| &system.surfaces[count - 2 - i]);
            surface.thickness_mm = gap.map_or(0.0, |gap| gap.thickness_mm);
            surface.medium = gap.map_or_else(Default::default, |gap| gap.medium.clone());
            surface
        })
        .collect();
    back.groups.clear();
    back
}

proptest! {
    #[test]
    fn light_runs_back_the_way_it_came(
        which in 0usize..4, field in 0.0f64..1.0, x in -0.7f64..0.7, y in -0.7f64..0.7, nm in 480.0f64..640.0,
    ) {
        let system = load(which);
        let t = field * system.fields[2].at[1];
        let ray = Launcher::new(&system).unwrap().ray([0.3 * t, t], [x, y]).unwrap();
        let there = Tracer::new(&system, nm, Clipping::Off).unwrap().trace(&ray).unwrap();
        let (first, last) = (there[0], there[there.len() - 1]);
        let track = system.vertices_mm()[system.image()];
        let mirror = |v: DVec3| DVec3::new(v.x, v.y, -v.z);
        let start = Ray {
            position_mm: mirror(last.position_mm) + DVec3::Z * track,
            direction: DVec3::new(-last.direction.x, -last.direction.y, last.direction.z),
            path_mm: 0.0,
        };
        let back = Tracer::new(&reversed(&system), nm, Clipping::Off).unwrap().trace_to_image(&start).unwrap();
        let home = mirror(back.position_mm - DVec3::Z * track);
        // Half a metre of path and sixteen surfaces: rounding of 1e-13 mm, magnified by the angles.
        prop_assert!((home - first.position_mm).length() < 1e-10, "{} {}", home, first.position_mm);
        prop_assert!((back.path_mm - (last.path_mm - first.path_mm)).abs() < 1e-10);
        let direction = DVec3::new(-back.direction.x, -back.direction.y, back.direction.z);
        prop_assert!((direction - ray.direction).length() < 1e-11);
    }

    #[test]
    fn the_optical_path_is_stationary(
        which in 0usize..4, field in 0.0f64..1.0, x in -0.7f64..0.7, y in -0.7f64..0.7, at in 1usize..6,
    ) {
        let system = load(which);
        let t = field * system.fields[2].at[1];
        let nm = system.primary_nm();
        let ray = Launcher::new(&system).unwrap().ray([0.0, t], [x, y]).unwrap();
        let crossings = Tracer::new(&system, nm, Clipping::Off).unwrap().trace(&ray).unwrap();
        let (before, here, after) = (crossings[at - 1], crossings[at], crossings[at + 1]);
        let index = |i: usize| system.surfaces[i].medium.index(nm).unwrap();
        let z = system.vertices_mm()[at];
        let path = |dx: f64, dy: f64| {
            let (x, y) = (here.local_mm.x + dx, here.local_mm.y + dy);
            let sag = system.surfaces[at].shape.sag_mm(x.hypot(y)).unwrap();
            let point = DVec3::new(x, y, z + sag);
            index(at - 1) * point.distance(before.position_mm) + index(at) * after.position_mm.distance(point)
        };
        let h = 1e-4;
        for (dx, dy) in [(h, 0.0), (0.0, h)] {
            // A central difference leaves h^2 times a third derivative, below 1 / mm^2 here, and rounding of 1e-10.
            let slope = (path(dx, dy) - path(-dx, -dy)) / (2.0 * h);
            prop_assert!(slope.abs() < 1e-8, "{slope}");
        }
    }

    #[test]
    fn turning_field_and_pupil_turns_the_image(
        which in 0usize..4, field in 0.0f64..1.0, x in -0.7f64..0.7, y in -0.7f64..0.7, turn in 0.0f64..6.3,
    ) {
        let system = load(which);
        let t = field * system.fields[2].at[1];
        let launcher = Launcher::new(&system).unwrap();
        let tracer = Tracer::new(&system, system.primary_nm(), Clipping::Off).unwrap();
        let rotate = |v: [f64; 2]| {
            let (s, c) = turn.sin_cos();
            [c * v[0] - s * v[1], s * v[0] + c * v[1]]
        };
        let a = tracer.trace_to_image(&launcher.ray([0.0, t], [x, y]).unwrap()).unwrap();
        let b = tracer.trace_to_image(&launcher.ray(rotate([0.0, t]), rotate([x, y])).unwrap()).unwrap();
        let expected = rotate([a.local_mm.x, a.local_mm.y]);
        prop_assert!((b.local_mm.x - expected[0]).hypot(b.local_mm.y - expected[1]) < 1e-11);
        prop_assert!((a.path_mm - b.path_mm).abs() < 1e-11);
    }
}
