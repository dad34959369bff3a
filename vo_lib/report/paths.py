"""Paths to compare: runs of the kit and pose files of other systems, with or without ground truth."""

from __future__ import annotations

import functools
import shlex
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..config import preset
from ..data.catalogue import open_sequence
from ..data.pose_times import (
    are_frame_numbers,
    clock_shift,
    interval_fault,
    refuse_intervals,
    time_mismatch,
    time_ranges,
)
from ..data.poses import TIME_TOLERANCE_S, TUM_ROW, PoseFile, match_times, read_path
from ..errors import DataError
from ..evaluation.ate_rpe import Alignment, align, rmse
from ..evaluation.clocks import slow_turn_agreement, turn_agreement
from ..evaluation.path_facts import MAX_SPEED, leaps, probably_inverted, usual_speed
from ..geometry.types import Array, Index
from ..runs.folder import CONFIG, POSES, POSES_TUM, is_finished, read_config, settings_in
from .blocks import differences, settings_words

COMMON_STEMS = ("poses", "poses_tum", "data")  # file names in many folders, useless as labels
NEAREST_RUNS = 3  # number of run folders that a message names
# Shares of the poses of the shorter of two files that have a pose of equal time in the other. Between two
# cameras of 10 frames a second that know nothing of each other, it is a fifth by chance: their frames are
# 0.1 s apart, and a time counts as equal if it is up to 0.01 s earlier or later. So less than a quarter tells
# nothing and is refused, and less than a half causes a warning.
LEAST_MATCHED_SHARE = 0.25
USUAL_MATCHED_SHARE = 0.5
# A file that begins and ends later than the truth may have another clock (`_clock_doubt`). Positions of equal
# time would then differ by the way that is driven meanwhile. Paths that differ by less than this share of
# that way have one clock.
AGREEING_SHARE = 0.25
# The end of a sentence on times that differ.
OTHER_CLOCK = "so its clock may differ by this, and then every pose is compared with that of another frame."
GIVE_TRUTH = "give its ground truth with --truth FILE"
UNNAMED = "paths"  # the name of pose files that no run gives a sequence


@dataclass(frozen=True, eq=False)
class WholePath:
    """All poses of one path, of which a comparison with others may use only a part.

    Attributes
    ----------
    poses : (N, 4, 4) T_w_c, metres.
    times : (N,) seconds: those of its file or, if it has none, of its sequence; None if nobody knows them.
    from_outside : whether it comes from a file of another system, so that its axes are not known.
    """

    poses: Array
    times: Array | None
    from_outside: bool = False


@dataclass(frozen=True, eq=False)
class ComparedPaths:
    """The true path (N, 4, 4) of a sequence, and estimates (M, 4, 4) of this path by label.

    Attributes
    ----------
    name : name of the sequence or of the truth file.
    truth : (N, 4, 4) T_w_c, metres.
    times : (N,) seconds of the true poses, or None if unknown.
    estimates : paths (M, 4, 4) by label.
    frames : (M,) numbers of the true poses that have an estimate in every path.
    is_part : whether the truth is only a part of that of a sequence.
    notes : sentences on how files were read, and on poses that are not compared.
    wholes : the estimates with all their poses, by label.
    truth_from_outside : whether the truth is a file that was named, so that its axes are not known.
    """

    name: str
    truth: Array
    times: Array | None
    estimates: dict[str, Array]
    frames: Index
    is_part: bool = False
    notes: tuple[str, ...] = ()
    wholes: dict[str, WholePath] = field(default_factory=dict)
    truth_from_outside: bool = False

    @property
    def compared_truth(self) -> Array:
        """The true poses (M, 4, 4) that have an estimate in every path."""
        return self.truth[self.frames]


@dataclass(frozen=True, eq=False)
class PathsWithoutTruth:
    """Paths of which no truth is known, by label: each as it is, and their poses at common frames.

    Attributes
    ----------
    name : name of the sequence, or `UNNAMED`.
    wholes : all poses of each path, for what is said of one path alone.
    common : of each path, the poses (M, 4, 4) of the frames that all paths have, for what compares paths.
    notes : sentences on why there is no truth, on how files were read, and on poses that are not compared.
    """

    name: str
    wholes: dict[str, WholePath]
    common: dict[str, Array]
    notes: tuple[str, ...] = ()

    @property
    def common_count(self) -> int:
        """Number of frames that all paths have."""
        return len(next(iter(self.common.values())))

    @property
    def is_all_common(self) -> bool:
        """Whether every path consists of the compared poses alone."""
        return all(len(path.poses) == self.common_count for path in self.wholes.values())


class _Reference(NamedTuple):
    """What paths are compared with: a truth, or the path in its place.

    name : of the sequence or the file; poses : (N, 4, 4) T_w_c, metres; times : (N,) seconds, or None if
    unknown; is_part, notes : as in `ComparedPaths`.
    """

    name: str
    poses: Array
    times: Array | None
    is_part: bool = False
    notes: tuple[str, ...] = ()


class _NoTruth(DataError):
    """The truth of a run is not there; the message says why, without the run and without a remedy."""


class _Member(NamedTuple):
    """A path to compare: its pose file, possible labels, the preferred first, and whether it is a run's."""

    file: Path
    labels: list[str]
    is_run: bool


class _MatchedFile(NamedTuple):
    """A pose file and the poses in it that correspond to true ones.

    rows : (M,) numbers of these true poses; poses : (M, 4, 4), the corresponding ones; file : all poses;
    notes : sentences on how the file was read, and on how few poses correspond.
    """

    rows: Index
    poses: Array
    file: PoseFile
    notes: list[str]


def read_paths(
    sources: list[Path], truth_file: Path | None = None, tolerance: float = TIME_TOLERANCE_S
) -> list[ComparedPaths] | list[PathsWithoutTruth]:
    """Paths from run folders and pose files, grouped by ground truth (a truth file, or the sequences' truth).

    Poses correspond to true poses by time, within `tolerance` seconds, or row by row if one file has no
    times. Only frames that occur in all paths are compared. If no path has a truth, the paths are grouped by
    sequence and correspond to each other in the same way.

    Raises
    ------
    DataError : a source is no run and no pose file, only some paths have a truth, or files do not correspond.
    """
    for source in sources:
        if not source.is_dir():
            read_path(source)  # a missing or invalid file is refused before the search for its truth
        elif not is_finished(source):
            raise _without_run(source)
    sources = list(dict.fromkeys(source.absolute() for source in sources))
    configs = {source: read_config(source) for source in sources if source.is_dir()}
    if truth_file is not None:
        return [_read_with_truth_file(sources, configs, truth_file, tolerance)]
    truths = dict[Path, _Reference]()
    without_truth = dict[Path, _NoTruth]()
    for source, config in configs.items():
        try:
            truths[source] = _truth_of_run(config)
        except _NoTruth as error:
            without_truth[source] = error
    if not truths:
        return _read_without_truth(sources, configs, without_truth, tolerance)
    if without_truth:
        source, reason = next(iter(without_truth.items()))
        raise DataError(f"{reason}: {GIVE_TRUTH}, or evaluate this path alone", source)
    return _read_with_truth_of_runs(sources, configs, truths, tolerance)


def _read_with_truth_file(
    sources: list[Path], configs: Mapping[Path, dict[str, Any]], truth_file: Path, tolerance: float
) -> ComparedPaths:
    """All paths, compared with the truth in a file; `configs` : those of the runs among the sources."""
    _refuse_several_sequences(configs, truth_file)
    file = read_path(truth_file)
    name = _labels(truth_file.absolute(), None)[0]
    truth = _Reference(name, file.poses, file.times, notes=file.notes)
    run_file = POSES if file.times is None else POSES_TUM  # a truth with times needs paths with times
    members = [_member(source, configs.get(source), run_file) for source in sources]
    compared = _compared_with_truth(truth, members, tolerance, None)
    times_of_files = {truth_file: file.times}
    for member in members:
        times_of_files[member.file] = read_path(member.file).times
    checked_for_leaps = dict(compared.wholes)
    checked_for_leaps[f"the truth {name}"] = WholePath(file.poses, file.times, from_outside=True)
    notes = (*compared.notes, *_frame_number_warning(times_of_files), *leap_warnings(checked_for_leaps))
    if file.times is not None:
        refuse_intervals(file.times, truth_file, as_column=True)
    return replace(compared, notes=notes, truth_from_outside=True)


def _read_with_truth_of_runs(
    sources: list[Path],
    configs: Mapping[Path, dict[str, Any]],
    truths: Mapping[Path, _Reference],
    tolerance: float,
) -> list[ComparedPaths]:
    """The paths by sequence, compared with the truths of the runs; pose files belong to the only sequence."""
    truth_by_name: dict[str, _Reference] = {}
    for truth in truths.values():
        if truth.name not in truth_by_name:
            truth_by_name[truth.name] = truth
        elif not np.array_equal(truth.poses, truth_by_name[truth.name].poses):
            raise DataError(f"two sequences have the name {truth.name}: evaluate them separately")
    for source in sources:
        if source not in truths and len(truth_by_name) != 1:
            raise DataError(
                f"is a pose file, and the runs are of {' and '.join(truth_by_name)}: evaluate it with the "
                "runs of its sequence only",
                source,
            )
    result = []
    for name, truth in truth_by_name.items():
        sources_of_name = [source for source in sources if truths.get(source, truth).name == name]
        members = [_member(source, configs.get(source), POSES) for source in sources_of_name]
        compared = _compared_with_truth(truth, members, tolerance, truth.times)
        result.append(replace(compared, notes=(*compared.notes, *leap_warnings(compared.wholes))))
    return result


def _compared_with_truth(
    truth: _Reference, members: list[_Member], tolerance: float, frame_times: Array | None
) -> ComparedPaths:
    """The result of `_compared`, with a note if the common frames are not all frames of the truth."""
    compared = _compared(truth, members, tolerance, f"the truth of {truth.name}", frame_times)
    if len(compared.frames) == len(truth.poses):
        return compared
    note = f"Matched {len(compared.frames)} of {len(truth.poses)} true poses."
    return replace(compared, notes=(*compared.notes, note))


def _refuse_several_sequences(configs: Mapping[Path, dict[str, Any]], truth_file: Path) -> None:
    """Raise `DataError` if runs, with these `configs`, are of several sequences, since a truth is of one.

    A sequence may have been moved, or opened by name and by folder.
    """
    names = list(dict.fromkeys(str(config.get("sequence")) for config in configs.values()))
    folders = {str(config.get("folder")) for config in configs.values()}
    if len(names) > 1 and len(folders) > 1:
        raise DataError(
            f"is the truth of one sequence, and the runs are of {' and '.join(names)}: evaluate "
            "each sequence alone",
            truth_file,
        )


def _read_without_truth(
    sources: list[Path], configs: dict[Path, dict[str, Any]], reasons: dict[Path, _NoTruth], tolerance: float
) -> list[PathsWithoutTruth]:
    """Paths without truth, by sequence; pose files belong to the only sequence of the runs, if there is one.

    reasons : why each run has no truth.
    """
    name_of_run = {source: _frames_name(config) for source, config in configs.items()}
    names = list(dict.fromkeys(name_of_run.values()))
    name_of_files = names[0] if names else UNNAMED
    groups: dict[str, list[Path]] = {}
    for source in sources:
        if source not in configs and len(names) > 1:
            raise DataError(
                f"is a pose file, and the runs are of {' and '.join(names)}: evaluate each alone",
                source,
            )
        groups.setdefault(name_of_run.get(source, name_of_files), []).append(source)
    result = []
    for name, group in groups.items():
        runs = [configs[source] for source in group if source in configs]
        # "images" is a digest of the run's images, so runs of one name with other images are of other
        # sequences.
        if any(config["images"] != runs[0]["images"] for config in runs):
            raise DataError(f"two sequences have the name {name}: evaluate them separately")
        members = [_member(source, configs.get(source), POSES_TUM) for source in group]
        reasons_of_group = dict.fromkeys(str(reasons[source]) for source in group if source in reasons)
        result.append(_group_without_truth(name, members, tuple(reasons_of_group), tolerance))
    return result


def _group_without_truth(
    name: str, members: list[_Member], reasons: tuple[str, ...], tolerance: float
) -> PathsWithoutTruth:
    """Paths without truth of the same frames; `name` : of their sequence, `reasons` : why it has no truth."""
    files = {member.file: read_path(member.file) for member in members}
    reference = _reference_of(members, files)
    reference_file = files[reference.file]
    reference_name = name if reference.is_run else reference.file.name
    in_place_of_truth = _Reference(reference_name, reference_file.poses, reference_file.times)
    frame_times = reference_file.times if reference.is_run else None
    compared = _compared(in_place_of_truth, members, tolerance, str(reference.file), frame_times)
    notes = [f"No ground truth: {reason}." for reason in reasons]
    notes += compared.notes
    for path, file in files.items():
        if file.times is None and reference_file.times is not None:
            words = f"{path}: has no times, so row k is compared with row k of {reference.file}"
            if frame_times is not None:
                words += f", and gets the times of {name}"
            notes.append(f"{words}.")
    notes += _frame_number_warning({path: file.times for path, file in files.items()})
    paths = PathsWithoutTruth(name, compared.wholes, compared.estimates, tuple(notes))
    if paths.is_all_common:
        return paths
    notes.append(f"Compared: the {paths.common_count} poses at times that all paths have.")
    return replace(paths, notes=tuple(notes))


def _reference_of(members: list[_Member], files: Mapping[Path, PoseFile]) -> _Member:
    """The path that takes the place of a truth, but only to find the frames that all paths have.

    It is the first run with times, since a run has a pose for every frame; else the first file with times.
    """
    timed = [member for member in members if files[member.file].times is not None]
    timed_runs = [member for member in timed if member.is_run]
    if timed_runs:
        return timed_runs[0]
    return timed[0] if timed else members[0]


def _frame_number_warning(files: Mapping[Path, Array | None]) -> list[str]:
    """A warning if the times of compared files may be numbers of frames; `files` : times (N,) by file.

    If one of them has fractions, it has seconds, and so has a file with poses at the same times.
    """
    timed = {path: times for path, times in files.items() if times is not None}
    if not timed or not all(are_frame_numbers(times) for times in timed.values()):
        return []
    return [
        f"warning: the times of {' and '.join(map(str, timed))} are whole numbers: if these are numbers of "
        "frames, durations and speeds are wrong."
    ]


def leap_warnings(paths: Mapping[str, WholePath]) -> list[str]:
    """Warnings about named paths with a step or a speed that no vehicle has."""
    warnings = []
    for name, path in paths.items():
        if path.from_outside and probably_inverted(path.poses):
            continue  # its steps are no motions
        speed = None if path.times is None else usual_speed(path.poses, path.times)
        leap = leaps(path.poses, path.times)
        if speed is not None and speed > MAX_SPEED:
            warnings.append(
                f"warning: {name}: a usual speed of {speed:.3g} m/s is impossible for a vehicle: the "
                "positions are probably in another unit than metres, or the times in another than seconds."
            )
        elif leap is not None:
            at_time = "" if path.times is None else f" (at {path.times[leap.pose]:.3f} s)"
            at_speed = "" if leap.speed is None else f", at {leap.speed:.4g} m/s"
            more = f" There are {leap.count - 1} more such leaps." if leap.count > 1 else ""
            where = f"from pose {leap.pose - 1} to pose {leap.pose}{at_time}, counted from 0"
            length = f"{leap.length:.4g} m{at_speed}"
            warnings.append(
                f"warning: {name}: {where}, the path leaps by {length}, and its median step is "
                f"{leap.usual:.3g} m: the map was probably reset, or the place lost, so numbers over this "
                f"leap are wrong: evaluate the parts before and after it alone.{more}"
            )
    return warnings


def _frames_name(config: dict[str, Any]) -> str:
    """The sequence of a run and its first and last frame, such as "kitti/07, frames 0-99"."""
    name = str(config.get("sequence"))
    numbers = [frame.lstrip("0") or "0" for frame in config.get("frames", ())]
    return f"{name}, frames {'-'.join(numbers)}" if numbers else name


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


def _truth_of_run(config: dict[str, Any]) -> _Reference:
    """The truth of a run's frames, from the folder of its sequence; `_NoTruth` if it is not there."""
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
    sequence.require_unbroken()
    interval = interval_fault(sequence.times)
    notes = (f"{location}: {interval}; speeds are wrong.",) if interval else ()
    return _Reference(name, sequence.true_poses, sequence.times, sequence.is_part, notes)


def _member(source: Path, config: dict[str, Any] | None, run_file: str) -> _Member:
    """A pose file or, with the content of its config.json, a run, whose poses are in `run_file`."""
    if config is None:
        return _Member(source, _labels(source, None), is_run=False)
    return _Member(source / run_file, _labels(source, config), is_run=True)


def _labels(source: Path, config: dict[str, Any] | None) -> list[str]:
    """Possible labels of a run or, without `config`, of a pose file, from the most to the least preferred.

    For a file: its name, then the names of the folders around it from inner to outer, then its place.
    """
    if config is None:
        folders = source.parent.parts[1:]  # without the root
        file_names = [] if source.stem in COMMON_STEMS else [source.stem, source.name]
        return [*file_names, *reversed(folders), str(source)]
    method = str(config.get("method"))
    variant = config.get("variant")
    short = method if variant == "published" else f"{method}, {variant}"
    long = f"{method}, {variant}"
    labels = [short]
    with suppress(DataError):  # a method or settings of another version
        changes = differences(settings_in(config, source), preset(method, variant=str(variant)))
        if changes:
            labels.append(f"{short}, {settings_words(changes)}")
            long += f", {settings_words(changes)}"
    seed = config["settings"].get("seed")
    return [*labels, f"{long}, seed {seed}", str(source)]


def _compared(
    truth: _Reference, members: list[_Member], tolerance: float, truth_words: str, frame_times: Array | None
) -> ComparedPaths:
    """The paths at their common frames, each with its preferred label that no other path could have.

    Parameters
    ----------
    truth : the truth, or the path in its place.
    tolerance : seconds between two times that are equal.
    truth_words : the truth in words, for messages.
    frame_times : the times of the sequence's frames, seconds, which a path without times gets; None if they
        are not known.
    """
    matched_files = [_matched(member.file, truth, tolerance, truth_words) for member in members]
    common = functools.reduce(np.intersect1d, [matched.rows for matched in matched_files])
    notes = list(truth.notes)
    for matched in matched_files:
        notes += matched.notes
    notes += _notes_on_common(common, truth, members, matched_files, tolerance)
    estimates = {}
    wholes = {}
    for member, matched in zip(members, matched_files, strict=True):
        label = _distinct_label(member, members)
        estimates[label] = matched.poses[np.searchsorted(matched.rows, common)]
        file = matched.file
        times = file.times
        if times is None and frame_times is not None and len(frame_times) == len(file.poses):
            times = frame_times
        wholes[label] = WholePath(file.poses, times, from_outside=not member.is_run)
    return ComparedPaths(
        name=truth.name,
        truth=truth.poses,
        times=truth.times,
        estimates=estimates,
        frames=common,
        is_part=truth.is_part,
        notes=tuple(notes),
        wholes=wholes,
    )


def _distinct_label(member: _Member, members: list[_Member]) -> str:
    """The preferred label of a path that no other path could have; the last one, its place, is always one."""
    taken = set[str]()
    for other in members:
        if other is not member:
            taken.update(other.labels)
    return next(label for label in member.labels if label not in taken)


def _notes_on_common(
    common: Index,
    truth: _Reference,
    members: list[_Member],
    matched_files: list[_MatchedFile],
    tolerance: float,
) -> list[str]:
    """A warning if few frames are `common` to several paths, each of which shares more with the truth.

    Raises `DataError` if they are too few to compare the paths.
    """
    shortest = min(len(truth.poses), *(len(matched.file.poses) for matched in matched_files))
    if len(common) >= 2 and len(common) >= USUAL_MATCHED_SHARE * shortest:
        return []
    if len(common) == min(len(matched.rows) for matched in matched_files):
        return []  # the file with the fewest matches has its own warning
    files = ", ".join(str(member.file) for member in members)
    words = (
        f"only {len(common)} poses are at times that all files have, within --t-max-diff {tolerance:g} s, of "
        f"{shortest} poses in the shortest of {files}"
    )
    if len(common) < 2 or len(common) < LEAST_MATCHED_SHARE * shortest:
        raise DataError(f"{words}: evaluate fewer files at once")
    return [f"warning: {words}."]


def _matched(path: Path, truth: _Reference, tolerance: float, truth_words: str) -> _MatchedFile:
    """The poses of a file that belong to true poses: those of equal times or, without times, all.

    truth_words : the truth in words.

    Raises `DataError` for a single pose, for impossible times, if a smaller share of poses than
    `LEAST_MATCHED_SHARE` has equal times, or if files without times differ in length.
    """
    file = read_path(path)
    if len(file.poses) < 2:
        raise DataError("has one pose: a path needs two or more", path)
    notes = list(file.notes)
    if file.times is None or truth.times is None:
        if file.times is not None:
            refuse_intervals(file.times, path, as_column=True)
        _require_same_frames(file, truth, path, truth_words)
        return _MatchedFile(np.arange(len(file.poses)), file.poses, file, notes)
    rows, pose_rows = match_times(truth.times, file.times, tolerance)
    if len(rows) < min(2, len(truth.poses)):
        raise time_mismatch(file.times, truth.times, truth.name, tolerance, path)
    refuse_intervals(file.times, path, as_column=True)
    shorter = min(len(file.poses), len(truth.poses))
    ranges = time_ranges(file.times, truth.times, truth.name)
    counts = (
        f"{len(rows)} of {len(file.poses)} poses have one of the {len(truth.poses)} poses of {truth_words} "
        f"within --t-max-diff {tolerance:g} s: {ranges}"
    )
    if len(rows) < USUAL_MATCHED_SHARE * shorter and are_frame_numbers(file.times):
        raise DataError(f"the times are frame numbers, expected seconds: {ranges}", path)
    if len(rows) < LEAST_MATCHED_SHARE * shorter:
        raise DataError(
            f"only {counts}. If their clocks differ, write the times of one clock in both files; if not, "
            "give a larger --t-max-diff, or leave out the poses at times that only one file has",
            path,
        )
    if len(rows) < USUAL_MATCHED_SHARE * shorter:
        notes.append(f"warning: {path}: only {counts}; with two clocks, these would be matches by chance.")
    elif doubt := _clock_doubt(file, truth, rows, pose_rows):
        notes.append(f"warning: {path}: {counts}. {doubt}")
    return _MatchedFile(rows, file.poses[pose_rows], file, notes)


def _clock_doubt(file: PoseFile, truth: _Reference, rows: Index, pose_rows: Index) -> str:
    """Why a file may have another clock than the truth, or be of another drive; "" if there is no reason.

    The turns of both decide or, if these do not tell, the times at which both begin and end.

    rows, pose_rows : (M,) numbers of the true poses and of the poses of the file that have equal times.
    """
    if file.times is None or truth.times is None:
        return ""
    doubt = _doubt_from_turns(file.times, file.poses, truth.times, truth.poses)
    if doubt is not None:
        return doubt
    if len(rows) == min(len(file.poses), len(truth.poses)):
        return ""  # every pose of the shorter one has a partner, so no end of it is without one
    shift = clock_shift(file.times, truth.times)
    if shift is None or _positions_agree(truth.poses[rows], file.poses[pose_rows], truth.times[rows], shift):
        return ""
    offset_word = "later" if shift > 0 else "earlier"
    return f"Its first and its last time are both about {abs(shift):.3g} s {offset_word}, {OTHER_CLOCK}"


def _doubt_from_turns(times: Array, poses: Array, true_times: Array, true_poses: Array) -> str | None:
    """Why the turns of a path speak against the clock or the drive of the truth; "" if they speak for both.

    None if they do not tell, for instance since the path hardly turns.

    Parameters
    ----------
    times, poses : of the path, (N,) seconds and (N, 4, 4).
    true_times, true_poses : of the truth, (K,) seconds and (K, 4, 4).
    """
    turns = turn_agreement(times, poses, true_times, true_poses)
    if turns is not None and turns.is_another_clock:
        correction = "earlier" if turns.lag > 0 else "later"
        return (
            f"The turns of both would agree far better if its times were {abs(turns.lag):.3g} s "
            f"{correction}, {OTHER_CLOCK}"
        )
    if turns is not None and turns.is_one_clock:
        return ""
    slow_turns = slow_turn_agreement(times, poses, true_times, true_poses)
    if all(agreement is not None and agreement.is_another_drive for agreement in (turns, slow_turns)):
        return (
            "But the turns of both agree at no lag between their times, so perhaps one is of another drive, "
            "or the orientations of one are wrong."
        )
    return None


def _positions_agree(true_poses: Array, poses: Array, times: Array, shift: float) -> bool:
    """Whether two paths (M, 4, 4) differ far less than a path moves in `shift` seconds.

    Then their times, (M,) seconds, are those of one clock, or another clock has no effect on any number.
    """
    aligned, _ = align(true_poses, poses, Alignment.SE3)
    apart = np.linalg.norm(aligned[:, :3, 3] - true_poses[:, :3, 3], axis=1)
    steps = np.linalg.norm(np.diff(true_poses[:, :3, 3], axis=0), axis=1)
    # The root mean square, which is not 0 on a drive with long stops: the median may be.
    speed = rmse(steps / np.diff(times)) or 0.0
    return (rmse(apart) or 0.0) <= AGREEING_SHARE * speed * abs(shift)


def _require_same_frames(file: PoseFile, truth: _Reference, path: Path, truth_words: str) -> None:
    """Raise `DataError` if a file and the truth, one of which has no times, differ in length."""
    if len(file.poses) == len(truth.poses):
        return
    counts = f"has {len(file.poses)} poses, but {truth_words} has {len(truth.poses)}"
    if file.times is not None:
        remedy = f"give {truth_words} with times"
    elif truth.times is not None:
        remedy = "give this file with times"
    else:
        remedy = "give both files with times"
    raise DataError(
        f"{counts}: without times, both need a pose for the same frames. If frames are missing, {remedy}, as "
        f"{TUM_ROW} (TUM)",
        path,
    )
