"""`vo bench`."""

from __future__ import annotations

import argparse
import dataclasses
import json
from typing import Any

from ..config import preset
from ..data.sequence import SYNTHETIC, available
from .bench_matches import BESIDE
from .bench_stages import Bench, Effort, run_bench
from .common import add_cache, open_with_bar, parse_whole
from .console import reporting, say, show_table

SCENE = f"{SYNTHETIC}traffic"
METHOD = "feature_selection"


def add(commands: Any) -> None:
    """Declare `vo bench`."""
    parser = commands.add_parser(
        "bench",
        help="how fast and how exact the method is on this machine",
        epilog="example: vo bench --sequence kitti/00 --frames 200 --json > bench.json",
    )
    parser.add_argument(
        "--sequence", metavar="S", help=f"name or folder; default: the first of KITTI found, else {SCENE}"
    )
    parser.add_argument(
        "--frames", metavar="N", default="200", help="frames run, from the first; default 200"
    )
    parser.add_argument("--method", metavar="M", default=METHOD, help=f"default {METHOD}")
    parser.add_argument(
        "--detector", metavar="MODEL", help="measure a detector too: street, a fetched model or an ONNX file"
    )
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
    with reporting(f"bench, {sequence.name}") as report:
        bench = run_bench(sequence, options.method, config, Effort(), report, options.detector)
    if options.json:
        print(json.dumps(dataclasses.asdict(bench), indent=2, allow_nan=False))
    else:
        _show(bench)
    return 0


def _show(bench: Bench) -> None:
    machine = bench.machine
    title = f"{machine['processor']}, {machine['cores']} cores, {machine['system']}, "
    title += ", ".join(f"{name} {machine[name]}" for name in ("python", "numpy", "opencv"))
    what = bench.sequence
    rows = [[name, f"{ms:.2f} ms"] for name, ms in bench.ms_a_frame_of.items()]
    rows.append(["whole run, a frame", f"{bench.whole_run_ms_a_frame:.2f} ms"])
    rows.append(["its processor time, a frame", f"{bench.processor_ms_a_frame:.2f} ms"])
    rows.append(["decoding the images in one thread, a frame", f"{bench.decoding_ms_a_frame:.2f} ms"])
    both = bench.whole_run_ms_a_frame, bench.processor_ms_a_frame
    ratios = " and ".join(f"{ms / bench.decoding_ms_a_frame:.1f}" for ms in both)
    rows.append(["whole run and its processor time, of the decoding", f"{ratios} times"])
    back_end = bench.back_end_from_cache_ms_a_frame
    rows.append(["back end alone from cached matches, a frame", f"{back_end:.2f} ms"])
    if bench.peak_memory_mb is not None:
        rows.append(["peak memory", f"{bench.peak_memory_mb:.0f} MB"])
    rows += [[f"five-point set, {name}", f"{us:.1f} µs"] for name, us in bench.five_point_us_a_set.items()]
    if bench.detector is not None:
        d = bench.detector
        alone = f"{d.model} alone, {d.width_px}×{d.height_px} px, threads: {d.threads}, an image"
        rows.append([alone, f"{d.alone_ms_an_image:.2f} ms"])
        whole = f"whole run with {d.model}, nothing cached, a frame"
        rows.append([whole, f"{d.whole_run_ms_a_frame:.2f} ms"])
    say(title)
    title = f"{what['name']}, {what['frames']} frames, {what['width_px']}×{what['height_px']} px, "
    title += f"{what['matches_a_frame']:.0f} matches a frame, {what['method']}"
    show_table(title, ["what", "time"], rows)
    precision = []
    for p in bench.five_point_precision:
        error = f"{p.median:.0e}", f"{p.percentile_95:.0e}", _percent(p.share_imprecise, 2)
        precision.append([p.solver, p.motion, str(p.problems), *error])
    columns = ["solver", "motion", "problems", "median", "95 %", "worse than 1e-6"]
    show_table("‖E - E*‖ of the best candidate of noise-free problems", columns, precision)
    if bench.features is not None:
        columns = ["where", "matches", "with a known place", "of these left to left", "all images"]
        columns += [f"or {BESIDE} px beside", "median error"]
        shown = []
        for name, e in bench.features.items():
            shares = map(_percent, (e.known_share, e.flow_share, e.right_share, e.beside_share))
            median = "–" if e.median_error is None else f"{e.median_error:.3f} px"
            shown.append([name, str(e.matches), *shares, median])
        show_table("matches against the truth of the scene, shares within 1 px", columns, shown)
    if machine["load"] is not None and machine["load"] > 0.5:
        say(f"Other work was running (load {machine['load']}): times on a quiet machine are shorter.")


def _percent(share: float | None, digits: int = 1) -> str:
    return "–" if share is None else f"{100 * share:.{digits}f} %"
