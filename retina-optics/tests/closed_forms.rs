//! The trace against closed forms of geometrical optics.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

use std::path::Path;

use glam::DVec3;
use retina_optics::glass::Medium;
use retina_optics::paraxial::Paraxial;
use retina_optics::{
    Aiming, Aperture, Beam, Clipping, Field, Group, Launcher, Object, OpticalSystem, Ray, RayBatch,
    RayFailure, Shape, Surface, Tracer, Wavelength, pupil, shipped_design, shipped_designs,
};
use retina_simd::{InstructionSet, Level};

fn system(surfaces: Vec<Surface>, pupil_mm: f64) -> OpticalSystem {
    let system = OpticalSystem {
        name: "test".into(),
        object: Object::Infinity,
        fields: vec![Field { at: [0.0, 0.0], weight: 1.0 }],
        wavelengths: vec![Wavelength { nm: 550.0, weight: 1.0 }],
        primary: 0,
        beam: Beam::EntrancePupil(pupil_mm),
        stop: 0,
        surfaces,
        groups: Vec::new(),
        clear_fraction: 1.0,
        aiming: Aiming::Paraxial,
    };
    system.check(Path::new("test")).unwrap();
    system
}

fn conic(radius_mm: f64, conic: f64, thickness_mm: f64, index: f64) -> Surface {
    let medium = if index == 1.0 { Medium::Air } else { Medium::Index(index) };
    Surface::new(Shape::Conic { curvature_per_mm: 1.0 / radius_mm, conic }, thickness_mm, medium)
}

fn plane(thickness_mm: f64, index: f64) -> Surface {
    conic(f64::INFINITY, 0.0, thickness_mm, index)
}

fn tracer(system: &OpticalSystem) -> Tracer {
    Tracer::new(system, 550.0, Clipping::Off).unwrap()
}

fn parallel(x: f64, y: f64) -> Ray {
    Ray { position_mm: DVec3::new(x, y, -10.0), direction: DVec3::Z, path_mm: 0.0 }
}

/// EFL of a ball lens of diameter D: n D / (4 (n - 1)), measured from its centre.
#[test]
fn ball_lens() {
    let (n, radius) = (1.5168, 12.0);
    let ball = system(
        vec![conic(radius, 0.0, 2.0 * radius, n), conic(-radius, 0.0, 5.0, 1.0), plane(0.0, 1.0)],
        1.0,
    );
    let first = Paraxial::primary(&ball).unwrap().first_order();
    let efl = n * 2.0 * radius / (4.0 * (n - 1.0));
    assert!((first.efl_mm.unwrap() - efl).abs() < 1e-12);
    assert!((first.bfl_mm.unwrap() - (efl - radius)).abs() < 1e-12);
    assert!((first.rear_principal_mm.unwrap() + radius).abs() < 1e-12);
}

/// Rays that converge to the aplanatic point n R behind the centre of a sphere meet exactly R / n behind it.
#[test]
fn aplanatic_points_of_a_sphere() {
    let (n, radius) = (1.8, 20.0);
    let sphere = system(vec![conic(radius, 0.0, radius + radius / n, n), plane(0.0, n)], 1.0);
    let target = DVec3::new(0.0, 0.0, radius + n * radius);
    for (x, y) in [(1.0, 0.0), (5.0, -3.0), (0.0, 12.0), (10.0, 10.0)] {
        let position_mm = DVec3::new(x, y, -7.0);
        let ray = Ray { position_mm, direction: (target - position_mm).normalize(), path_mm: 0.0 };
        let hit = tracer(&sphere).trace_to_image(&ray).unwrap();
        assert!(hit.local_mm.length() < 2e-13, "{x}, {y}: {}", hit.local_mm);
    }
}

/// Descartes: an ellipsoid of conic -1/n^2 focuses parallel light in glass at n R / (n - 1); a hyperboloid of
/// conic -n^2 from glass into air at R / (n - 1). Optical paths to the focus are equal.
#[test]
fn conic_singlets_free_of_spherical_aberration() {
    let (n, radius) = (1.6, 30.0);
    let ellipsoid =
        system(vec![conic(radius, -1.0 / (n * n), n * radius / (n - 1.0), n), plane(0.0, n)], 1.0);
    let hyperboloid =
        system(vec![plane(8.0, n), conic(-radius, -n * n, radius / (n - 1.0), 1.0), plane(0.0, 1.0)], 1.0);
    for lens in [ellipsoid, hyperboloid] {
        let axis = tracer(&lens).trace_to_image(&parallel(0.0, 0.0)).unwrap();
        for (x, y) in [(3.0, 0.0), (-8.0, 9.0), (0.0, 14.0)] {
            let hit = tracer(&lens).trace_to_image(&parallel(x, y)).unwrap();
            assert!(hit.local_mm.length() < 5e-13, "{x}, {y}: {}", hit.local_mm);
            assert!((hit.path_mm - axis.path_mm).abs() < 5e-13, "{x}, {y}: path");
        }
    }
}

/// A paraboloid is a conic of -1 and also z = r^2 / (2 R); a sphere is also its own r^2, r^4, ... series.
#[test]
fn an_asphere_meets_what_it_equals() {
    let radius: f64 = 40.0;
    let polynomial = |coefficients: Vec<f64>, k: f64, c: f64| {
        let shape = Shape::EvenAsphere { curvature_per_mm: c, conic: k, coefficients };
        system(vec![Surface::new(shape, 30.0, Medium::Index(1.5)), plane(0.0, 1.5)], 1.0)
    };
    let parabola = system(vec![conic(radius, -1.0, 30.0, 1.5), plane(0.0, 1.5)], 1.0);
    let same = polynomial(vec![0.5 / radius], 0.0, 0.0);
    let half = polynomial(vec![0.0, 0.0], -1.0, 1.0 / radius);
    for (x, y) in [(0.0, 0.0), (5.0, 2.0), (-12.0, 9.0)] {
        let a = tracer(&parabola).trace_to_image(&parallel(x, y)).unwrap();
        for other in [&same, &half] {
            let b = tracer(other).trace_to_image(&parallel(x, y)).unwrap();
            assert!((a.local_mm - b.local_mm).length() < 1e-12 && (a.path_mm - b.path_mm).abs() < 1e-12);
        }
    }
}

/// A plate shifts a ray by t sin(a) (1 - cos(a) / sqrt(n^2 - sin^2(a))) across its direction.
#[test]
fn plane_parallel_plate() {
    let (n, t, angle) = (1.5168, 10.0, 0.5f64);
    let plate = system(vec![plane(t, n), plane(5.0, 1.0), plane(0.0, 1.0)], 1.0);
    let direction = DVec3::new(0.0, angle.sin(), angle.cos());
    let ray = Ray { position_mm: DVec3::ZERO, direction, path_mm: 0.0 };
    let hit = tracer(&plate).trace_to_image(&ray).unwrap();
    assert!((hit.direction - direction).length() < 1e-15);
    let straight = direction * (15.0 / angle.cos());
    let shift = (straight.y - hit.position_mm.y) * angle.cos();
    let expected = t * angle.sin() * (1.0 - angle.cos() / (n * n - angle.sin().powi(2)).sqrt());
    assert!((shift - expected).abs() < 1e-14, "{shift} against {expected}");
}

/// The critical angle of n = 1.5 is 41.81 deg: a face tilted by 41 deg lets the axis pass, one by 43 deg does not.
#[test]
fn total_internal_reflection_and_misses_name_their_surface() {
    let mut prism = system(vec![plane(5.0, 1.5), plane(20.0, 1.0), plane(0.0, 1.0)], 1.0);
    prism
        .groups
        .push(Group { tilt_rad: DVec3::new(41f64.to_radians(), 0.0, 0.0), ..Group::aligned("face", 1, 1) });
    let out = tracer(&prism).trace_to_image(&parallel(0.0, 0.0)).unwrap();
    // Snell's law in the face's own axes: 1.5 sin 41 deg = sin of the angle behind it.
    let behind = (1.5 * 41f64.to_radians().sin()).asin() - 41f64.to_radians();
    assert!((out.direction.y.abs() - behind.sin()).abs() < 1e-14, "{}", out.direction);
    prism.groups[0].tilt_rad.x = 43f64.to_radians();
    let failure = tracer(&prism).trace(&parallel(0.0, 0.0)).unwrap_err();
    assert_eq!(failure, RayFailure::TotalReflection { surface: 1 });
    assert_eq!(failure.to_string(), "total internal reflection at surface 2");

    let mut lens = system(vec![conic(10.0, 0.0, 5.0, 1.5), plane(5.0, 1.0), plane(0.0, 1.0)], 1.0);
    assert_eq!(tracer(&lens).trace(&parallel(0.0, 11.0)).unwrap_err(), RayFailure::Missed { surface: 0 });
    lens.surfaces[1].aperture = Aperture { inner_mm: 1.0, outer_mm: 4.0 };
    let clipped = Tracer::new(&lens, 550.0, Clipping::On).unwrap();
    for y in [0.5, 6.0] {
        assert_eq!(clipped.trace(&parallel(0.0, y)).unwrap_err(), RayFailure::Vignetted { surface: 1 });
    }
    assert!(clipped.trace(&parallel(0.0, 3.0)).is_ok());
}

/// A tilt about a pivot: the sphere's centre is the pivot, so turning it changes nothing.
#[test]
fn a_sphere_turned_about_its_centre_is_the_same_sphere() {
    let build = |tilt: f64| {
        let mut lens = system(vec![conic(25.0, 0.0, 30.0, 1.6), plane(0.0, 1.6)], 1.0);
        let tilt_rad = DVec3::new(tilt, -0.7 * tilt, 0.3);
        lens.groups.push(Group { pivot_mm: 25.0, tilt_rad, ..Group::aligned("ball", 0, 0) });
        lens
    };
    let ray = Ray { direction: DVec3::new(0.1, -0.05, 1.0).normalize(), ..parallel(2.0, 5.0) };
    let a = tracer(&build(0.0)).trace_to_image(&ray).unwrap();
    let b = tracer(&build(0.2)).trace_to_image(&ray).unwrap();
    assert!((a.position_mm - b.position_mm).length() < 1e-13);
    assert!((a.path_mm - b.path_mm).abs() < 1e-13);
}

/// Every instruction set gives the bits of the scalar trace, failures included.
#[test]
fn batches_equal_the_scalar_trace_bit_by_bit() {
    let mut systems: Vec<OpticalSystem> =
        shipped_designs().map(|name| shipped_design(name).unwrap().unwrap()).collect();
    let mut tilted = systems[2].clone();
    tilted.groups[0].tilt_rad = DVec3::new(0.01, -0.02, 0.1);
    tilted.groups[1].decentre_mm = DVec3::new(0.3, 0.2, -0.1);
    tilted.clear_fraction = 0.5;
    systems.push(tilted);
    let shape =
        Shape::EvenAsphere { curvature_per_mm: 0.02, conic: -0.4, coefficients: vec![0.0, 1e-6, -2e-9] };
    let mut odd = system(
        vec![
            Surface::new(shape, 5.0, Medium::Index(1.6)),
            conic(-60.0, -2.0, 20.0, 1.0),
            Surface::new(Shape::IdealLens { focal_mm: 50.0 }, 30.0, Medium::Air).semi_diameter(9.0),
            plane(0.0, 1.0),
        ],
        22.0,
    );
    odd.surfaces[1].aperture.inner_mm = 1.0;
    odd.fields.push(Field { at: [0.2, 0.9], weight: 1.0 });
    systems.push(odd);
    let mut prism = system(vec![plane(5.0, 1.5), plane(20.0, 1.0), plane(0.0, 1.0)], 5.0);
    prism.groups.push(Group { tilt_rad: DVec3::new(0.73, 0.0, 0.0), ..Group::aligned("face", 1, 1) });
    systems.push(prism);
    for system in &mut systems {
        system.fields.push(Field { at: [0.1, 0.9], weight: 1.0 });
    }
    let mut failures = [0; 3];
    for system in &systems {
        let launcher = Launcher::new(system).unwrap();
        let tracer = Tracer::new(system, system.primary_nm(), Clipping::On).unwrap();
        for field in &system.fields {
            // 1.6 times the pupil, so that rays are vignetted and miss.
            let rays: Vec<Ray> = pupil::gaussian(9, 23, 0.0)
                .iter()
                .map(|p| launcher.ray(field.at, [1.6 * p.at[0], 1.6 * p.at[1]]).unwrap())
                .collect();
            for level in InstructionSet::ALL.into_iter().filter_map(Level::of) {
                let mut batch: RayBatch = rays.iter().copied().collect();
                tracer.trace_batch_with(&mut batch, level);
                for (i, ray) in rays.iter().enumerate() {
                    match tracer.trace_to_image(ray) {
                        Ok(hit) => {
                            assert_eq!(batch.failure(i), None);
                            let got = [
                                batch.x_mm[i],
                                batch.y_mm[i],
                                batch.z_mm[i],
                                batch.l[i],
                                batch.m[i],
                                batch.n[i],
                            ];
                            let [a, b] = [hit.local_mm.to_array(), hit.local_direction.to_array()];
                            assert_eq!(
                                got,
                                [a[0], a[1], a[2], b[0], b[1], b[2]],
                                "{} {level:?}",
                                system.name
                            );
                            assert_eq!(batch.path_mm[i], hit.path_mm);
                        }
                        Err(failure) => {
                            failures[match failure {
                                RayFailure::Missed { .. } => 0,
                                RayFailure::Vignetted { .. } => 1,
                                RayFailure::TotalReflection { .. } => 2,
                            }] += 1;
                            assert_eq!(batch.failure(i), Some(failure), "{} {level:?}", system.name);
                        }
                    }
                }
            }
        }
    }
    assert!(failures.iter().all(|&count| count > 100), "every failure was to be met too: {failures:?}");
}
