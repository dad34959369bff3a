"""`vo evaluate`."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from ..console import show_evaluation
from ..errors import DataError
from ..evaluation import KITTI_LENGTHS, KITTI_STEP, evaluate
from ..poses import read_kitti_pair
from .common import parse_lengths, parse_whole


def add(commands: Any) -> None:
    """Declare `vo evaluate`."""
    parser = commands.add_parser(
        "evaluate",
        help="KITTI errors of trajectories",
        epilog="example: vo evaluate --truth poses/07.txt --estimate runs/07/poses.txt",
    )
    parser.add_argument("--truth", nargs="+", required=True, metavar="GT", help="KITTI pose files")
    parser.add_argument(
        "--estimate", nargs="+", required=True, metavar="EST", help="as many, in the same order"
    )
    parser.add_argument("--lengths", metavar="L,L,…", help="sub-sequence lengths, metres; default 100,…,800")
    parser.add_argument("--step", metavar="N", help="frames from one start to the next; default 10")
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
    pairs = [
        (name, *read_kitti_pair(truth, estimate))
        for name, truth, estimate in zip(names, options.truth, options.estimate, strict=True)
    ]
    result = evaluate(pairs, lengths, step)
    if options.json:
        print(json.dumps(result.to_dict(), indent=2, allow_nan=False))
    else:
        show_evaluation(result)
    return 0
