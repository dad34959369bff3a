"""`vo evaluate`."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from ..core.errors import DataError
from ..core.poses import read_kitti_pair, read_tum_pair
from ..evaluation.ate_rpe import Alignment
from ..evaluation.axes import LARGEST, TurnedErrors, fit_axes
from ..evaluation.kitti import KITTI_LENGTHS, KITTI_STEP, Evaluation, evaluate, pooled
from ..tables.table1 import number
from .common import parse_lengths, parse_whole
from .console import say, show_table

SEQUENCES_A_TABLE = 4


def add(commands: Any) -> None:
    """Declare `vo evaluate`."""
    parser = commands.add_parser(
        "evaluate",
        help="KITTI errors, ATE and RPE of trajectories",
        epilog="example: vo evaluate --truth poses/07.txt --estimate runs/07/poses.txt",
    )
    parser.add_argument("--truth", nargs="+", required=True, metavar="GT", help="pose files")
    parser.add_argument(
        "--estimate", nargs="+", required=True, metavar="EST", help="as many, in the same order"
    )
    parser.add_argument("--lengths", metavar="L,L,…", help="sub-sequence lengths, metres; default 100,…,800")
    parser.add_argument("--step", metavar="N", help="frames from one start to the next; default 10")
    parser.add_argument(
        "--format", default="kitti", choices=("kitti", "tum"), help="of the files; tum: matched by time"
    )
    parser.add_argument(
        "--alignment",
        default=Alignment.SE3.value,
        choices=[alignment.value for alignment in Alignment],
        help="what may be moved before ATE is taken; default se3",
    )
    parser.add_argument("--delta", metavar="N", default="1", help="frames that RPE is taken over; default 1")
    parser.add_argument(
        "--axes",
        action="store_true",
        help="TE and RE also with the one pitch and yaw of a sequence, between the camera's axes and the "
        f"truth's, that make TE smallest (at most {LARGEST:g}° each; not KITTI's measure)",
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(command=_evaluate)


def _evaluate(options: argparse.Namespace) -> int:
    if len(options.truth) != len(options.estimate):
        raise DataError(
            f"{len(options.truth)} truth files and {len(options.estimate)} estimates: expected pairs"
        )
    lengths = KITTI_LENGTHS if options.lengths is None else parse_lengths(options.lengths)
    step = KITTI_STEP if options.step is None else parse_whole("--step", options.step)
    # Short names where they tell the sequences apart.
    stems = [Path(path).stem for path in options.truth]
    names = stems if len(set(stems)) == len(stems) else options.truth
    read_pair = read_kitti_pair if options.format == "kitti" else read_tum_pair
    pairs = [
        (name, *read_pair(truth, estimate))
        for name, truth, estimate in zip(names, options.truth, options.estimate, strict=True)
    ]
    delta = parse_whole("--delta", options.delta)
    result = evaluate(pairs, lengths, step, Alignment(options.alignment), delta)
    turned = (
        [fit_axes(truth, estimate, lengths, step) for _, truth, estimate in pairs] if options.axes else []
    )
    data = result.to_dict()
    for sequence, axes in zip(data["sequences"], turned, strict=False):
        sequence["axes"] = axes.to_dict()
    if options.json:
        print(json.dumps(data, indent=2, allow_nan=False))
    else:
        _show(result)
        _show_axes(result, turned)
    return 0


def _show(result: Evaluation) -> None:
    """Errors by length, a column for each sequence, a few to a table; then by sequence with both averages."""
    everything = [(s.name, s.kitti) for s in result.sequences] + [("pooled", result.pooled)]
    for first in range(0, len(everything), SEQUENCES_A_TABLE):
        part = everything[first : first + SEQUENCES_A_TABLE]
        rows = []
        for length in result.lengths:
            cells = [errors.by_length([length])[length] for _, errors in part]
            rows.append([f"{length:g} m", *(_pair(cell.te, cell.re) for cell in cells)])
        title = f"TE % / RE deg/100 m by length, a start every {result.step} frames"
        show_table(title, ["length", *(name for name, _ in part)], rows)
    rows = [
        [s.name, str(s.frames), str(len(s.kitti)), _pair(s.kitti.te, s.kitti.re)] for s in result.sequences
    ]
    pooled, mean = result.pooled, result.mean()
    rows.append(["pooled, as the devkit", "", str(len(pooled)), _pair(pooled.te, pooled.re)])
    rows.append(["plain mean", "", "", _pair(mean["te_percent"], mean["re_deg_per_100m"])])
    show_table("all lengths", ["sequence", "frames", "sub-sequences", "TE / RE"], rows)
    rows = []
    for sequence in result.sequences:
        ate, rpe = sequence.ate.to_dict(), sequence.rpe.to_dict()
        values = [ate["rmse_m"], rpe["translation"]["rmse_m"], rpe["rotation"]["rmse_deg"]]
        rows.append([sequence.name, *(number(value, 4) for value in values)])
    show_table("ATE and RPE, root mean squares", ["sequence", "ATE m", "RPE m", "RPE deg"], rows)
    alignment, delta = result.sequences[0].ate.alignment, result.sequences[0].rpe.delta
    say(f"ATE {alignment.words}; RPE from frame to frame + {delta}, which needs no alignment")


def _show_axes(result: Evaluation, turned: list[TurnedErrors]) -> None:
    if not turned:
        return
    rows = [
        [
            s.name,
            f"{t.pitch:+.2f}",
            f"{t.yaw:+.2f}",
            _pair(s.kitti.te, s.kitti.re),
            _pair(t.kitti.te, t.kitti.re),
        ]
        for s, t in zip(result.sequences, turned, strict=True)
    ]
    measured, best = result.pooled, pooled(t.kitti for t in turned)
    rows.append(["pooled", "", "", _pair(measured.te, measured.re), _pair(best.te, best.re)])
    columns = ["sequence", "pitch °", "yaw °", "TE / RE measured", "TE / RE turned"]
    show_table("the estimate's axes turned by one pitch and yaw", columns, rows)
    say("the angles that make TE smallest: a look at the truth, not KITTI's measure")


def _pair(te: float | None, re: float | None) -> str:
    return "–" if te is None or re is None else f"{te:.2f} / {re:.2f}"
