"""`vo bench`."""

from __future__ import annotations

import argparse
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
        print(json.dumps(bench.to_dict(), indent=2, allow_nan=False))
    else:
        _show(bench)
    return 0


def _show(bench: Bench) -> None:
    machine = bench.machine
    title = f"{machine['processor']}, {machine['cores']} cores, {machine['system']}, "
    title += ", ".join(f"{name} {machine[name]}" for name in ("python", "numpy", "opencv"))
    size = f"{bench.width}×{bench.height} px, {bench.matches:.0f} matches a frame"
    rows = [[name, f"{ms:.2f} ms"] for name, ms in bench.stages.items()]
    rows.append(["whole run, a frame", f"{bench.whole:.2f} ms"])
    rows.append(["back end alone from cached matches, a frame", f"{bench.back_end:.2f} ms"])
    if bench.peak_memory is not None:
        rows.append(["peak memory", f"{bench.peak_memory:.0f} MB"])
    rows += [[f"five-point set, {name}", f"{us:.1f} µs"] for name, us in bench.solver.items()]
    if bench.detector is not None:
        d = bench.detector
        threads = f"{d.threads} thread" + "s" * (d.threads > 1)
        rows.append([f"{d.model} alone, {d.width}×{d.height} px, {threads}, an image", f"{d.alone:.2f} ms"])
        rows.append([f"whole run with {d.model}, nothing cached, a frame", f"{d.whole:.2f} ms"])
    say(title)
    show_table(f"{bench.sequence}, {bench.frames} frames, {size}, {bench.method}", ["what", "time"], rows)
    show_table(
        "‖E - E*‖ of the best candidate of noise-free problems",
        ["solver", "motion", "problems", "median", "95 %", "worse than 1e-6"],
        [
            [
                p.solver,
                p.motion,
                str(p.problems),
                f"{p.median:.0e}",
                f"{p.percentile_95:.0e}",
                f"{100 * p.share_imprecise:.2f} %",
            ]
            for p in bench.solver_precision
        ],
    )
    if bench.features is not None:
        show_table(
            "matches against the truth of the scene, shares within 1 px",
            [
                "where",
                "matches",
                "with a known place",
                "of these left to left",
                "all images",
                f"or {BESIDE} px beside",
                "median error",
            ],
            [
                [
                    name,
                    str(e.matches),
                    *map(_percent, (e.known_share, e.flow_share, e.right_share, e.beside_share)),
                    "–" if e.median_error is None else f"{e.median_error:.3f} px",
                ]
                for name, e in bench.features.items()
            ],
        )
    if machine["load"] is not None and machine["load"] > 0.5:
        say(f"Other work was running (load {machine['load']}): times on a quiet machine are shorter.")


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{100 * share:.1f} %"
