//! Between stages 2 and 3: how many workgroups each chunk of listed pixels takes.

/// Dispatch arguments, (x, y, z) for the samples and (x, y, z) for the sums, a chunk each.
@group(1) @binding(2) var<storage, read_write> dispatches: array<u32>;

/// Workgroups along x; the rest goes along y (the limit of one axis is 65535).
const ROW: u32 = 32768u;

@compute @workgroup_size(64)
fn plan_chunks(@builtin(global_invocation_id) id: vec3<u32>) {
    let chunk = id.x;
    if 6u * chunk >= arrayLength(&dispatches) {
        return;
    }
    let listed = atomicLoad(&work.count);
    let first = chunk * frame.chunk_pixels;
    let pixels = min(listed - min(first, listed), frame.chunk_pixels);
    let groups = (pixels * frame.refined_samples + 63u) / 64u;
    dispatches[6u * chunk] = min(groups, ROW);
    dispatches[6u * chunk + 1u] = (groups + ROW - 1u) / ROW;
    dispatches[6u * chunk + 2u] = 1u;
    dispatches[6u * chunk + 3u] = (pixels + 63u) / 64u;
    dispatches[6u * chunk + 4u] = 1u;
    dispatches[6u * chunk + 5u] = 1u;
}
