"""What the Python binding costs, and what `solve_stars` takes beside the command.

Run with an interpreter that has the wheel: `python validation/python_speed.py`. Times are medians.
"""

import json
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import retina


def median_ms(call, turns: int) -> float:
    """Median time of a call, ms, after one that prepares."""
    call()
    times = []
    for _ in range(turns):
        start = time.perf_counter()
        call()
        times.append(1e3 * (time.perf_counter() - start))
    return statistics.median(times)


def main() -> None:
    tiny = np.full((16, 16), 100, np.uint16)
    system = retina.OpticalSystem("reference-1.3fc-wide")
    bodies = retina.Ephemeris()
    for name, call in (
        ("retina.time_s(text)", lambda: retina.time_s("2027-08-02T10:06:36Z")),
        ("Ephemeris.position_m", lambda: bodies.position_m("sun", 0.0)),
        ("OpticalSystem.trace, one ray", lambda: system.trace()),
        ("OpticalSystem.trace_ray", lambda: system.trace_ray()),
        ("detect, 16 x 16 pixels", lambda: retina.detect(tiny)),
        ("fit_limb, 16 x 16 pixels", lambda: retina.fit_limb(tiny, fov_deg=10.0)),
        ("Setup(name)", lambda: retina.Setup("wide-fov")),
    ):
        print(f"{name:<32} {median_ms(call, 200):8.3f} ms a call")

    rows = 2000
    rng = np.random.default_rng(1)
    seen = rng.uniform(200.0, 1300.0, (rows, 2))
    setup = retina.Setup("wide-fov")
    shown = setup.facility_pinhole.pixel(setup.camera_pinhole.line_of_sight(seen))
    table = {"image": [f"{at // 50:03}" for at in range(rows)], "screen_x_px": shown[:, 0], "screen_y_px": shown[:, 1]}
    table |= {"digital_count": np.full(rows, 200), "camera_x_px": seen[:, 0], "camera_y_px": seen[:, 1]}
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "points.csv"
        taken = median_ms(lambda: retina.write_table(table, file, setup), 30)
        print(f"a table of {rows} rows and {len(table)} columns, checked and written: {taken:.1f} ms")

    stars = {"faintest_magnitude": 7.0}
    scene = retina.Scene(
        {"setup": "wide-fov", "trajectory": {"kind": "deep-space", "frames": 1, "seed": 4}, "stars": stars}
    )
    image = scene[0].counts
    answer = retina.solve_stars(image, fov_deg=(18.0, 20.0))
    whole = median_ms(lambda: retina.solve_stars(image, fov_deg=(18.0, 20.0)), 30)
    answer = retina.solve_stars(image, fov_deg=(18.0, 20.0))
    work = answer.detect_ms + answer.solve_ms
    print(f"solve_stars, {image.shape[1]} x {image.shape[0]} pixels, {answer.matches} stars:")
    print(f"  the call {whole:.1f} ms, of which pixels to points and points to attitude {work:.1f} ms")
    from retina import _native

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "stars.png"
        file.write_bytes(_native.grey_png_bytes(image))
        command = [str(Path(sys.executable).parent / "retina"), "navigate", "stars"]

        def seconds(copies: int) -> float:
            start = time.perf_counter()
            done = subprocess.run(
                [*command, *[str(file)] * copies, "--fov-deg", "18..20", "--json"], capture_output=True, check=True
            )
            assert all(entry["solved"] for entry in json.loads(done.stdout)["images"])
            return time.perf_counter() - start

        # Of several copies the later ones have their solver prepared, as the later calls have.
        each_ms = statistics.median(1e3 * (seconds(41) - seconds(1)) / 40 for _ in range(5))
    print(f"  the command on the same image as a PNG, each further copy: {each_ms:.1f} ms")


if __name__ == "__main__":
    main()
