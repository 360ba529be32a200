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

/// Relative albedo, trilinear between mip levels; `footprint_uv2` is the sample's area in uv.
fn albedo(index: u32, uv: vec2<f32>, footprint_uv2: f32) -> f32 {
    let map = map_at(index);
    let texels_covered = footprint_uv2 * f32(map.width) * f32(map.height);
    let level = clamp(0.5 * log2(max(texels_covered, 1.0e-12)), 0.0, f32(map.levels - 1u));
    let low = albedo_at_level(map, uv, u32(level));
    if fract(level) < 0.01 {
        return low;
    }
    return mix(low, albedo_at_level(map, uv, u32(level) + 1u), fract(level));
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

/// Tangent-space slopes, averaged as slopes: the mean of a relief's normals is its mean slope.
fn slope(index: u32, uv: vec2<f32>, footprint_uv2: f32) -> vec2<f32> {
    let map = map_at(index);
    let texels_covered = footprint_uv2 * f32(map.width) * f32(map.height);
    let level = clamp(0.5 * log2(max(texels_covered, 1.0e-12)), 0.0, f32(map.levels - 1u));
    let upper = min(u32(level) + 1u, map.levels - 1u);
    return mix(slope_at_level(map, uv, u32(level)), slope_at_level(map, uv, upper), fract(level));
}
