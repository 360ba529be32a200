//! The layout: lenses in section, rays by field, lengths.

use glam::DVec3;
use retina_plot::{Anchor, Axis, Colour, Figure, PALETTE, Panel, Style};

use super::field_label;
use crate::OpticsError;
use crate::analysis::{largest_field, lens_elements};
use crate::glass::Medium;
use crate::launch::Launcher;
use crate::surface::Shape;
use crate::system::{Object, OpticalSystem, Pose};
use crate::trace::{Clipping, Tracer};

/// The section through the axis and the largest field: z along, height across.
struct Section {
    across: [f64; 2],
}

impl Section {
    fn point(&self, at: DVec3) -> [f64; 2] {
        [at.z, at.x * self.across[0] + at.y * self.across[1]]
    }

    /// A surface from -h to h in its own axes.
    fn profile(&self, shape: &Shape, pose: &Pose, h: f64) -> Vec<[f64; 2]> {
        (-24..=24)
            .filter_map(|i| {
                let r = h * f64::from(i) / 24.0;
                let local = DVec3::new(r * self.across[0], r * self.across[1], shape.sag_mm(r)?);
                Some(self.point(pose.rotation * local + pose.vertex_mm))
            })
            .collect()
    }
}

/// Light blue to grey by index: crowns are paler than flints.
fn glass_colour(index: f64) -> Colour {
    let t = ((index - 1.45) / 0.4).clamp(0.0, 1.0);
    let mix = |a: f64, b: f64| (a + (b - a) * t).round() as u8;
    Colour(mix(205.0, 128.0), mix(226.0, 166.0), mix(243.0, 205.0))
}

/// The layout of one or more systems below one another, at one scale.
///
/// # Errors
/// A system whose rays cannot be launched.
pub fn layout_figure(title: &str, systems: &[&OpticalSystem]) -> Result<Figure, OpticsError> {
    let reach = |system: &OpticalSystem| system.vertices_mm().last().copied().unwrap_or(0.0);
    let longest = systems.iter().map(|system| reach(system)).fold(1.0, f64::max);
    let mut panels = Vec::new();
    let mut tallest: f64 = 1.0;
    for system in systems {
        let (panel, height) = layout_panel(system, longest)?;
        tallest = tallest.max(height);
        panels.push(panel);
    }
    let width = 1100.0;
    // Both directions have one scale; below the lenses there is room for dimensions.
    let scale = (width - 16.0) / (1.10 * longest);
    let height = (scale * 3.0 * tallest).clamp(120.0, 700.0) + 50.0;
    let mut figure = Figure::new(title, panels.len(), 1, [width, height]);
    for (row, panel) in panels.into_iter().enumerate() {
        figure.put(row, 0, panel);
    }
    Ok(figure)
}

fn layout_panel(system: &OpticalSystem, longest: f64) -> Result<(Panel, f64), OpticsError> {
    let (_, across) = largest_field(system);
    let section = Section { across };
    let poses = system.poses();
    let launcher = Launcher::new(system)?;
    let tracer = Tracer::new(system, system.primary_nm(), Clipping::Off)?;
    let mut rays: Vec<(usize, Vec<[f64; 2]>)> = Vec::new();
    let mut heights = vec![0.0f64; system.surfaces.len()];
    for (number, field) in system.fields.iter().enumerate() {
        for height in [-1.0, -0.5, 0.0, 0.5, 1.0] {
            let ray = launcher.ray(field.at, [height * across[0], height * across[1]])?;
            let Ok(crossings) = tracer.trace(&ray) else { continue };
            let first = crossings[0].position_mm;
            let start = match system.object {
                Object::Infinity => {
                    let lead = (first.z.min(0.0) - 0.04 * longest - first.z) / ray.direction.z;
                    first + lead * ray.direction
                }
                Object::Distance(_) => ray.position_mm,
            };
            let mut points = vec![section.point(start)];
            for (crossing, largest) in crossings.iter().zip(&mut heights) {
                *largest = largest.max(crossing.local_mm.x.hypot(crossing.local_mm.y));
                points.push(section.point(crossing.position_mm));
            }
            rays.push((number, points));
        }
    }
    // A lens without given diameters is drawn as large as its rays need, with one edge.
    for (first, last) in lens_elements(system) {
        let largest = heights[first..=last].iter().copied().fold(0.0, f64::max);
        heights[first..=last].fill(largest);
    }
    let semi = |i: usize| match system.surfaces[i].aperture.outer_mm {
        outer if outer.is_finite() => outer,
        _ => 1.08 * heights[i],
    };
    let tallest = (0..system.surfaces.len()).map(semi).fold(0.0, f64::max);
    let mut panel = Panel::new(
        Axis::hidden().range(-0.05 * longest, 1.05 * longest),
        Axis::hidden().range(-1.7 * tallest, 1.3 * tallest),
    )
    .equal_aspect()
    .title(&system.name);
    draw_lenses(system, &section, &poses, &semi, &mut panel);
    for (number, points) in &rays {
        let label = field_label(system.object, system.fields[*number].at);
        panel.line(&label, points, Style::thin(PALETTE[number % PALETTE.len()]).width(0.7));
    }
    draw_planes(system, &section, &poses, &semi, &mut panel);
    draw_dimensions(system, tallest, &mut panel);
    Ok((panel, tallest))
}

fn draw_lenses(
    system: &OpticalSystem,
    section: &Section,
    poses: &[Pose],
    semi: &dyn Fn(usize) -> f64,
    panel: &mut Panel,
) {
    for i in 0..system.image() {
        let surface = &system.surfaces[i];
        let h = semi(i);
        if matches!(surface.shape, Shape::IdealLens { .. }) {
            panel.line("", &section.profile(&surface.shape, &poses[i], h), Style::line(Colour::INK));
            continue;
        }
        if surface.medium == Medium::Air {
            continue;
        }
        let index = surface.medium.index(system.primary_nm()).unwrap_or(1.5);
        let mut outline = section.profile(&surface.shape, &poses[i], h);
        let back = section.profile(&system.surfaces[i + 1].shape, &poses[i + 1], semi(i + 1));
        outline.extend(back.into_iter().rev());
        panel.polygon(&outline, Style::line(glass_colour(index)).width(0.0).filled(1.0));
        outline.push(outline[0]);
        panel.line("", &outline, Style::thin(Colour::INK).width(0.8));
    }
}

/// The stop as two ticks beside its opening, the image as a line.
fn draw_planes(
    system: &OpticalSystem,
    section: &Section,
    poses: &[Pose],
    semi: &dyn Fn(usize) -> f64,
    panel: &mut Panel,
) {
    let image = system.image();
    let plane = |i: usize, r: f64| {
        let local = DVec3::new(r * section.across[0], r * section.across[1], 0.0);
        section.point(poses[i].rotation * local + poses[i].vertex_mm)
    };
    for i in [system.stop, image] {
        let h = semi(i).max(0.5);
        if i == image {
            panel.line("", &[plane(i, -h), plane(i, h)], Style::line(Colour::INK).width(1.6));
        } else if system.surfaces[i].medium == Medium::Air {
            for side in [-1.0, 1.0] {
                panel.line(
                    "",
                    &[plane(i, side * h), plane(i, side * (1.5 * h + 1.0))],
                    Style::line(Colour::INK).width(1.6),
                );
            }
        }
        let label = &system.surfaces[i].label;
        if !label.is_empty() {
            panel.text(plane(i, -h), [0.0, if i == image { 12.0 } else { 26.0 }], label, 9.0, Anchor::Middle);
        }
    }
}

/// Lengths between the stop, the groups and the image; without groups, from the first lens to the image.
fn draw_dimensions(system: &OpticalSystem, tallest: f64, panel: &mut Panel) {
    let z = system.vertices_mm();
    let mut marks = vec![0.0];
    for group in &system.groups {
        marks.extend([z[group.first], z[group.last]]);
    }
    marks.push(z[system.image()]);
    marks.sort_by(f64::total_cmp);
    marks.dedup();
    let level = -1.28 * tallest;
    let span = z[system.image()] - z[0];
    let chain = if marks.len() > 2 { marks.as_slice() } else { &[] };
    for pair in chain.windows(2) {
        // Shorter ones have no room for their number.
        if pair[1] - pair[0] > 0.03 * span {
            panel.dimension([pair[0], level], [pair[1], level], format!("{:.1}", pair[1] - pair[0]));
        }
    }
    let label = format!("{:.1} mm", z[system.image()] - z[0]);
    panel.dimension([z[0], 1.2 * level], [z[system.image()], 1.2 * level], label);
}
