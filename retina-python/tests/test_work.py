"""Long work: the interpreter's lock, Ctrl-C, progress."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import time
from typing import Any

import numpy as np
import pytest

import retina
from conftest import warming_points

LONG = {"exposures": 400, "points": 60, "nodes": (7, 5), "lines": 1}


def test_other_threads_run_meanwhile(warming: dict[str, Any]) -> None:
    turns = 0
    done = threading.Event()

    def count() -> None:
        nonlocal turns
        while not done.is_set():
            turns += 1
            time.sleep(0.001)

    thread = threading.Thread(target=count)
    thread.start()
    begin = time.perf_counter()
    retina.diagnose("wide-fov", warming)
    seconds = time.perf_counter() - begin
    done.set()
    thread.join()
    # With the lock held it would turn once or twice.
    assert turns > 20 * seconds


def test_progress_is_told_and_may_stop_the_work() -> None:
    told: list[tuple[int, int]] = []

    def enough(done: int, total: int) -> None:
        told.append((done, total))
        if done == 3:
            raise StopIteration("enough")

    with pytest.raises(StopIteration, match="enough"):
        retina.simulate_points("wide-fov", **LONG, progress=enough)
    assert told == [(1, 400), (2, 400), (3, 400)]
    # The work ends at its next report, so that the thread is gone soon.
    time.sleep(0.3)
    before = time.process_time()
    time.sleep(0.3)
    assert time.process_time() - before < 0.2


@pytest.mark.skipif(sys.platform == "win32", reason="there are no signals")
@pytest.mark.parametrize("what", ["simulate", "diagnose"])
def test_ctrl_c_is_raised_at_once(what: str) -> None:
    # A process in the background may have been started with the signal ignored.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    table = warming_points(100, 100) if what == "diagnose" else {}
    timer = threading.Timer(0.4, lambda: os.kill(os.getpid(), signal.SIGINT))
    timer.start()
    begin = time.perf_counter()
    with pytest.raises(KeyboardInterrupt):
        if what == "simulate":
            retina.simulate_points("wide-fov", **LONG, progress=None)
        else:
            retina.diagnose("wide-fov", table, flips=99_999)
    assert time.perf_counter() - begin < 2.0
    timer.join()
    signal.signal(signal.SIGINT, before)


def solve_a_dark_image(_: int) -> str:
    try:
        return repr(retina.solve_stars(np.zeros((100, 100), np.uint8), 12.0))
    except retina.RetinaError as error:
        return str(error)


@pytest.mark.skipif(sys.platform != "linux", reason="processes do not fork")
def test_a_forked_process_is_told_and_does_not_hang() -> None:
    solve_a_dark_image(0)
    with multiprocessing.get_context("fork").Pool(1) as pool:
        told = pool.map_async(solve_a_dark_image, [0]).get(timeout=20)
    assert "spawn" in told[0]
