"""Errors and pictures of trajectories: runs of the kit and pose files of other systems."""

from __future__ import annotations

import functools
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..data.catalogue import open_sequence
from ..data.poses import TIME_TOLERANCE_S, match_times, read_path
from ..errors import DataError
from ..evaluation.ate_rpe import align, rmse
from ..evaluation.kitti_errors import SHORT_PROTOCOL
from ..evaluation.path_errors import Evaluation
from ..files import write_atomic
from ..geometry.types import Array, Index
from ..runs.folder import CONFIG, POSES, POSES_TUM, is_finished, read_config
from .page import ReportTable, format_number, without_empty_columns
from .plots import error_curves_figure, png, trajectories_figure
from .table1 import ERROR_KINDS, slug

COMMON_STEMS = ("poses", "poses_tum", "data")  # file names in many folders, useless as labels
# Smallest number of points of a curve: the devkit's speed bins overlap, so one speed falls into two or three.
MIN_CURVE_POINTS = {"length": 2, "speed": 4}
NEAREST_RUNS = 3  # number of run folders that a message names
GIVE_TRUTH = "give its ground truth with --truth FILE"


@dataclass(frozen=True, eq=False)
class ComparedPaths:
    """The true path (N, 4, 4) of a sequence, and estimates (N, 4, 4) of this path by label.

    `times` : (N,) seconds, or None if unknown. `matched` : a sentence if some true poses have no estimate.
    """

    name: str
    truth: Array
    times: Array | None
    estimates: dict[str, Array]
    matched: str = ""


def read_paths(
    sources: list[Path], truth_file: Path | None = None, tolerance: float = TIME_TOLERANCE_S
) -> list[ComparedPaths]:
    """Paths from run folders and pose files, grouped by ground truth (a truth file, or the sequences' truth).

    Poses correspond to true poses by time, within `tolerance` seconds, or row by row if one file has no
    times. Only frames that occur in all paths are compared. Raises `DataError` if the truth of a path is
    unknown or does not correspond to the path.
    """
    for source in sources:
        if not source.is_dir():
            read_path(source)  # a missing or invalid file is refused before the search for its truth
        elif not is_finished(source):
            raise _without_run(source)
    sources = list(dict.fromkeys(source.absolute() for source in sources))
    configs = {source: read_config(source) for source in sources if source.is_dir()}
    if truth_file is None:
        truths = {source: _truth_of_run(source, config) for source, config in configs.items()}
    else:
        times, poses = read_path(truth_file)
        file_truth = ComparedPaths(_names(truth_file.absolute(), None)[0], poses, times, {})
        truths = dict.fromkeys(sources, file_truth)
    by_name: dict[str, ComparedPaths] = {}
    for truth in truths.values():
        if not np.array_equal(truth.truth, by_name.setdefault(truth.name, truth).truth):
            raise DataError(f"two sequences have the name {truth.name}: evaluate them separately")
    for source in sources:
        if source not in truths and len(by_name) != 1:
            raise DataError(f"is a pose file without ground truth: {GIVE_TRUTH}", source)
    compared = []
    for name, truth in by_name.items():
        members = [source for source in sources if truths.get(source, truth).name == name]
        # A truth file with times needs paths with times.
        run_file = POSES if truth_file is None or truth.times is None else POSES_TUM
        files = [source / run_file if source in configs else source for source in members]
        labels = [_names(source, configs.get(source)) for source in members]
        compared.append(_compared(truth, files, labels, tolerance))
    return compared


def _without_run(folder: Path) -> DataError:
    """The error for a folder that is not a run, with the nearest runs inside as words of a shell."""
    runs = [path.parent for path in folder.rglob(CONFIG) if (path.parent / POSES).exists()]
    runs.sort(key=lambda run: (len(run.parts), run))
    if not runs:
        return DataError("contains no finished run: expected the folder of a run, or a pose file", folder)
    nearest, more = shlex.join(map(str, runs[:NEAREST_RUNS])), len(runs) - NEAREST_RUNS
    others = f" and {more} more" * (more > 0)
    return DataError(f"is not the folder of a run, but contains runs: {nearest}{others}", folder)


def _truth_of_run(folder: Path, config: dict[str, Any]) -> ComparedPaths:
    """The truth of a run's frames, from the folder of its sequence."""
    location, (first, last) = str(config.get("folder")), config.get("frames", ("", ""))
    if not Path(location).is_dir():
        raise DataError(f"the sequence of this run is no longer at {location}: {GIVE_TRUTH}", folder)
    sequence = open_sequence(location)
    if first not in sequence.frames or last not in sequence.frames or sequence.truth is None:
        raise DataError(f"{location} has no truth for the frames of this run: {GIVE_TRUTH}", folder)
    name = str(config.get("sequence", sequence.name))
    if (first, last) != (sequence.frames[0], sequence.frames[-1]):
        name += f", frames {int(first)}-{int(last)}"
        sequence = sequence.part(sequence.frames.index(first), sequence.frames.index(last) + 1)
    assert sequence.truth is not None
    return ComparedPaths(name, sequence.truth, sequence.times, {})


def _names(source: Path, config: dict[str, Any] | None) -> list[str]:
    """Possible labels of a run or a pose file, the shortest first."""
    if config is None:
        return [*[source.stem][source.stem in COMMON_STEMS :], *source.parent.parts[:0:-1], str(source)]
    method, variant, seed = str(config.get("method")), config.get("variant"), config["settings"].get("seed")
    label = method if variant == "published" else f"{method}, {variant}"
    return [label, f"{method}, {variant}, seed {seed}", str(source)]


def _compared(
    truth: ComparedPaths, files: list[Path], names: list[list[str]], tolerance: float
) -> ComparedPaths:
    """The paths at their common frames, with the shortest distinct labels."""
    matched = [_matched(file, truth, tolerance) for file in files]
    common = functools.reduce(np.intersect1d, [rows for rows, _ in matched])
    if len(common) < 2:
        condition = f"at the times of the other paths of {truth.name}, within --t-max-diff {tolerance:g} s"
        raise DataError(f"has fewer than two poses {condition}", files[-1])
    estimates = {}
    for labels, (rows, poses) in zip(names, matched, strict=True):
        others = {name for other in names if other is not labels for name in other}
        label = next(name for name in labels if name not in others)
        estimates[label] = poses[np.searchsorted(rows, common)]
    times = None if truth.times is None else truth.times[common]
    few = f"Matched {len(common)} of {len(truth.truth)} true poses." * (len(common) < len(truth.truth))
    return ComparedPaths(truth.name, truth.truth[common], times, estimates, few)


def _matched(path: Path, truth: ComparedPaths, tolerance: float) -> tuple[Index, Array]:
    """Rows of the truth with a corresponding pose in a file, and these poses."""
    times, poses = read_path(path)
    if times is not None and truth.times is not None:
        rows, pose_rows = match_times(truth.times, times, tolerance)
        return rows, poses[pose_rows]
    if len(poses) != len(truth.truth):
        counts = f"has {len(poses)} poses, but the truth of {truth.name} has {len(truth.truth)}"
        raise DataError(f"{counts}: without times, row k of both files is frame k; cut the longer file", path)
    return np.arange(len(poses)), poses


def evaluation_tables(name: str, result: Evaluation) -> list[ReportTable]:
    """A table of the systems' errors on a sequence, and a table of TE and RE by length."""
    measure, systems, rows = result.measure, result.paths, []
    for s in systems:
        drift = map(rmse, (s.ate.distance, s.rpe.translation, np.degrees(s.rpe.rotation)))
        rows.append(
            [
                s.name,
                format_number(s.kitti.te),
                format_number(s.kitti.re),
                *(format_number(value, 4) for value in drift),
            ]
        )
    columns = ["system", *(unit for unit, _ in ERROR_KINDS.values()), "ATE m", "RPE m", "RPE deg"]
    first, head, title = systems[0], list[str](), name
    path = f"the path, {first.distance:.1f} m in {first.frames} frames, is shorter"
    notes = [f"ATE {first.ate.alignment.words}: root mean square."]
    has_rpe, interval = len(first.rpe.rotation) > 0, first.rpe.delta.words
    notes.append(f"RPE {interval}: root mean square." if has_rpe else f"No RPE {interval}: {path}.")
    if len(first.kitti):
        title += f": sub-sequences of {measure.words}"
        short = "Short path, so sub-sequences are shorter than KITTI's: not comparable with the benchmark."
        head += [short] if measure == SHORT_PROTOCOL else []
    else:
        notes.append(f"No TE and RE: {path} than the shortest sub-sequence, {min(measure.lengths):g} m.")
    by_length = []
    for length in measure.lengths:
        parts = [s.kitti[s.kitti.length == length] for s in systems]
        if len(parts[0]):
            by_length.append(
                [f"{length:g} m", *(f"{format_number(part.te)} / {format_number(part.re)}" for part in parts)]
            )
    errors = ReportTable(title, columns, rows, notes, head)
    tables = [without_empty_columns(errors)]
    if by_length:
        names = [s.name for s in systems]
        tables.append(ReportTable("TE % / RE deg/100 m by length", ["length", *names], by_length, []))
    return tables


def write_pictures(folder: Path, paths: ComparedPaths, result: Evaluation) -> list[str]:
    """Write figures of the paths and the truth, aligned as for the ATE, and figures of error curves.

    Returns a sentence if there are too few points for a figure of curves.
    """
    file, alignment = slug(paths.name), result.paths[0].ate.alignment
    # The axes of the first camera, in which the path can be seen from above.
    to_start = np.linalg.inv(paths.truth[0])
    aligned = {name: to_start @ align(paths.truth, T, alignment)[0] for name, T in paths.estimates.items()}
    figure = trajectories_figure({f"{paths.name}\n{alignment.words}": (paths.truth, aligned)})
    write_atomic(folder / f"trajectory_{file}.png", png(figure))
    missing = []
    for by, least in MIN_CURVE_POINTS.items():
        curves = {s.name: s.kitti.curve(by, result.measure.lengths) for s in result.paths}
        if max(map(len, curves.values())) < least:
            missing.append(by)
            continue
        write_atomic(folder / f"errors_{file}_by_{by}.png", png(error_curves_figure(paths.name, by, curves)))
    names = " and ".join(missing)
    reason = f"{paths.name}: no figure of errors by {names}, since too few sub-sequences differ in {names}."
    return [reason] if missing else []
