"""`vo evaluate`: errors of runs and of trajectory files, or, without truth, how they differ."""

from __future__ import annotations

import argparse
import json
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..data.poses import TIME_TOLERANCE_S
from ..errors import DataError
from ..evaluation.ate_rpe import Alignment, Delta
from ..evaluation.kitti_errors import SubsequenceProtocol, suitable_protocol
from ..evaluation.path_errors import Evaluation, evaluate
from ..evaluation.path_facts import path_facts
from ..files import read_mapping, write_atomic, written_together
from ..report.page import ReportTable
from ..report.path_tables import (
    evaluation_tables,
    facts_without_truth,
    spread_table,
    tables_without_truth,
    write_picture_without_truth,
    write_pictures,
)
from ..report.paths import GIVE_TRUTH, LEAST_MATCHED_SHARE, ComparedPaths, PathsWithoutTruth, read_paths
from ..report.table1_plan import refuse_equal_names
from ..runs.folder import POSES, POSES_TUM, changed_files, run_folder
from .common import changed_words, parse_delta, parse_lengths, parse_whole, require_drawing
from .console import print_wrapped, show_report_table, warn

EVALUATION = "evaluation.json"
DEFAULT_ALIGNMENT = "se3"
DEFAULT_DELTA = "1f"
WARNING = "warning: "  # how a note begins that makes all numbers doubtful
ERROR_OPTIONS = ("lengths", "step", "alignment", "delta")  # those that only paths with truth need


def add(parser: argparse.ArgumentParser) -> None:
    """Declare `vo evaluate`."""
    parser.epilog = "example: vo evaluate runs/07 orb/07.txt --out figures"
    option = parser.add_argument
    text = (
        "folders of runs, and pose files of other systems: with a line that names the columns (CSV), or in "
        "the format of KITTI, TUM or EuRoC"
    )
    option("paths", nargs="+", type=Path, metavar="RUN_OR_FILE", help=text)
    text = (
        "ground-truth file of all paths; default: the truth of the runs' sequences. Without any truth, the "
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
    text = (
        "largest difference between the times of a pose and its true pose, in seconds; default %(default)s. "
        f"Files are refused if fewer than {100 * LEAST_MATCHED_SHARE:.0f} %% of the poses have such a partner"
    )
    option("--t-max-diff", type=float, default=TIME_TOLERANCE_S, metavar="S", help=text)
    text = "folder for evaluation.json, and for figures of the paths and of their errors by length and speed"
    option("--out", metavar="DIR", help=text)
    option("--json", action="store_true", help="print the results as JSON")
    parser.set_defaults(command=_evaluate)


def _is_evaluation(path: Path) -> bool:
    """Whether a file is the evaluation.json of an earlier call."""
    with suppress(DataError):
        return isinstance(read_mapping(path, "an evaluation").get("sequences"), list)
    return False


@dataclass(frozen=True)
class _WithTruth:
    """Paths with ground truth, and their errors."""

    paths: ComparedPaths
    errors: Evaluation

    def numbers(self) -> dict[str, Any]:
        """The results for JSON."""
        paths = self.paths
        about: dict[str, Any] = {"sequence": paths.name, "notes": list(paths.notes), "ground_truth": True}
        results = about | self.errors.to_dict("systems")
        for system, whole in zip(results["systems"], paths.wholes.values(), strict=True):
            system["path"] = path_facts(whole.poses, whole.times).to_dict()
        return results

    def tables(self) -> list[ReportTable]:
        """The tables to print."""
        first, *others = evaluation_tables(self.paths.name, self.errors)
        return [first, spread_table(self.errors), *others]

    def write_pictures(self, folder: Path) -> list[str]:
        """Write the figures; return sentences on figures that are missing or doubtful."""
        return write_pictures(folder, self.paths, self.errors)


@dataclass(frozen=True)
class _WithoutTruth:
    """Paths without ground truth."""

    paths: PathsWithoutTruth

    def numbers(self) -> dict[str, Any]:
        """The results for JSON."""
        about = {"sequence": self.paths.name, "notes": list(self.paths.notes)}
        return about | facts_without_truth(self.paths)

    def tables(self) -> list[ReportTable]:
        """The tables to print."""
        return tables_without_truth(self.paths)

    def write_pictures(self, folder: Path) -> list[str]:
        """Write the figure of the paths; none is missing."""
        write_picture_without_truth(folder, self.paths)
        return []


_Result = _WithTruth | _WithoutTruth


def _refuse_options_of_errors(options: argparse.Namespace) -> None:
    """Raise `DataError` for options that have no effect on paths without truth."""
    given = [f"--{name}" for name in ERROR_OPTIONS if getattr(options, name) is not None]
    if given:
        raise DataError(f"{' and '.join(given)}: no effect without ground truth: {GIVE_TRUTH}")


@dataclass(frozen=True)
class _ErrorOptions:
    """What the options say on the errors; None for what suits the path."""

    lengths: tuple[float, ...] | None
    step: int | None
    alignment: Alignment
    delta: Delta


def _read_error_options(options: argparse.Namespace) -> _ErrorOptions:
    """What the options say on the errors; `DataError` for an invalid value."""
    return _ErrorOptions(
        lengths=None if options.lengths is None else parse_lengths(options.lengths),
        step=None if options.step is None else parse_whole("--step", options.step),
        alignment=Alignment(options.alignment or DEFAULT_ALIGNMENT),
        delta=parse_delta(options.delta or DEFAULT_DELTA),
    )


def _evaluate(options: argparse.Namespace) -> int:
    """Read the paths; write, and print as tables or as JSON, their errors or how they differ."""
    chosen = _read_error_options(options)
    if options.out is not None:
        require_drawing()
    if not options.t_max_diff >= 0:  # also refuses NaN
        raise DataError(f"--t-max-diff {options.t_max_diff:g}: expected 0 s or more")
    for path in options.paths:
        changed = {POSES, POSES_TUM}.intersection(changed_files(path))  # none for a pose file
        if changed:
            warn(f"{changed_words(sorted(changed))} in {path} since the run: the errors are not of this run")
    results: list[_Result] = []
    for paths in read_paths(options.paths, options.truth, options.t_max_diff):
        if isinstance(paths, PathsWithoutTruth):
            _refuse_options_of_errors(options)
            results.append(_WithoutTruth(paths))
        else:
            results.append(_WithTruth(paths, _errors(paths, chosen)))
    data = json.dumps({"sequences": [result.numbers() for result in results]}, indent=2, allow_nan=False)
    remarks = [] if options.out is None else _write(options.out, data, results)
    if options.json:
        print(data)
        return 0
    _print_results(results)
    if options.out is not None:
        print_wrapped(*remarks)
        print_wrapped(f"written to {options.out}")
    return 0


def _errors(paths: ComparedPaths, chosen: _ErrorOptions) -> Evaluation:
    """The errors of paths with a truth."""
    usual = suitable_protocol(paths.truth, paths.frames)
    return evaluate(
        paths.truth,
        paths.estimates,
        SubsequenceProtocol(chosen.lengths or usual.lengths, chosen.step or usual.step),
        paths.times,
        chosen.alignment,
        chosen.delta,
        frames=paths.frames,
        is_part=paths.is_part,
    )


def _write(out: str, data: str, results: list[_Result]) -> list[str]:
    """Write evaluation.json and the figures; return sentences on figures that are missing or doubtful."""
    refuse_equal_names(result.paths.name for result in results)
    remarks = list[str]()
    with run_folder(out) as folder:
        own = _is_evaluation(folder / EVALUATION)
        with written_together(folder, own=own) as draft:
            write_atomic(draft / EVALUATION, data + "\n")
            for result in results:
                remarks += result.write_pictures(draft)
    return remarks


def _print_results(results: list[_Result]) -> None:
    """Print the tables and notes of all results, and what they do not tell."""
    for result in results:
        # What makes all numbers doubtful stands before them.
        warnings = [note for note in result.paths.notes if note.startswith(WARNING)]
        print_wrapped(*warnings)
        for table in result.tables():
            show_report_table(table)
        print_wrapped(*(note for note in result.paths.notes if note not in warnings))
    if len(results) > 1:
        names = ", ".join(result.paths.name for result in results[:-1])
        print_wrapped(
            f"{names} and {results[-1].paths.name} have a table each and are not compared with each other, "
            "since they are not the same frames of the same sequence."
        )
    if not any(isinstance(result, _WithTruth) for result in results):
        print_wrapped(f"For errors, {GIVE_TRUTH}.")
