"""Measure the processing time of each stage per frame on this machine.

examples:
  vo data measure_speed
  vo data measure_speed --sequence kitti/00 --frames 200 --variant kit

For comparison, the script also measures the time for decoding the images.
"""

from __future__ import annotations

import argparse
import os
import time
from typing import Any

from vo_lib.commands.common import add_cache, add_variant, open_with_bar, parse_whole
from vo_lib.commands.console import print_wrapped, reporting, show_table
from vo_lib.config import preset
from vo_lib.data.catalogue import SYNTHETIC
from vo_lib.data.sequence import Sequence
from vo_lib.geometry.types import Progress
from vo_lib.paper.settings import MethodConfig
from vo_lib.runs.drive import run as run_sequence
from vo_lib.runs.folder import timing
from vo_lib.runs.identity import library_versions, machine_info

SCENE = f"{SYNTHETIC}traffic"
METHOD = "feature_selection"


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options."""
    parser.add_argument("--sequence", metavar="S", default=SCENE, help=f"name or folder; default {SCENE}")
    parser.add_argument("--frames", metavar="N", default="200", help="number of frames; default 200")
    add_variant(parser)
    add_cache(parser)


def run(options: argparse.Namespace) -> int:
    """Measure the times and print them as a table."""
    frames = parse_whole("--frames", options.frames)
    config = preset(METHOD, variant=options.variant or "published")
    sequence = open_with_bar(options.sequence, options.cache)
    sequence = sequence.part(0, max(2, min(frames, len(sequence))))
    with reporting(f"measuring {sequence.name}") as report:
        figures = measure(sequence, config, report)
    machine = describe_machine()
    camera = sequence.camera
    print_wrapped(", ".join(f"{name} {value}" for name, value in machine.items()))
    decoding = figures["decoding_ms_a_frame"]
    rows = [[name, f"{ms:.2f} ms"] for name, ms in figures["stages_ms_a_frame"].items()]
    rows.append(["decoding the images in one thread", f"{decoding:.2f} ms"])
    for name in ("wall", "processor"):
        ms = figures[f"{name}_ms_a_frame"]
        rows.append([f"whole run, {name} time", f"{ms:.2f} ms, {ms / decoding:.1f} times the decoding"])
    size = f"{camera.width}×{camera.height} px"
    print_wrapped(f"{sequence.name}, {len(sequence)} frames, {size}, {METHOD}, {config.variant}")
    show_table(["stage", "time per frame"], rows)
    return 0


def measure(sequence: Sequence, config: MethodConfig, progress: Progress | None = None) -> dict[str, Any]:
    """Times, in milliseconds per frame, of a method on a sequence and of decoding the images.

    The stages are in wall time, the whole run in wall time and in processor time of all threads, the
    decoding in processor time of one thread.
    """
    count = len(sequence)
    run_sequence(sequence.part(0, 2), config)  # excludes work that a process does only once
    wall_start = time.perf_counter()
    processor_start = time.process_time()
    result = run_sequence(sequence, config, progress)
    wall = time.perf_counter() - wall_start
    processor = time.process_time() - processor_start
    decoding_start = time.process_time()
    for index in range(count):
        sequence.stereo(index)
    decoding = time.process_time() - decoding_start
    return {
        "stages_ms_a_frame": timing(result)["ms_per_frame_of"],
        "wall_ms_a_frame": 1e3 * wall / count,
        "processor_ms_a_frame": 1e3 * processor / count,
        "decoding_ms_a_frame": 1e3 * decoding / count,
    }


def describe_machine() -> dict[str, Any]:
    """Processor, number of cores, operating system, commit and versions."""
    return {"cores": os.cpu_count(), **machine_info(), **library_versions()}
