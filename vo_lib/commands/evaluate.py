"""`vo evaluate`: errors of runs and of trajectory files."""

from __future__ import annotations

import argparse
import json
from contextlib import suppress
from pathlib import Path

from ..data.poses import TIME_TOLERANCE_S
from ..errors import DataError
from ..evaluation.ate_rpe import Alignment
from ..evaluation.kitti_errors import SubsequenceProtocol, suitable_protocol
from ..evaluation.path_errors import evaluate
from ..files import read_mapping, write_atomic, written_together
from ..report.paths import evaluation_tables, read_paths, write_pictures
from ..runs.folder import POSES, POSES_TUM, changed_files, run_folder
from .common import changed_words, parse_delta, parse_lengths, parse_whole, require_drawing
from .console import print_lines, print_wrapped, show_report_table, warn

EVALUATION = "evaluation.json"


def add(parser: argparse.ArgumentParser) -> None:
    """Declare `vo evaluate`."""
    parser.epilog = "example: vo evaluate runs/07 orb/07.txt --out figures"
    option = parser.add_argument
    text = (
        "folders of runs, and pose files of other systems: with a line that names the columns (CSV), or in "
        "the format of KITTI, TUM or EuRoC"
    )
    option("paths", nargs="+", type=Path, metavar="RUN_OR_FILE", help=text)
    text = "ground-truth file of all paths; default: the truth of the runs' sequences"
    option("--truth", type=Path, metavar="FILE", help=text)
    text = "sub-sequence lengths, metres; default 100,…,800, or 20,50,100 for short paths"
    option("--lengths", metavar="L,L,…", help=text)
    text = "frames between the starts of sub-sequences; default 10, or 1 for short paths"
    option("--step", metavar="N", help=text)
    text = "transformation of the path before the ATE is computed; default %(default)s"
    option("--alignment", default="se3", choices=[each.value for each in Alignment], help=text)
    text = "interval of the RPE, in frames (10f) or in metres along the true path (5m); default 1f"
    option("--delta", default="1f", metavar="D", help=text)
    text = "largest difference between the times of a pose and its true pose, in seconds; default %(default)s"
    option("--t-max-diff", type=float, default=TIME_TOLERANCE_S, metavar="S", help=text)
    text = "folder for evaluation.json and for figures of paths and of errors by length and speed"
    option("--out", metavar="DIR", help=text)
    option("--json", action="store_true", help="print the results as JSON")
    parser.set_defaults(command=_evaluate)


def _is_evaluation(path: Path) -> bool:
    """Whether a file is the evaluation.json of an earlier call."""
    with suppress(DataError):
        return isinstance(read_mapping(path, "an evaluation").get("sequences"), list)
    return False


def _evaluate(options: argparse.Namespace) -> int:
    lengths = None if options.lengths is None else parse_lengths(options.lengths)
    step = None if options.step is None else parse_whole("--step", options.step)
    if options.out is not None:
        require_drawing()
    if not options.t_max_diff >= 0:
        raise DataError(f"--t-max-diff {options.t_max_diff:g}: expected 0 s or more")
    alignment = Alignment(options.alignment)
    delta = parse_delta(options.delta)
    for folder in options.paths:
        if changed := {POSES, POSES_TUM}.intersection(changed_files(folder)):
            warn(
                f"{changed_words(sorted(changed))} in {folder} since the run: the errors are not of this run"
            )
    results = []
    for paths in read_paths(options.paths, options.truth, options.t_max_diff):
        usual = suitable_protocol(paths.truth, paths.frames)
        measure = SubsequenceProtocol(lengths or usual.lengths, step or usual.step)
        errors = evaluate(
            paths.truth,
            paths.estimates,
            measure,
            paths.times,
            alignment,
            delta,
            frames=paths.frames,
            is_part=paths.is_part,
        )
        results.append((paths, errors))
    numbers = [
        {"sequence": paths.name, "notes": list(paths.notes)} | result.to_dict("systems")
        for paths, result in results
    ]
    data = json.dumps({"sequences": numbers}, indent=2, allow_nan=False)
    missing = list[str]()
    if options.out is not None:
        with run_folder(options.out) as folder:
            own = _is_evaluation(folder / EVALUATION)
            with written_together(folder, own=own) as draft:
                write_atomic(draft / EVALUATION, data + "\n")
                for paths, result in results:
                    missing += write_pictures(draft, paths, result)
    if options.json:
        print(data)
        return 0
    for paths, result in results:
        for table in evaluation_tables(paths.name, result):
            show_report_table(table)
        print_wrapped(*paths.notes)
    if options.out is not None:
        print_wrapped(*missing)
        print_lines(f"written to {options.out}")
    return 0
