"""Paths to compare: runs of the kit and pose files of other systems, with or without ground truth."""

from __future__ import annotations

import functools
import shlex
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..config import preset
from ..data.catalogue import open_sequence
from ..data.pose_times import are_frame_numbers, interval_fault, refuse_intervals, time_mismatch, time_ranges
from ..data.poses import TIME_TOLERANCE_S, TUM_ROW, PoseFile, match_times, read_path
from ..errors import DataError
from ..geometry.types import Array, Index
from ..runs.folder import CONFIG, POSES, POSES_TUM, is_finished, read_config, settings_in
from .blocks import differences, settings_words

COMMON_STEMS = ("poses", "poses_tum", "data")  # file names in many folders, useless as labels
NEAREST_RUNS = 3  # number of run folders that a message names
USUAL_MATCHES = 0.5  # share of the poses of the shorter file that have a partner; fewer are told
GIVE_TRUTH = "give its ground truth with --truth FILE"
UNNAMED = "paths"  # the name of pose files that no run gives a sequence


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


@dataclass(frozen=True, eq=False)
class PathsWithoutTruth:
    """Paths (M, 4, 4) of the same frames by label, of which no truth is known.

    Attributes
    ----------
    name : name of the sequence, or `UNNAMED`.
    times : (M,) seconds, or None if unknown.
    estimates : paths (M, 4, 4) by label.
    notes : sentences on why there is no truth, on how files were read, and on poses that are not compared.
    """

    name: str
    times: Array | None
    estimates: dict[str, Array]
    notes: tuple[str, ...] = ()


class _NoTruth(DataError):
    """The truth of a run is not there; the message says why, without the run and without a remedy."""


def read_paths(
    sources: list[Path], truth_file: Path | None = None, tolerance: float = TIME_TOLERANCE_S
) -> list[ComparedPaths] | list[PathsWithoutTruth]:
    """Paths from run folders and pose files, grouped by ground truth (a truth file, or the sequences' truth).

    Poses correspond to true poses by time, within `tolerance` seconds, or row by row if one file has no
    times. Only frames that occur in all paths are compared. If no path has a truth, the paths are grouped by
    sequence and correspond to each other in the same way.

    Raises `DataError` if only some paths have a truth, or if files do not correspond.
    """
    for source in sources:
        if not source.is_dir():
            read_path(source)  # a missing or invalid file is refused before the search for its truth
        elif not is_finished(source):
            raise _without_run(source)
    sources = list(dict.fromkeys(source.absolute() for source in sources))
    configs = {source: read_config(source) for source in sources if source.is_dir()}
    if truth_file is None:
        truths = dict[Path, ComparedPaths]()
        without = dict[Path, _NoTruth]()
        for source, config in configs.items():
            try:
                truths[source] = _truth_of_run(config)
            except _NoTruth as error:
                without[source] = error
        if not truths:
            return _read_without_truth(sources, configs, without, tolerance)
        for source, reason in without.items():
            raise DataError(f"{reason}: {GIVE_TRUTH}, or evaluate this path alone", source)
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
        each = _compared(truth, files, labels, tolerance, f"the truth of {name}")
        if len(each.frames) < len(truth.truth):
            matched = f"Matched {len(each.frames)} of {len(truth.truth)} true poses."
            each = replace(each, notes=(*each.notes, matched))
        compared.append(each)
    if truth_file is not None and file_truth.times is not None:
        refuse_intervals(file_truth.times, truth_file, as_column=True)
    return compared


def _read_without_truth(
    sources: list[Path], configs: dict[Path, dict[str, Any]], reasons: dict[Path, _NoTruth], tolerance: float
) -> list[PathsWithoutTruth]:
    """Paths without truth, by sequence; pose files belong to the only sequence of the runs, if there is one.

    reasons : why each run has no truth.
    """
    names = {source: _frames_name(config) for source, config in configs.items()}
    runs_are_of = list(dict.fromkeys(names.values()))
    files_are_of = runs_are_of[0] if runs_are_of else UNNAMED
    groups: dict[str, list[Path]] = {}
    for source in sources:
        if source not in configs and len(runs_are_of) > 1:
            raise DataError(
                f"is a pose file, and the runs are of {' and '.join(runs_are_of)}: evaluate each alone",
                source,
            )
        groups.setdefault(names.get(source, files_are_of), []).append(source)
    result = []
    for name, members in groups.items():
        files = [source / POSES_TUM if source in configs else source for source in members]
        labels = [_names(source, configs.get(source)) for source in members]
        reference = next((file for file in files if read_path(file).times is not None), files[0])
        read = read_path(reference)
        # The reference takes the place of the truth only to find the frames of all paths.
        alone = _truth_alone(name, read.poses, read.times)
        each = _compared(alone, files, labels, tolerance, str(reference))
        why = dict.fromkeys(str(reasons[source]) for source in members if source in reasons)
        notes = [f"No ground truth: {reason}." for reason in why]
        notes += each.notes
        if len(each.frames) < len(read.poses):
            notes.append(f"Compared: the {len(each.frames)} poses at times that all paths have.")
        times = None if read.times is None else read.times[each.frames]
        if read.times is not None and are_frame_numbers(read.times):
            notes.append(
                f"{reference}: the times are 0, 1, 2, …: if these are numbers of frames, durations and "
                "speeds are wrong."
            )
        result.append(PathsWithoutTruth(name, times, each.estimates, tuple(notes)))
    return result


def _frames_name(config: dict[str, Any]) -> str:
    """The sequence of a run and its first and last frame."""
    name = str(config.get("sequence"))
    numbers = [frame.lstrip("0") or "0" for frame in config.get("frames", ())]
    return f"{name}, frames {'-'.join(numbers)}" if numbers else name


def _truth_alone(
    name: str, poses: Array, times: Array | None, is_part: bool = False, notes: tuple[str, ...] = ()
) -> ComparedPaths:
    """A true path before any estimate is compared with it."""
    return ComparedPaths(name, poses, times, {}, np.arange(len(poses)), is_part, notes)


def _without_run(folder: Path) -> DataError:
    """The error for a folder that is not a run, with the nearest runs inside as words of a shell."""
    runs = [path.parent for path in folder.rglob(CONFIG) if is_finished(path.parent)]
    runs.sort(key=lambda run: (len(run.parts), run))
    if not runs:
        return DataError("contains no finished run: expected the folder of a run, or a pose file", folder)
    named = shlex.join(map(str, runs[:NEAREST_RUNS]))
    if len(runs) > NEAREST_RUNS:
        named += f" and {len(runs) - NEAREST_RUNS} more"
    return DataError(f"is not the folder of a run, but contains runs: {named}", folder)


def _truth_of_run(config: dict[str, Any]) -> ComparedPaths:
    """The truth of a run's frames, from the folder of its sequence."""
    location = str(config.get("folder"))
    (first, last) = config.get("frames", ("", ""))
    if not Path(location).is_dir():
        raise _NoTruth(f"the sequence of this run is no longer at {location}")
    sequence = open_sequence(location)
    if first not in sequence.frames or last not in sequence.frames or sequence.truth is None:
        raise _NoTruth(f"{location} has no truth for the frames of this run")
    name = str(config.get("sequence", sequence.name))
    if (first, last) != (sequence.frames[0], sequence.frames[-1]):
        name += f", frames {int(first)}-{int(last)}"
        sequence = sequence.part(sequence.frames.index(first), sequence.frames.index(last) + 1)
    if sequence.truth is None:
        raise _NoTruth(f"{location} has no truth")
    sequence.require_unbroken()
    interval = interval_fault(sequence.times)
    notes = (f"{location}: {interval}; speeds are wrong.",) if interval else ()
    return _truth_alone(name, sequence.truth, sequence.times, sequence.is_part, notes)


def _names(source: Path, config: dict[str, Any] | None) -> list[str]:
    """Possible labels of a run or a pose file, the shortest first."""
    if config is None:
        names = list(source.parent.parts[:0:-1])  # the folders, the nearest first, without the root
        if source.stem not in COMMON_STEMS:
            names[:0] = [source.stem, source.name]
        return [*names, str(source)]
    method = str(config.get("method"))
    variant = config.get("variant")
    seed = config["settings"].get("seed")
    label = method if variant == "published" else f"{method}, {variant}"
    names = [label]
    whole = f"{method}, {variant}"
    with suppress(DataError):  # a method or settings of another version
        changes = differences(settings_in(config, source), preset(method, variant=str(variant)))
        if changes:
            names.append(f"{label}, {settings_words(changes)}")
            whole += f", {settings_words(changes)}"
    return [*names, f"{whole}, seed {seed}", str(source)]


def _compared(
    truth: ComparedPaths, files: list[Path], names: list[list[str]], tolerance: float, what: str
) -> ComparedPaths:
    """The paths at their common frames, with the shortest distinct labels; `what` names the truth."""
    matched = [_matched(file, truth, tolerance, what) for file in files]
    common = functools.reduce(np.intersect1d, [each.rows for each in matched])
    if len(common) < 2:
        condition = f"at the times of the other paths and of {what}, within --t-max-diff {tolerance:g} s"
        raise DataError(f"has fewer than two poses {condition}", files[-1])
    estimates = {}
    for labels, each in zip(names, matched, strict=True):
        others = {name for other in names if other is not labels for name in other}
        label = next(name for name in labels if name not in others)
        estimates[label] = each.poses[np.searchsorted(each.rows, common)]
    notes = list(truth.notes)
    for each in matched:
        notes += each.notes
    return replace(truth, estimates=estimates, frames=common, notes=tuple(notes))


class _MatchedFile(NamedTuple):
    """Rows (M,) of the truth with a corresponding pose in a file, these poses (M, 4, 4), and notes."""

    rows: Index
    poses: Array
    notes: list[str]


def _matched(path: Path, truth: ComparedPaths, tolerance: float, what: str) -> _MatchedFile:
    """The poses of a file that belong to true poses: those of equal times or, without times, all.

    `what` : the truth in words.
    """
    file = read_path(path)
    if len(file.poses) < 2:
        raise DataError("has one pose: a path needs two or more", path)
    notes = list(file.notes)
    if file.times is None or truth.times is None:
        if file.times is not None:
            refuse_intervals(file.times, path, as_column=True)
        _require_same_frames(file, truth, path, what)
        return _MatchedFile(np.arange(len(file.poses)), file.poses, notes)
    rows, pose_rows = match_times(truth.times, file.times, tolerance)
    if len(rows) < min(2, len(truth.truth)):
        raise DataError(time_mismatch(file.times, truth.times, truth.name, tolerance), path)
    refuse_intervals(file.times, path, as_column=True)
    if len(rows) < USUAL_MATCHES * min(len(file.poses), len(truth.truth)):
        ranges = time_ranges(file.times, truth.times, truth.name)
        if are_frame_numbers(file.times):
            raise DataError(f"the times are frame numbers, expected seconds: {ranges}", path)
        notes.append(f"{path}: only {len(rows)} of {len(file.poses)} poses have a pose of {what}: {ranges}.")
    return _MatchedFile(rows, file.poses[pose_rows], notes)


def _require_same_frames(file: PoseFile, truth: ComparedPaths, path: Path, what: str) -> None:
    """Raise `DataError` if a file and the truth, one of which has no times, differ in length."""
    if len(file.poses) == len(truth.truth):
        return
    counts = f"has {len(file.poses)} poses, but {what} has {len(truth.truth)}"
    if file.times is not None:
        remedy = f"give {what} with times"
    elif truth.times is not None:
        remedy = "give this file with times"
    else:
        remedy = "give both files with times"
    raise DataError(
        f"{counts}: without times, both need a pose for the same frames. If frames are missing, {remedy}, as "
        f"{TUM_ROW} (TUM)",
        path,
    )
