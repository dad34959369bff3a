"""`vo evaluate`: errors of runs and of trajectory files, or, without truth, how they differ."""

from __future__ import annotations

import argparse
import json
import os
from contextlib import suppress
from pathlib import Path

from ..errors import DataError
from ..evaluation.ate_rpe import Alignment
from ..evaluation.kitti_errors import SubsequenceProtocol, suitable_protocol
from ..evaluation.path_errors import PathErrors, evaluate
from ..files import read_mapping, write_atomic
from ..geometry.types import Array
from ..report.compare import (
    GIVE_TRUTH,
    Compared,
    error_tables,
    numbers,
    read_compared,
    tables_without_truth,
    write_pictures,
)
from ..runs.folder import POSES, POSES_TUM, changed_files, refuse_foreign, run_folder, written_together
from .common import changed_words, parse_delta, parse_lengths, parse_whole, require_drawing
from .console import print_wrapped, show_report_table, warn

EVALUATION = "evaluation.json"
DEFAULT_ALIGNMENT = "se3"
DEFAULT_DELTA = "1f"
ERROR_OPTIONS = ("lengths", "step", "alignment", "delta")  # those that only paths with truth need


def add(parser: argparse.ArgumentParser) -> None:
    """Declare `vo evaluate`."""
    parser.epilog = "example: vo evaluate runs/07 orb/07.txt --out figures"
    option = parser.add_argument
    text = "folders of runs, and pose files of other systems: KITTI's or TUM's format, or .npy (N, 4, 4)"
    option("paths", nargs="+", type=Path, metavar="RUN_OR_FILE", help=text)
    text = (
        "ground-truth file of all paths; default: the truth of the runs' sequence. Without any truth, the "
        "paths are drawn from the same start, and their lengths and distances are printed"
    )
    option("--truth", type=Path, metavar="FILE", help=text)
    text = "sub-sequence lengths, metres; default 100,…,800, or 20,50,100 for short paths"
    option("--lengths", metavar="L,L,…", help=text)
    text = "number of frames from one start of a sub-sequence to the next; default 10, or 1 for short paths"
    option("--step", metavar="N", help=text)
    text = f"how the path is aligned with the truth before the ATE is computed; default {DEFAULT_ALIGNMENT}"
    option("--alignment", choices=[each.value for each in Alignment], help=text)
    text = (
        f"interval of the RPE, in frames (10f) or in metres along the true path (5m); default {DEFAULT_DELTA}"
    )
    option("--delta", metavar="D", help=text)
    text = "folder for evaluation.json, and for figures of the paths and of their errors by length and speed"
    option("--out", metavar="DIR", help=text)
    option("--json", action="store_true", help="print the results as JSON")
    parser.set_defaults(command=_evaluate)


def _is_evaluation(path: Path) -> bool:
    """Whether a file is the evaluation.json of an earlier call."""
    with suppress(DataError):
        return "ground_truth" in read_mapping(path, "an evaluation")
    return False


def _refuse_options_of_errors(options: argparse.Namespace) -> None:
    """Raise `DataError` for options that have no effect on paths without truth."""
    given = [f"--{name}" for name in ERROR_OPTIONS if getattr(options, name) is not None]
    if given:
        raise DataError(f"{' and '.join(given)}: no effect without ground truth: {GIVE_TRUTH}")


def _errors(compared: Compared, truth: Array, options: argparse.Namespace) -> list[PathErrors]:
    """The errors of paths with a truth (N, 4, 4), over the sub-sequences that suit it or that are typed."""
    usual = suitable_protocol(truth, compared.frames)
    lengths = usual.lengths if options.lengths is None else parse_lengths(options.lengths)
    step = usual.step if options.step is None else parse_whole("--step", options.step)
    return evaluate(
        truth,
        compared.paths,
        SubsequenceProtocol(lengths, step),
        compared.times,
        Alignment(options.alignment or DEFAULT_ALIGNMENT),
        parse_delta(options.delta or DEFAULT_DELTA),
        compared.frames,
    )


def _evaluate(options: argparse.Namespace) -> int:
    """Read the paths; write, and print as tables or as JSON, their errors or how they differ."""
    if options.out is not None:
        require_drawing()
    for path in options.paths:
        changed = {POSES, POSES_TUM}.intersection(changed_files(path))  # none for a pose file
        if changed:
            warn(f"{changed_words(sorted(changed))} in {path} since the run: the errors are not of this run")
    compared = read_compared(options.paths, options.truth)
    errors = list[PathErrors]()
    if compared.truth is None:
        _refuse_options_of_errors(options)
        tables = tables_without_truth(compared)
    else:
        errors = _errors(compared, compared.truth, options)
        whole_truth = not compared.is_part and len(compared.frames) == len(compared.truth)
        tables = error_tables(compared.name, errors, whole_truth)
    data = json.dumps(numbers(compared, errors), indent=2, allow_nan=False)
    if options.out is not None:
        with run_folder(options.out) as folder:
            own = _is_evaluation(folder / EVALUATION)
            with written_together(folder) as draft:
                write_atomic(draft / EVALUATION, data + "\n")
                write_pictures(draft, compared, errors)
                refuse_foreign(folder, sorted(os.listdir(draft)), own)
    if options.json:
        print(data)
        return 0
    for table in tables:
        show_report_table(table)
    print_wrapped(*compared.notes)
    if compared.truth is None:
        print_wrapped(f"For errors, {GIVE_TRUTH}.")
    if options.out is not None:
        print_wrapped(f"written to {options.out}")
    return 0
