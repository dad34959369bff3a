"""`vo bench`: what the method costs on this machine, stage by stage, beside decoding the same images."""

from __future__ import annotations

import argparse
import json
import os
import platform
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ..config import preset
from ..core.types import Array, Progress
from ..data.problems import random_problems
from ..data.sequence import SYNTHETIC, Sequence
from ..method.five_point import five_point
from ..runs.identity import surroundings, versions
from ..runs.results import timing
from ..runs.runner import run, single_threaded
from .common import add_cache, open_with_bar, parse_whole
from .console import reporting, say, show_table

SCENE = f"{SYNTHETIC}traffic"
METHOD = "feature_selection"
BATCHES = (200, 1000)
ONE_BY_ONE = 100  # sets for OpenCV, which takes one at a time
REPEATS = 10


def add(parser: argparse.ArgumentParser) -> None:
    """Declare `vo bench`."""
    parser.epilog = "example: vo bench --sequence kitti/00 --frames 200 --json > bench.json"
    parser.add_argument("--sequence", metavar="S", default=SCENE, help=f"name or folder; default {SCENE}")
    parser.add_argument("--frames", metavar="N", default="200", help="frames from the first; default 200")
    parser.add_argument("--json", action="store_true", help="print JSON")
    add_cache(parser)
    parser.set_defaults(command=_bench)


def _bench(options: argparse.Namespace) -> int:
    frames = parse_whole("--frames", options.frames)
    sequence = open_with_bar(options.sequence, options.cache)
    sequence = sequence.part(0, max(2, min(frames, len(sequence))))
    machine = describe_machine()
    with reporting(f"bench, {sequence.name}") as report:
        figures = measure(sequence, report)
    figures["five_point_us_a_set"] = microseconds_a_set(REPEATS)
    camera = sequence.camera
    what = {"name": sequence.name, "frames": len(sequence), "method": METHOD}
    what |= {"width_px": camera.width, "height_px": camera.height}
    if options.json:
        print(json.dumps({"machine": machine, "sequence": what, **figures}, indent=2, allow_nan=False))
        return 0
    say(", ".join(f"{name} {value}" for name, value in machine.items()))
    whole, used, decoding = (figures[f"{name}_ms_a_frame"] for name in ("wall", "processor", "decoding"))
    rows = [[name, f"{ms:.2f} ms"] for name, ms in figures["stages_ms_a_frame"].items()]
    rows.append(["decoding the images in one thread", f"{decoding:.2f} ms"])
    rows.append(["whole run, wall", f"{whole:.2f} ms, {whole / decoding:.1f} times the decoding"])
    rows.append(["whole run, processor time", f"{used:.2f} ms, {used / decoding:.1f} times the decoding"])
    sets = figures["five_point_us_a_set"].items()
    rows += [[f"five-point set, {name}", f"{us:.1f} µs"] for name, us in sets]
    title = f"{sequence.name}, {len(sequence)} frames, {camera.width}×{camera.height} px, {METHOD}"
    show_table(title, ["a frame", "time"], rows)
    return 0


def measure(sequence: Sequence, progress: Progress | None = None) -> dict[str, Any]:
    """Run the method over a sequence, then decode its images alone; milliseconds a frame.

    Stages by the wall clock; the whole run by the wall clock and by the processor time of all threads;
    decoding by its processor time, in one thread.
    """
    count, config = len(sequence), preset(METHOD)
    run(sequence.part(0, 2), config)  # what a process does once is no part of a frame
    wall, used = time.perf_counter(), time.process_time()
    result = run(sequence, config, progress)
    wall, used = time.perf_counter() - wall, time.process_time() - used
    decoding = time.process_time()
    for i in range(count):
        sequence.stereo(i)
    decoding = time.process_time() - decoding
    return {
        "stages_ms_a_frame": timing(result)["ms_per_frame_of"],
        "wall_ms_a_frame": 1e3 * wall / count,
        "processor_ms_a_frame": 1e3 * used / count,
        "decoding_ms_a_frame": 1e3 * decoding / count,
    }


def microseconds_a_set(repeats: int) -> dict[str, float]:
    """Least time of several of one five-point set, one thread; by solver and batch, noise of 0.3 px."""

    def opencv(x_p: Array, x_c: Array) -> None:
        for pair in zip(x_p, x_c, strict=True):
            cv2.findEssentialMat(pair[0], pair[1], np.eye(3))

    solvers: dict[str, tuple[Callable[[Array, Array], Any], int]] = {
        **{f"this kit, batch of {batch}": (five_point, batch) for batch in BATCHES},
        "OpenCV findEssentialMat": (opencv, ONE_BY_ONE),
    }
    times = {}
    with single_threaded():
        for name, (solve, batch) in solvers.items():
            given = random_problems(np.random.default_rng(1), batch, 5, "forward", noise_px=0.3)
            seconds = []
            for _ in range(repeats + 1):
                start = time.perf_counter()
                solve(given.x_p, given.x_c)
                seconds.append(time.perf_counter() - start)
            times[name] = 1e6 * min(seconds) / batch
    return times


def describe_machine() -> dict[str, Any]:
    """Processor, its cores, system, commit and versions."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text(encoding="utf-8").splitlines() if cpuinfo.is_file() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    processor = names[0] if names else platform.processor() or platform.machine()
    return {"processor": processor, "cores": os.cpu_count(), **surroundings(), **versions()}
