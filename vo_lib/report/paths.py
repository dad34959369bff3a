"""Errors and pictures of trajectories: runs of the kit and pose files of other systems."""

from __future__ import annotations

import functools
import shlex
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..data.catalogue import open_sequence
from ..data.pose_times import are_frame_numbers, interval_fault, refuse_intervals, time_mismatch, time_ranges
from ..data.poses import TIME_TOLERANCE_S, TUM_ROW, PoseFile, match_times, read_path
from ..errors import DataError
from ..evaluation.ate_rpe import align, rmse
from ..evaluation.kitti_errors import FEW_SUBSEQUENCES, KITTI_PROTOCOL, SHORT_PROTOCOL, count_words
from ..evaluation.path_errors import Evaluation, PathErrors
from ..files import write_atomic
from ..geometry.types import Array, Index
from ..runs.folder import CONFIG, POSES, POSES_TUM, is_finished, read_config
from .page import COUNT_COLUMN, ReportTable, format_number, without_empty_columns
from .plots import error_curves_figure, png, trajectories_figure
from .table1 import ERROR_KINDS, slug

COMMON_STEMS = ("poses", "poses_tum", "data")  # file names in many folders, useless as labels
# Smallest number of points of a curve: the devkit's speed bins overlap, so one speed falls into two or three.
MIN_CURVE_POINTS = {"length": 2, "speed": 4}
NEAREST_RUNS = 3  # number of run folders that a message names
USUAL_MATCHES = 0.5  # share of the poses of the shorter file that have a partner; fewer are told
USUAL_LENGTH_RATIOS = 0.5, 2.0  # of a path and its truth
GIVE_TRUTH = "give its ground truth with --truth FILE"


@dataclass(frozen=True, eq=False)
class ComparedPaths:
    """The true path (N, 4, 4) of a sequence, and estimates (M, 4, 4) of this path by label.

    Attributes
    ----------
    name : name of the sequence or of the truth file. truth : (N, 4, 4).
    times : (N,) seconds of the true poses, or None if unknown.
    estimates : paths (M, 4, 4) by label.
    frames : (M,) numbers of the true poses that have an estimate in every path.
    is_part : whether the truth is only a part of that of a sequence.
    notes : sentences on how files were read, and on poses that are not compared.
    """

    name: str
    truth: Array
    times: Array | None
    estimates: dict[str, Array]
    frames: Index
    is_part: bool = False
    notes: tuple[str, ...] = ()

    @property
    def compared_truth(self) -> Array:
        """The true poses (M, 4, 4) that have an estimate in every path."""
        return self.truth[self.frames]


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
        file = read_path(truth_file)
        name = _names(truth_file.absolute(), None)[0]
        file_truth = _truth_alone(name, file.poses, file.times, notes=file.notes)
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
    if truth_file is not None and file_truth.times is not None:
        refuse_intervals(file_truth.times, truth_file, as_column=True)
    return compared


def _truth_alone(
    name: str, poses: Array, times: Array | None, is_part: bool = False, notes: tuple[str, ...] = ()
) -> ComparedPaths:
    """A true path before any estimate is compared with it."""
    return ComparedPaths(name, poses, times, {}, np.arange(len(poses)), is_part, notes)


def _without_run(folder: Path) -> DataError:
    """The error for a folder that is not a run, with the nearest runs inside as words of a shell."""
    runs = [path.parent for path in folder.rglob(CONFIG) if (path.parent / POSES).exists()]
    runs.sort(key=lambda run: (len(run.parts), run))
    if not runs:
        return DataError("contains no finished run: expected the folder of a run, or a pose file", folder)
    named = shlex.join(map(str, runs[:NEAREST_RUNS]))
    if len(runs) > NEAREST_RUNS:
        named += f" and {len(runs) - NEAREST_RUNS} more"
    return DataError(f"is not the folder of a run, but contains runs: {named}", folder)


def _truth_of_run(folder: Path, config: dict[str, Any]) -> ComparedPaths:
    """The truth of a run's frames, from the folder of its sequence."""
    location = str(config.get("folder"))
    (first, last) = config.get("frames", ("", ""))
    if not Path(location).is_dir():
        raise DataError(f"the sequence of this run is no longer at {location}: {GIVE_TRUTH}", folder)
    sequence = open_sequence(location)
    if first not in sequence.frames or last not in sequence.frames or sequence.truth is None:
        raise DataError(f"{location} has no truth for the frames of this run: {GIVE_TRUTH}", folder)
    name = str(config.get("sequence", sequence.name))
    if (first, last) != (sequence.frames[0], sequence.frames[-1]):
        name += f", frames {int(first)}-{int(last)}"
        sequence = sequence.part(sequence.frames.index(first), sequence.frames.index(last) + 1)
    if sequence.truth is None:
        raise DataError(f"{location} has no truth: {GIVE_TRUTH}", folder)
    interval = interval_fault(sequence.times)
    notes = (f"{location}: {interval}; speeds are wrong.",) if interval else ()
    return _truth_alone(name, sequence.truth, sequence.times, sequence.is_part, notes)


def _names(source: Path, config: dict[str, Any] | None) -> list[str]:
    """Possible labels of a run or a pose file, the shortest first."""
    if config is None:
        names = list(source.parent.parts[:0:-1])  # the folders, the nearest first, without the root
        if source.stem not in COMMON_STEMS:
            names.insert(0, source.stem)
        return [*names, str(source)]
    method = str(config.get("method"))
    variant = config.get("variant")
    seed = config["settings"].get("seed")
    label = method if variant == "published" else f"{method}, {variant}"
    return [label, f"{method}, {variant}, seed {seed}", str(source)]


def _compared(
    truth: ComparedPaths, files: list[Path], names: list[list[str]], tolerance: float
) -> ComparedPaths:
    """The paths at their common frames, with the shortest distinct labels."""
    matched = [_matched(file, truth, tolerance) for file in files]
    common = functools.reduce(np.intersect1d, [each.rows for each in matched])
    if len(common) < 2:
        condition = f"at the times of the other paths of {truth.name}, within --t-max-diff {tolerance:g} s"
        raise DataError(f"has fewer than two poses {condition}", files[-1])
    estimates = {}
    for labels, each in zip(names, matched, strict=True):
        others = {name for other in names if other is not labels for name in other}
        label = next(name for name in labels if name not in others)
        estimates[label] = each.poses[np.searchsorted(each.rows, common)]
    notes = list(truth.notes)
    for each in matched:
        notes += each.notes
    if len(common) < len(truth.truth):
        notes.append(f"Matched {len(common)} of {len(truth.truth)} true poses.")
    return replace(truth, estimates=estimates, frames=common, notes=tuple(notes))


class _MatchedFile(NamedTuple):
    """Rows (M,) of the truth with a corresponding pose in a file, these poses (M, 4, 4), and notes."""

    rows: Index
    poses: Array
    notes: list[str]


def _matched(path: Path, truth: ComparedPaths, tolerance: float) -> _MatchedFile:
    """The poses of a file that belong to true poses: those of equal times or, without times, all."""
    file = read_path(path)
    notes = list(file.notes)
    if file.times is None or truth.times is None:
        if file.times is not None:
            refuse_intervals(file.times, path, as_column=True)
        _require_same_frames(file, truth, path)
        return _MatchedFile(np.arange(len(file.poses)), file.poses, notes)
    rows, pose_rows = match_times(truth.times, file.times, tolerance)
    if len(rows) < min(2, len(truth.truth)):
        raise DataError(time_mismatch(file.times, truth.times, truth.name, tolerance), path)
    refuse_intervals(file.times, path, as_column=True)
    if len(rows) < USUAL_MATCHES * min(len(file.poses), len(truth.truth)):
        ranges = time_ranges(file.times, truth.times, truth.name)
        if are_frame_numbers(file.times):
            raise DataError(f"the times are frame numbers, expected seconds: {ranges}", path)
        notes.append(f"{path}: only {len(rows)} of {len(file.poses)} poses have a true pose: {ranges}.")
    return _MatchedFile(rows, file.poses[pose_rows], notes)


def _require_same_frames(file: PoseFile, truth: ComparedPaths, path: Path) -> None:
    """Raise `DataError` if a file and the truth, one of which has no times, differ in length."""
    if len(file.poses) == len(truth.truth):
        return
    counts = f"has {len(file.poses)} poses, but the truth of {truth.name} has {len(truth.truth)}"
    if file.times is not None:
        remedy = "give the truth with times"
    elif truth.times is not None:
        remedy = "give this file with times"
    else:
        remedy = "give both files with times"
    raise DataError(
        f"{counts}: without times, both need a pose for the same frames. If frames are missing, {remedy}, as "
        f"{TUM_ROW} (TUM)",
        path,
    )


def evaluation_tables(name: str, result: Evaluation) -> list[ReportTable]:
    """A table of the systems' errors on a sequence, and a table of TE and RE by length."""
    tables = [_table_of_systems(name, result)]
    by_length = _table_by_length(result)
    if by_length.rows:
        tables.append(by_length)
    return tables


def _table_of_systems(name: str, result: Evaluation) -> ReportTable:
    """TE, RE, ATE and RPE of each system, with warnings above and the kinds of errors below."""
    measure = result.measure
    rows = []
    for system in result.paths:
        rows.append(
            [
                system.name,
                format_number(system.kitti.te),
                format_number(system.kitti.re),
                format_number(rmse(system.ate.distance), 4),
                format_number(rmse(system.rpe.translation), 4),
                format_number(rmse(np.degrees(system.rpe.rotation)), 4),
            ]
        )
    first = result.paths[0]
    shorter = f"the path, {first.distance:.1f} m in {first.frames} frames, is shorter"
    title = name
    head = list[str]()
    notes = [f"ATE {first.ate.alignment.words}: root mean square.", _rpe_note(result, shorter)]
    if result.subsequences:
        title += f": {count_words(result.subsequences)} of {measure.words_with(result.as_kitti)}"
        head += _caveats(result)
    else:
        notes.append(f"No TE and RE: {shorter} than the shortest sub-sequence, {min(measure.lengths):g} m.")
    if result.frame_step > 1:
        notes.append(
            f"The compared poses are {result.frame_step} frames of the truth apart; intervals and starts in "
            "frames are frames of the truth."
        )
    for system in result.paths:
        head += _doubts(system)
    units = [unit for unit, _ in ERROR_KINDS.values()]
    columns = ["system", *units, "ATE m", "RPE m", "RPE deg"]
    return without_empty_columns(ReportTable(title, columns, rows, notes, head))


def _table_by_length(result: Evaluation) -> ReportTable:
    """TE and RE of each system, with a row for each length that has sub-sequences."""
    rows = []
    for length in result.measure.lengths:
        parts = [system.kitti[system.kitti.length == length] for system in result.paths]
        count = len(parts[0])
        if count:
            cells = [f"{format_number(part.te)} / {format_number(part.re)}" for part in parts]
            rows.append([f"{length:g} m", str(count), *cells])
    names = [system.name for system in result.paths]
    return ReportTable("TE % / RE deg/100 m by length", ["length", COUNT_COLUMN, *names], rows, [])


def _caveats(result: Evaluation) -> list[str]:
    """Sentences above a table of errors that are not those of KITTI's benchmark."""
    head = list[str]()
    if result.measure == SHORT_PROTOCOL:
        head.append(
            "Short path, so sub-sequences are shorter than KITTI's: not comparable with the benchmark."
        )
    elif result.measure != KITTI_PROTOCOL:
        head.append("Other sub-sequences than KITTI's: not comparable with the benchmark.")
    elif not result.whole_truth:
        head.append("Part of the truth, not comparable with whole sequences of the benchmark.")
    if result.subsequences < FEW_SUBSEQUENCES:
        head.append(
            f"Fewer than {FEW_SUBSEQUENCES} sub-sequences: a single place of the path may decide TE and RE."
        )
    return head


def _rpe_note(result: Evaluation, shorter: str) -> str:
    """The interval of the RPE, or why there is none; `shorter` : words that the path is too short."""
    first = result.paths[0]
    interval = first.rpe.delta.words
    if len(first.rpe.rotation):
        return f"RPE {interval}: root mean square."
    step = result.frame_step
    if first.rpe.delta.unit == "frames" and step > first.rpe.delta.size:
        return f"No RPE {interval}: the compared poses are {step} frames apart; use --delta {step}f."
    return f"No RPE {interval}: {shorter}."


def _doubts(system: PathErrors) -> list[str]:
    """Warnings about a path that is probably not in the frames, the units or the axes of the truth."""
    doubts = list[str]()
    name = system.name
    shortest, longest = USUAL_LENGTH_RATIOS
    if system.length_ratio is not None and not shortest <= system.length_ratio <= longest:
        doubts.append(
            f"warning: the path of {name} is {system.length_ratio:.3g} times as long as the truth: other "
            "frames, another unit, or a path without scale (--alignment sim3)."
        )
    if system.other_quaternions:
        doubts.append(
            f"warning: orientations of {name} and of the truth agree only with the quaternions of one "
            "file in another order (qw first, or last), so TE, RE and RPE are meaningless: name the columns "
            "in the first line of that file in their true order."
        )
    elif system.other_orientations:
        doubts.append(
            f"warning: positions of {name} and of the truth agree, but orientations do not, so TE, RE and "
            "RPE are meaningless: one file may have qw first, or axes of another sensor (IMU, not camera)."
        )
    return doubts


def write_pictures(folder: Path, paths: ComparedPaths, result: Evaluation) -> list[str]:
    """Write figures of the paths and the truth, aligned as for the ATE, and figures of error curves.

    Returns a sentence if there are too few points for a figure of curves.
    """
    file = slug(paths.name)
    alignment = result.paths[0].ate.alignment
    # The axes of the first camera, in which the path can be seen from above.
    truth = paths.compared_truth
    to_start = np.linalg.inv(truth[0])
    aligned = {name: to_start @ align(truth, T, alignment)[0] for name, T in paths.estimates.items()}
    figure = trajectories_figure({f"{paths.name}\n{alignment.words}": (truth, aligned)})
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
