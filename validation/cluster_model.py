"""A million frames on a thousand nodes: which shard size, how long, how much storage.

    validation/cluster_model.py [--frames 1000000] [--nodes 1000] [--seed 1]

An event simulation with the standard library alone. A node takes a shard, starts (scheduler, program, meshes, horizons,
trajectory), renders its frames one after the other, and takes the next. Nodes fail at random; what is done stays, the shard
goes back to the queue, and the node returns after a while. Some nodes are slow. Every attempt pays the start again.

Measured on two cores of a slow machine (VALIDATION.md, "Rendering" and "Campaigns beyond one machine"): 0.45 s a frame, 3.9 s
from start to first frame, and 36 us of trajectory for each frame of the whole sequence. A frame has two files.
"""

import argparse
import heapq
import random

FRAME_S, START_S, TRAJECTORY_S = 0.45, 3.9, 36e-6
SCHEDULER_S = 10.0  # from the end of a task to the start of the next on the same node
STARTS_A_SECOND = 10.0  # what the scheduler starts at most
NODE_LIFE_H, REPAIR_S = 2000.0, 1800.0  # mean time between failures of one node, and until it is back
SLOW_PART, SLOW = 0.02, 3.0
FRAME_SPREAD = 0.3  # of a frame's time from frame to frame, relative


def run(frames, nodes, shards, seed, resume=True):
    rng = random.Random(seed)
    speed = [SLOW if rng.random() < SLOW_PART else 1.0 for _ in range(nodes)]
    start_s = START_S + TRAJECTORY_S * frames
    left = [frames // shards + (k < frames % shards) for k in range(shards)]
    waiting = list(range(shards))
    events = [(0.0, node, -1) for node in range(nodes)]  # (time, node, the shard that ends then)
    heapq.heapify(events)
    next_start, end, busy, tries = 0.0, 0.0, 0.0, 0
    open_shards, idle = shards, []
    while open_shards:
        now, node, shard = heapq.heappop(events)
        if shard >= 0:
            if left[shard] > 0:
                waiting.append(shard)  # it came back unfinished
                if idle:
                    heapq.heappush(events, (now, idle.pop(), -1))
            else:
                open_shards -= 1
                end = max(end, now)
                if not open_shards:
                    break
        if not waiting:
            idle.append(node)
            continue
        shard = waiting.pop(0)
        tries += 1
        begin = max(now + SCHEDULER_S, next_start)
        next_start = begin + 1 / STARTS_A_SECOND
        count = left[shard]
        # A sum of many frames is nearly normal.
        work = speed[node] * max(0.2 * count * FRAME_S, rng.gauss(count * FRAME_S, FRAME_SPREAD * FRAME_S * count**0.5))
        whole = start_s * speed[node] + work
        life = rng.expovariate(1 / (3600 * NODE_LIFE_H))
        if life < whole:
            done = int(max(0.0, (life - start_s * speed[node]) / work) * count) if resume else 0
            left[shard] = count - done
            busy += life
            # The shard waits at once, the node returns after its repair: two events.
            heapq.heappush(events, (begin + life, node, shard))
            speed[node] = SLOW if rng.random() < SLOW_PART else 1.0
        else:
            left[shard] = 0
            busy += whole
            heapq.heappush(events, (begin + whole, node, shard))
    return end, busy, tries


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=1_000_000)
    parser.add_argument("--nodes", type=int, default=1000)
    parser.add_argument("--bytes", type=float, default=0.0, help="bytes of a frame's files")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    ideal = options.frames * FRAME_S / options.nodes
    print(f"ideal: {ideal:.0f} s on {options.nodes} nodes without starts, failures and slow nodes")
    print("| shards | frames in a shard | s of a shard | end, s (mean of 5) | ideal over end | starts over all work | tasks started |")
    print("|---|---|---|---|---|---|---|")
    for shards in (1000, 2000, 3000, 5000, 10_000, 20_000, 50_000, 100_000):
        runs = [run(options.frames, options.nodes, shards, options.seed + k) for k in range(5)]
        end = sum(r[0] for r in runs) / 5
        busy = sum(r[1] for r in runs) / 5
        tries = sum(r[2] for r in runs) / 5
        count = options.frames / shards
        lost = 1 - options.frames * FRAME_S * (1 - SLOW_PART + SLOW_PART * SLOW) / busy
        print(f"| {shards} | {count:.0f} | {count * FRAME_S + START_S:.0f} | {end:.0f} | {ideal / end:.2f} | {max(0, lost):.2f} | {tries:.0f} |")
    if options.bytes:
        print(f"storage: {options.frames * options.bytes / 1e9:.0f} GB in {2 * options.frames} files of frames and truth")


if __name__ == "__main__":
    main()
