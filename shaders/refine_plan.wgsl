//! Before the probes and before stage 3: how many workgroups the lists and their chunks take.

struct Plan {
    /// Pixels and log2 of the samples of a chunk of edge pixels, then of inner ones.
    edge_pixels: u32,
    edge_samples_log2: u32,
    inner_pixels: u32,
    inner_samples_log2: u32,
    /// Chunks of edge pixels at most; those of inner pixels follow.
    edge_chunks: u32,
    inner_chunks: u32,
    /// log2 of the samples that one invocation takes.
    run_log2: u32,
}

/// (x, y, z) for the probes; then, a chunk each, (x, y, z) for the samples and for the sums.
@group(1) @binding(2) var<storage, read_write> dispatches: array<u32>;
@group(1) @binding(3) var<uniform> plan: Plan;

/// Workgroups along x; the rest goes along y (the limit of one axis is 65535).
const ROW: u32 = 32768u;

fn set_dispatch(at: u32, x: u32, y: u32) {
    dispatches[at] = x;
    dispatches[at + 1u] = y;
    dispatches[at + 2u] = 1u;
}

@compute @workgroup_size(64)
fn plan_chunks(@builtin(global_invocation_id) id: vec3<u32>) {
    let chunk = id.x;
    if chunk >= plan.edge_chunks + plan.inner_chunks {
        return;
    }
    if chunk == 0u {
        set_dispatch(0u, (atomicLoad(&work.counts[LIST_SHADOW]) + 63u) / 64u, 1u);
    }
    let inner = chunk >= plan.edge_chunks;
    let listed = atomicLoad(&work.counts[select(LIST_EDGE, LIST_INNER, inner)]);
    let most = select(plan.edge_pixels, plan.inner_pixels, inner);
    let first = select(chunk, chunk - plan.edge_chunks, inner) * most;
    let pixels = min(listed - min(first, listed), most);
    let samples_log2 = select(plan.edge_samples_log2, plan.inner_samples_log2, inner);
    let groups = ((pixels << (samples_log2 - plan.run_log2)) + 63u) / 64u;
    set_dispatch(3u + 6u * chunk, min(groups, ROW), (groups + ROW - 1u) / ROW);
    set_dispatch(6u + 6u * chunk, (pixels + 63u) / 64u, 1u);
}
