"""Prints the report of bench_cycles.py as a table."""


def print_table(variant, report):
    print(f"\nMoon, {variant} albedo, Lambert, phases {', '.join(map(str, report['phases_deg']))} deg")
    print("\nSeconds a frame (wall, files written; start-up apart)")
    print(f"  {'':34}{'s/frame':>9}{'CPU s':>9}{'1st after':>10}{'frames':>8}{'peak MB':>9}{'load':>12}")
    for name, t in report["timings"].items():
        load = f"{t['load'][0]:.1f}-{t['load'][1]:.1f}"
        times = f"{t['frame_s']:9.3f}{t['cpu_s']:9.3f}{t['first_frame_s']:10.2f}"
        print(f"  {name:34}{times}{t['frames']:8}{t['peak_mb']:9.0f}{load:>12}")
    for name, ratio in report["speed_ratios"].items():
        print(f"  {name}: {ratio:.1f} times")
    first = next(iter(report["errors"].values()))
    mean = first["mean_reference"]
    print(
        f"\nError in I/F against Cycles at 2 x {report['reference_samples']} samples,"
        f" % of the crops' mean I/F {mean:.4f}; {first['pixels']} pixels,"
        f" {first['pixels_limb']} within 1 px of the limb"
    )
    print(
        f"  {'':20}{'gain':>9}{'all':>8}{'inside':>8}{'limb':>8}{'p50':>8}{'p95':>8}{'p99':>8}{'max':>8}"
        f"{'coverage':>10}{'shift px':>17}"
    )
    for name, e in report["errors"].items():
        q = e["percentiles"]
        values = [e["rms"], e["rms_interior"], e["rms_limb"], q["50"], q["95"], q["99"], e["max"]]
        cells = "".join(f"{100 * v / mean:8.3f}" for v in values)
        shift = " ".join(f"{v:+.4f}" for v in e["shift_px"])
        print(f"  {name:20}{e['gain']:9.5f}{cells}{e['rms_coverage_limb']:10.5f}{shift:>17}")
    noise = report["reference_noise"]
    cells = "".join(f"{100 * noise[k] / mean:8.3f}" for k in ("rms", "rms_interior", "rms_limb"))
    print(f"  {'(reference noise)':20}{'':9}{cells}")
    if report["whole_discs"]:
        print("\nWhole discs, against `retina --backend cpu --quality best`, % of their mean I/F")
        print(f"  {'':20}{'gain':>9}{'all':>8}{'p50':>8}{'p95':>8}{'p99':>8}{'max':>8}")
        for name, e in report["whole_discs"].items():
            q = e["percentiles"]
            cells = "".join(
                f"{100 * v / e['mean_reference']:8.3f}" for v in (e["rms"], q["50"], q["95"], q["99"], e["max"])
            )
            print(f"  {name:20}{e['gain']:9.5f}{cells}")
