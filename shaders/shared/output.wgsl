//! Where samples are summed, pixels are stored, and pixels wait for further work.

/// Lists of pixels, each as long as the image has pixels.
const LIST_SHADOW: u32 = 0u;
const LIST_EDGE: u32 = 1u;
const LIST_INNER: u32 = 2u;

struct Work {
    /// Length of each list.
    counts: array<atomic<u32>, 3>,
    /// Walks that ended before their time (see intersect.wgsl); must stay 0.
    cut_short: atomic<u32>,
    /// Pixel indices, list after list.
    pixels: array<u32>,
}

/// One plane of width * height a quantity: radiance, I/F, then, with LAYERS, mask, depth,
/// normal x y z, incidence, emission, phase (deg), shadow.
@group(1) @binding(0) var<storage, read_write> planes: array<f32>;
@group(1) @binding(1) var<storage, read_write> work: Work;

fn list_pixel(list: u32, pixel: u32) {
    let slot = atomicAdd(&work.counts[list], 1u);
    work.pixels[list * frame.size_px.x * frame.size_px.y + slot] = pixel;
}

fn listed_pixel(list: u32, slot: u32) -> u32 {
    return work.pixels[list * frame.size_px.x * frame.size_px.y + slot];
}

fn note_cut_short() {
    if cut_short {
        atomicAdd(&work.cut_short, 1u);
    }
}

fn sum_of(a: Sample, b: Sample) -> Sample {
    return Sample(
        a.radiance + b.radiance,
        a.radiance_factor + b.radiance_factor,
        a.hit + b.hit,
        a.depth_m + b.depth_m,
        a.normal + b.normal,
        a.incidence + b.incidence,
        a.emission + b.emission,
        a.phase + b.phase,
        a.shadow + b.shadow,
        a.untextured + b.untextured,
        a.in_doubt + b.in_doubt,
    );
}

/// Stores the mean of `count` samples. Radiance, I/F and coverage are means over the pixel, the
/// other layers means over the part of the pixel that a body covers.
fn store_pixel(pixel: u32, total: Sample, count: f32) {
    let plane = frame.size_px.x * frame.size_px.y;
    planes[pixel] = total.radiance / count;
    planes[plane + pixel] = total.radiance_factor / count;
    if LAYERS {
        let hits = max(total.hit, 1.0);
        let length_sum = max(length(total.normal), 1.0e-20);
        planes[2u * plane + pixel] = total.hit / count;
        planes[3u * plane + pixel] = total.depth_m / hits;
        planes[4u * plane + pixel] = total.normal.x / length_sum;
        planes[5u * plane + pixel] = total.normal.y / length_sum;
        planes[6u * plane + pixel] = total.normal.z / length_sum;
        planes[7u * plane + pixel] = degrees(total.incidence / hits);
        planes[8u * plane + pixel] = degrees(total.emission / hits);
        planes[9u * plane + pixel] = degrees(total.phase / hits);
        planes[10u * plane + pixel] = total.shadow / hits;
    }
}

/// Takes the light from a pixel that lies in shadow as a whole.
fn darken_pixel(pixel: u32) {
    let plane = frame.size_px.x * frame.size_px.y;
    planes[pixel] = 0.0;
    planes[plane + pixel] = 0.0;
    if LAYERS {
        planes[10u * plane + pixel] = 1.0;
    }
}
