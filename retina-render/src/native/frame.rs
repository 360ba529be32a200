//! A frame made ready: bodies placed before the camera, and their triangles sorted into tiles of the image.

use glam::{DVec2, DVec3, Mat3, Vec3};
use rayon::prelude::*;
use retina_radiometry::{Photometry, sun_angular_radius_rad, sun_irradiance_w_m2_nm};
use retina_simd::Level;

use super::law::Laws;
use crate::FrameState;
use crate::arrays::SceneArrays;
use crate::frame::contrast_reference;
use crate::placing::{RAY_OFFSET, Region, shadow_casters};
use crate::small::small_disc;

/// Side of a tile, pixels.
pub(crate) const TILE: u32 = 16;

/// A body in the frame at hand: f32, body axes and metres unless a name says otherwise.
pub(crate) struct Placed<'a> {
    pub photometry: &'a Photometry,
    pub laws: Laws<'a>,
    /// Lines of sight become body axes with these: x across + y down + ahead.
    pub across: Vec3,
    pub down: Vec3,
    pub ahead: Vec3,
    pub camera_from_body: Mat3,
    /// Unit, from the body's centre.
    pub sun_direction: Vec3,
    pub inverse_sun_distance: f32,
    pub sun_angular_radius: f32,
    /// Farther below a facet's horizon no part of the Sun is seen from any point of the body.
    sun_spread: f32,
    pub sun_tangent_radius: f32,
    pub sun_irradiance_over_pi: f32,
    pub ray_offset_m: f32,
    /// Difference in I/F inside a pixel above which it is refined.
    pub contrast: f32,
    /// Bodies that may stand before the Sun, and how this body's axes become theirs.
    pub casters: Vec<(usize, Mat3, Vec3)>,
}

/// A vertex as the camera sees it.
#[derive(Clone, Copy)]
struct Projected {
    /// Camera axes, m.
    position_m: DVec3,
    /// In pixels from the region's corner; NaN where it is not before the camera.
    pixel: [f32; 2],
}

/// A tile's rectangle in the image, pixels.
#[derive(Clone, Copy)]
pub(crate) struct Tile {
    pub origin: [u32; 2],
    pub size: [u32; 2],
}

impl Tile {
    /// A pixel from the tile's corner, by its number in the tile.
    pub(crate) fn offset(&self, local: u32) -> [u32; 2] {
        [local % self.size[0], local / self.size[0]]
    }

    /// A pixel in the image, by its number in the tile.
    pub(crate) fn pixel(&self, local: u32) -> [u32; 2] {
        let [x, y] = self.offset(local);
        [self.origin[0] + x, self.origin[1] + y]
    }
}

/// A triangle in a tile: which one, and the pixels of the tile that it may touch, both ends included.
#[derive(Clone, Copy)]
pub(crate) struct Binned {
    pub triangle: u32,
    pub low: [u8; 2],
    pub high: [u8; 2],
}

/// A frame ready to be rendered tile by tile.
pub(crate) struct Prepared<'a> {
    pub arrays: &'a SceneArrays,
    pub state: &'a FrameState,
    pub region: Region,
    pub placed: Vec<Placed<'a>>,
    pub level: Level,
    pub inverse_focal_px: [f32; 2],
    /// Depth from which depths are counted, so that f32 suffices, m.
    pub reference_depth_m: f64,
    /// Discs of bodies of a few pixels: centre and radius within which every pixel is refined.
    pub small: Vec<(DVec2, f64)>,
    projected: Vec<Projected>,
    tiles: [u32; 2],
    /// Where each tile's triangles begin in `binned`; one more than there are tiles.
    starts: Vec<u32>,
    binned: Vec<Binned>,
    /// Of each tile: see [`Prepared::night`].
    nights: Vec<Option<u32>>,
}

impl<'a> Prepared<'a> {
    pub(crate) fn new(
        arrays: &'a SceneArrays,
        photometry: &'a [Photometry],
        state: &'a FrameState,
        region: Region,
        contrast: f64,
        level: Level,
        layers: bool,
    ) -> Self {
        let placed = (0..state.bodies.len())
            .map(|body| Placed::new(state, arrays, &photometry[body], body, contrast))
            .collect();
        let small = (0..state.bodies.len())
            .filter_map(|body| small_disc(state, body, arrays.ranges[body].bounding_radius_m))
            .collect();
        let projected = project(arrays, state, region);
        let tiles = region.size.map(|side| side.div_ceil(TILE));
        let (starts, binned) = bin(arrays, &projected, region, tiles, state.distortion.is_some());
        let reference_depth_m = state.bodies.first().map_or(0.0, |body| body.position_camera_m.z);
        let mut frame = Self {
            arrays,
            state,
            region,
            placed,
            level,
            inverse_focal_px: [(1.0 / state.image.fx_px) as f32, (1.0 / state.image.fy_px) as f32],
            reference_depth_m,
            small,
            projected,
            tiles,
            starts,
            binned,
            nights: Vec::new(),
        };
        frame.nights = (0..frame.tile_count())
            .into_par_iter()
            .map(|tile| if layers { None } else { frame.find_night(tile) })
            .collect();
        frame
    }

    pub(crate) fn tile_count(&self) -> usize {
        (self.tiles[0] * self.tiles[1]) as usize
    }

    pub(crate) fn tile(&self, index: usize) -> Tile {
        let at = [index as u32 % self.tiles[0] * TILE, index as u32 / self.tiles[0] * TILE];
        Tile {
            origin: std::array::from_fn(|k| self.region.origin[k] + at[k]),
            size: std::array::from_fn(|k| TILE.min(self.region.size[k] - at[k])),
        }
    }

    /// The triangles of a tile, in the order of the hierarchy.
    pub(crate) fn triangles(&self, tile: usize) -> &[Binned] {
        &self.binned[self.starts[tile] as usize..self.starts[tile + 1] as usize]
    }

    /// The body of a tile in which every triangle faces away from the Sun: nothing there has light. `None` elsewhere, and where
    /// planes beside the light are wanted.
    pub(crate) fn night(&self, tile: usize) -> Option<u32> {
        self.nights[tile]
    }

    fn find_night(&self, tile: usize) -> Option<u32> {
        let triangles = self.triangles(tile);
        let body_of = |triangle: u32| {
            self.arrays.ranges.partition_point(|range| range.triangle_first <= triangle).saturating_sub(1)
        };
        let away = |binned: &Binned| {
            let corners = &self.arrays.corners[binned.triangle as usize];
            let [a, b, c] = corners.map(|[x, y, z, _]| Vec3::new(x, y, z));
            let (facet, placed) = ((b - a).cross(c - a), &self.placed[body_of(binned.triangle)]);
            let two_sided = corners[0][3] > 0.0;
            !two_sided && facet.dot(placed.sun_direction) < -placed.sun_spread * facet.length()
        };
        let first = triangles.first()?;
        triangles.iter().all(away).then(|| body_of(first.triangle) as u32)
    }

    /// Corners of a triangle in camera axes, m.
    pub(crate) fn corners_m(&self, triangle: u32) -> [DVec3; 3] {
        let [a, b, c, _] = self.arrays.triangles[triangle as usize];
        [a, b, c].map(|vertex| self.projected[vertex as usize].position_m)
    }

    /// Whether the camera sees a triangle's front.
    pub(crate) fn faces_camera(&self, triangle: u32) -> bool {
        let [a, b, c] = self.corners_m(triangle);
        facing(a, b, c) < 0.0
    }

    /// Line of sight of a pixel position.
    pub(crate) fn sight(&self, position_px: DVec2) -> DVec2 {
        let undistorted = self.state.image.line_of_sight(position_px);
        self.state.distortion.as_ref().map_or(undistorted, |d| d.distort(undistorted))
    }
}

impl<'a> Placed<'a> {
    fn new(
        state: &FrameState,
        arrays: &SceneArrays,
        photometry: &'a Photometry,
        own: usize,
        contrast: f64,
    ) -> Self {
        let body = &state.bodies[own];
        let body_from_camera = body.camera_from_body.transpose();
        let distance_m = body.sun_position_body_m.length();
        let casters = shadow_casters(state, &arrays.ranges, own)
            .into_iter()
            .map(|other| {
                let caster = &state.bodies[other];
                let caster_from_camera = caster.camera_from_body.transpose();
                let between = body.position_camera_m - caster.position_camera_m;
                let turn = caster_from_camera * body.camera_from_body;
                (other, turn.as_mat3(), (caster_from_camera * between).as_vec3())
            })
            .collect();
        // Phase angles over the body: the observer and the Sun see it under these half angles.
        let radius_m = arrays.ranges[own].bounding_radius_m;
        let half = |distance_m: f64| (radius_m / distance_m).min(1.0).asin();
        let spread_rad = half(body.position_camera_m.length()) + half(distance_m) + 1e-6;
        Self {
            photometry,
            laws: Laws::new(photometry, body.phase_rad(), spread_rad),
            across: body_from_camera.x_axis.as_vec3(),
            down: body_from_camera.y_axis.as_vec3(),
            ahead: body_from_camera.z_axis.as_vec3(),
            camera_from_body: body.camera_from_body.as_mat3(),
            sun_direction: (body.sun_position_body_m / distance_m).as_vec3(),
            inverse_sun_distance: (1.0 / distance_m) as f32,
            sun_angular_radius: sun_angular_radius_rad(distance_m) as f32,
            sun_spread: (sun_angular_radius_rad(distance_m) + radius_m / distance_m) as f32 * 1.1,
            sun_tangent_radius: sun_angular_radius_rad(distance_m).tan() as f32,
            sun_irradiance_over_pi: (sun_irradiance_w_m2_nm(distance_m) / std::f64::consts::PI) as f32,
            ray_offset_m: (arrays.ranges[own].bounding_radius_m * RAY_OFFSET) as f32,
            contrast: (contrast * contrast_reference(photometry, body.phase_rad())) as f32,
            casters,
        }
    }
}

fn project(arrays: &SceneArrays, state: &FrameState, region: Region) -> Vec<Projected> {
    let corner = DVec2::new(f64::from(region.origin[0]), f64::from(region.origin[1]));
    arrays
        .ranges
        .iter()
        .zip(&state.bodies)
        .flat_map(|(range, body)| {
            let own = &arrays.vertices[range.vertex_first as usize..range.vertex_end as usize];
            own.par_iter()
                .map(|vertex| {
                    let p = DVec3::from_array(vertex.position.map(f64::from));
                    let position_m = body.position_camera_m + body.camera_from_body * p;
                    let mut pixel = [f32::NAN; 2];
                    if position_m.z > 0.0 {
                        let sight = DVec2::new(position_m.x, position_m.y) / position_m.z;
                        let undistorted = match &state.distortion {
                            None => Some(sight),
                            // The identity stands for the Jacobian: this only sorts into tiles.
                            Some(distortion) => {
                                let mut guess = sight;
                                for _ in 0..3 {
                                    guess -= distortion.distort(guess) - sight;
                                }
                                guess.is_finite().then_some(guess)
                            }
                        };
                        if let Some(undistorted) = undistorted {
                            pixel = (state.image.pixel(undistorted) - corner).as_vec2().to_array();
                        }
                    }
                    Projected { position_m, pixel }
                })
                .collect::<Vec<_>>()
        })
        .collect()
}

/// Negative where the camera sees a triangle's front: its corners run counter-clockwise.
fn facing(a: DVec3, b: DVec3, c: DVec3) -> f64 {
    (b - a).cross(c - a).dot(a)
}

/// Triangles that are sorted at a time.
const CHUNK: usize = 16_384;

/// Sorts the triangles that face the camera into the tiles that they may touch.
fn bin(
    arrays: &SceneArrays,
    projected: &[Projected],
    region: Region,
    tiles: [u32; 2],
    distorted: bool,
) -> (Vec<u32>, Vec<Binned>) {
    // Roundings of f32; and the distance of a bent edge from the straight one, with what Newton's steps leave.
    let margin = if distorted { 0.75 } else { 0.01 };
    let count = (tiles[0] * tiles[1]) as usize;
    let chunks: Vec<Vec<(u32, Binned)>> = arrays
        .triangles
        .par_chunks(CHUNK)
        .enumerate()
        .map(|(chunk, triangles)| {
            let mut out = Vec::with_capacity(triangles.len());
            for (index, triangle) in (chunk * CHUNK..).zip(triangles) {
                let corners = [0, 1, 2].map(|k| &projected[triangle[k] as usize]);
                if let Some((low, high)) = pixels(&corners, region, margin) {
                    let surface = &arrays.surfaces[triangle[3] as usize];
                    let [a, b, c] = corners.map(|corner| corner.position_m);
                    let two_sided = surface.flags & crate::arrays::TWO_SIDED != 0;
                    let facing = facing(a, b, c);
                    if facing < 0.0 || (two_sided && facing > 0.0) {
                        put(&mut out, index as u32, low, high, tiles);
                    }
                }
            }
            out
        })
        .collect();
    let mut starts = vec![0u32; count + 1];
    for (tile, _) in chunks.iter().flatten() {
        starts[*tile as usize + 1] += 1;
    }
    for tile in 0..count {
        starts[tile + 1] += starts[tile];
    }
    let mut next = starts.clone();
    let nothing = Binned { triangle: 0, low: [0; 2], high: [0; 2] };
    let mut binned = vec![nothing; starts[count] as usize];
    for (tile, entry) in chunks.into_iter().flatten() {
        let slot = &mut next[tile as usize];
        binned[*slot as usize] = entry;
        *slot += 1;
    }
    (starts, binned)
}

/// The pixels of the region that a triangle may touch, both ends included; `None`: none of them.
fn pixels(corners: &[&Projected; 3], region: Region, margin: f32) -> Option<([u32; 2], [u32; 2])> {
    if corners.iter().all(|corner| corner.position_m.z <= 0.0) {
        return None;
    }
    let last = region.size.map(|side| side - 1);
    if corners.iter().any(|corner| corner.pixel[0].is_nan()) {
        return Some(([0; 2], last));
    }
    let (mut low, mut high) = ([0u32; 2], [0u32; 2]);
    for axis in 0..2 {
        let values = corners.map(|corner| corner.pixel[axis]);
        let least = values[0].min(values[1]).min(values[2]) - margin;
        let most = values[0].max(values[1]).max(values[2]) + margin;
        if most < 0.0 || least >= region.size[axis] as f32 {
            return None;
        }
        // Casts saturate.
        low[axis] = least as u32;
        high[axis] = (most as u32).min(last[axis]);
    }
    Some((low, high))
}

fn put(out: &mut Vec<(u32, Binned)>, triangle: u32, low: [u32; 2], high: [u32; 2], tiles: [u32; 2]) {
    for tile_y in low[1] / TILE..=high[1] / TILE {
        for tile_x in low[0] / TILE..=high[0] / TILE {
            let corner = [tile_x * TILE, tile_y * TILE];
            let within = |value: u32, k: usize| value.saturating_sub(corner[k]).min(TILE - 1) as u8;
            let entry = Binned {
                triangle,
                low: std::array::from_fn(|k| within(low[k], k)),
                high: std::array::from_fn(|k| within(high[k], k)),
            };
            out.push((tile_y * tiles[0] + tile_x, entry));
        }
    }
}
