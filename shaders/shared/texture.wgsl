//! Textures, filtered here rather than by samplers: the same f32 arithmetic on every device, where
//! hardware weights have 8 bits.

/// Texture coordinate brought into 0..1. Integer remainders would be slow: this and a neighbour's
/// wrap of at most one texel do without.
fn folded(place: f32, mode: u32) -> f32 {
    let repeated = place - floor(place);
    let half = 0.5 * place;
    let mirrored = 1.0 - abs(1.0 - 2.0 * (half - floor(half)));
    return select(select(repeated, mirrored, mode == 2u), place, mode == 1u);
}

/// A texel index at most one step outside 0..size, as the wrap mode continues it.
fn wrapped(index: i32, size: i32, mode: u32) -> i32 {
    let repeated = select(select(index, index - size, index >= size), index + size, index < 0);
    return clamp(select(index, repeated, mode == 0u), 0, size - 1);
}

struct Level {
    first: u32,
    width: i32,
    height: i32,
}

fn map_level(map: Map, level: u32) -> Level {
    var first = map.first;
    var width = map.width;
    var height = map.height;
    for (var k = 0u; k < level; k++) {
        first += width * height;
        width = max(width / 2u, 1u);
        height = max(height / 2u, 1u);
    }
    return Level(first, i32(width), i32(height));
}

/// Bilinear. Each word holds a texel and its right neighbour, so a row takes one read.
fn albedo_at_level(map: Map, uv: vec2<f32>, level: u32) -> f32 {
    let at = map_level(map, level);
    let inside = vec2<f32>(folded(uv.x, map.wrap_u), folded(uv.y, map.wrap_v));
    let place = inside * vec2<f32>(f32(at.width), f32(at.height)) - 0.5;
    let whole = floor(place);
    let part = place - whole;
    let x = wrapped(i32(whole.x), at.width, map.wrap_u);
    let y0 = wrapped(i32(whole.y), at.height, map.wrap_v);
    let y1 = wrapped(i32(whole.y) + 1, at.height, map.wrap_v);
    // Left of an edge that does not repeat both texels are the first one.
    let fraction = select(part.x, 0.0, map.wrap_u != 0u && whole.x < 0.0);
    let top = unpack2x16unorm(texel_word(at.first + u32(y0 * at.width + x)));
    let bottom = unpack2x16unorm(texel_word(at.first + u32(y1 * at.width + x)));
    let row = mix(top, bottom, part.y);
    return mix(row.x, row.y, fraction) * map.scale;
}

/// The parallelogram of texture coordinates that a sample covers.
struct Footprint {
    uv: vec2<f32>,
    along_x: vec2<f32>,
    along_y: vec2<f32>,
}

/// How a footprint is averaged: reads of one mip level, spread over the parallelogram.
struct Taps {
    level: u32,
    count: u32,
}

const MOST_TAPS: f32 = 12.0;

/// The level whose texels are as fine as the footprint is narrow, and as many reads as it takes
/// to cover the footprint's length: towards the limb footprints are long and narrow.
fn taps_of(map: Map, footprint: Footprint) -> Taps {
    let size = vec2<f32>(f32(map.width), f32(map.height));
    let a = footprint.along_x * size;
    let b = footprint.along_y * size;
    let longest = max(length(a + b), length(a - b));
    let narrow = abs(a.x * b.y - a.y * b.x) / max(longest, 1.0e-6);
    let texel = max(max(narrow, longest / MOST_TAPS), 1.0);
    let level = min(floor(log2(texel)), f32(map.levels - 1u));
    let count = clamp(ceil(1.2 * longest * exp2(-level)), 1.0, MOST_TAPS);
    return Taps(u32(level), u32(count));
}

/// Read k of n: a golden-section lattice over the parallelogram, symmetric about its middle, so
/// that the mean is not shifted.
fn tap_uv(footprint: Footprint, k: u32, n: u32) -> vec2<f32> {
    let from_middle = f32(k) - 0.5 * f32(n - 1u);
    let x = from_middle / f32(n);
    let y = fract(0.5 + 0.618034 * from_middle) - 0.5;
    return footprint.uv + footprint.along_x * x + footprint.along_y * y;
}

/// Mean relative albedo over a footprint.
fn albedo(index: u32, footprint: Footprint) -> f32 {
    let map = map_at(index);
    let taps = taps_of(map, footprint);
    var sum = 0.0;
    for (var k = 0u; k < taps.count; k++) {
        sum += albedo_at_level(map, tap_uv(footprint, k, taps.count), taps.level);
    }
    return sum / f32(taps.count);
}

fn slope_texel(map: Map, at: Level, x: i32, y: i32) -> vec2<f32> {
    let column = wrapped(x, at.width, map.wrap_u);
    let row = wrapped(y, at.height, map.wrap_v);
    return unpack2x16float(texel_word(at.first + u32(row * at.width + column)));
}

fn slope_at_level(map: Map, uv: vec2<f32>, level: u32) -> vec2<f32> {
    let at = map_level(map, level);
    let inside = vec2<f32>(folded(uv.x, map.wrap_u), folded(uv.y, map.wrap_v));
    let place = inside * vec2<f32>(f32(at.width), f32(at.height)) - 0.5;
    let whole = floor(place);
    let part = place - whole;
    let x = i32(whole.x);
    let y = i32(whole.y);
    let top = mix(slope_texel(map, at, x, y), slope_texel(map, at, x + 1, y), part.x);
    let bottom = mix(slope_texel(map, at, x, y + 1), slope_texel(map, at, x + 1, y + 1), part.x);
    return mix(top, bottom, part.y);
}

/// Mean tangent-space slopes over a footprint: the mean of a relief's normals is its mean slope.
fn slope(index: u32, footprint: Footprint) -> vec2<f32> {
    let map = map_at(index);
    let taps = taps_of(map, footprint);
    var sum = vec2<f32>(0.0);
    for (var k = 0u; k < taps.count; k++) {
        sum += slope_at_level(map, tap_uv(footprint, k, taps.count), taps.level);
    }
    return sum / f32(taps.count);
}
