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

from ..config import Config, preset
from ..core.types import Array, Progress
from ..data.problems import random_problems
from ..data.sequence import SYNTHETIC, Sequence, available
from ..method.five_point import five_point
from ..runs.identity import surroundings, versions
from ..runs.results import timing
from ..runs.runner import run_methods, single_threaded
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
    parser.add_argument(
        "--sequence", metavar="S", help=f"name or folder; default: the first of KITTI found, else {SCENE}"
    )
    parser.add_argument("--frames", metavar="N", default="200", help="frames from the first; default 200")
    parser.add_argument("--method", metavar="M", default=METHOD, help=f"default {METHOD}")
    parser.add_argument("--json", action="store_true", help="print JSON")
    add_cache(parser)
    parser.set_defaults(command=_bench)


def default_sequence() -> str:
    """The first KITTI sequence found, else a drawn scene."""
    return next((name for name in available() if name.startswith("kitti/")), SCENE)


def _bench(options: argparse.Namespace) -> int:
    frames, config = parse_whole("--frames", options.frames), preset(options.method)
    sequence = open_with_bar(options.sequence or default_sequence(), options.cache)
    sequence = sequence.part(0, max(2, min(frames, len(sequence))))
    machine = describe_machine()
    with reporting(f"bench, {sequence.name}") as report:
        figures = measure(sequence, config, report)
    figures["five_point_us_a_set"] = microseconds_a_set(REPEATS)
    what = {"name": sequence.name, "frames": len(sequence), "method": options.method}
    what |= {"width_px": sequence.camera.width, "height_px": sequence.camera.height}
    if options.json:
        print(json.dumps({"machine": machine, "sequence": what, **figures}, indent=2, allow_nan=False))
        return 0
    used_here = ", ".join(f"{name} {machine[name]}" for name in ("python", "numpy", "opencv"))
    say(f"{machine['processor']}, {machine['cores']} cores, {machine['system']}, {used_here}")
    whole, used, decoding = (figures[f"{name}_ms_a_frame"] for name in ("wall", "processor", "decoding"))
    rows = [[name, f"{ms:.2f} ms"] for name, ms in figures["stages_ms_a_frame"].items()]
    rows.append(["decoding the images in one thread", f"{decoding:.2f} ms"])
    rows.append(["whole run, wall", f"{whole:.2f} ms, {whole / decoding:.1f} times the decoding"])
    rows.append(["whole run, processor time", f"{used:.2f} ms, {used / decoding:.1f} times the decoding"])
    rows += [
        [f"five-point set, {name}", f"{us:.1f} µs"] for name, us in figures["five_point_us_a_set"].items()
    ]
    size = f"{what['width_px']}×{what['height_px']} px"
    title = f"{what['name']}, {what['frames']} frames, {size}, {what['method']}"
    show_table(title, ["a frame", "time"], rows)
    if machine["load"] is not None and machine["load"] > 0.5:
        say(f"Other work was running (load {machine['load']}): times on a quiet machine are shorter.")
    return 0


def measure(sequence: Sequence, config: Config, progress: Progress | None = None) -> dict[str, Any]:
    """Run the method over a sequence, then decode its images alone; milliseconds a frame.

    Stages by the wall clock; the whole run by the wall clock and by the processor time of all threads;
    decoding by its processor time, in one thread.
    """
    count = len(sequence)
    run_methods(sequence.part(0, 2), {"": config})  # what a process does once is no part of a frame
    wall, used = time.perf_counter(), time.process_time()
    advance = None if progress is None else lambda done, _: progress(done, 2 * count)
    result = run_methods(sequence, {"": config}, advance)[""]
    wall, used = time.perf_counter() - wall, time.process_time() - used
    decoding = time.process_time()
    for i in range(count):
        sequence.stereo(i)
        if progress is not None:
            progress(count + i + 1, 2 * count)
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
    """Processor, cores that may be used, load, system, commit and versions."""
    affinity = getattr(os, "sched_getaffinity", None)
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text(encoding="utf-8").splitlines() if cpuinfo.is_file() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return {
        "processor": names[0] if names else platform.processor() or platform.machine(),
        "cores": len(affinity(0)) if affinity is not None else os.cpu_count(),
        "load": round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else None,
        **surroundings(),
        **versions(),
    }
