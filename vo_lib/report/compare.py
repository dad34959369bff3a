"""Paths side by side: runs and pose files with a truth, or without it, in tables, numbers and pictures."""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from ..data.catalogue import open_sequence
from ..data.poses import (
    TIME_TOLERANCE_S,
    PoseFile,
    from_first,
    match_times,
    read_kitti_poses,
    read_poses,
    refuse_intervals,
)
from ..errors import DataError
from ..evaluation.ate_rpe import ONE_FRAME, align, rmse
from ..evaluation.kitti_errors import (
    FEW_SUBSEQUENCES,
    KITTI_PROTOCOL,
    SubsequenceProtocol,
    is_as_kitti,
    subsequences_text,
)
from ..evaluation.path_errors import PathErrors
from ..evaluation.path_facts import doubt, end_of, path_difference, path_length
from ..files import write_atomic
from ..geometry.types import Array, Index
from ..runs.folder import POSES, POSES_TUM, is_finished, read_config
from .page import ReportTable, format_number
from .plots import error_curves_figure, png, trajectories_figure
from .table1_plan import slug

LEAST_SHARE = 0.25  # of the poses of the shorter path that have a partner of equal time: fewer are chance
MIN_CURVE_POINTS = {"length": 2, "speed": 4}  # with fewer, a curve has no figure
GIVE_TRUTH = "give its ground truth with --truth FILE"


@dataclass(frozen=True, eq=False)
class Compared:
    """Estimates (M, 4, 4) by name at `frames` (M,) of a reference, which is the truth if there is one.

    Attributes
    ----------
    name : name of the sequence or of the first file.
    truth : (N, 4, 4) T_w_c, metres, or None.
    times : (N,) seconds of the true poses, or None if unknown.
    is_part : whether the truth is only a part of that of a sequence.
    notes : sentences on the truth and on poses that are not compared.
    """

    name: str
    truth: Array | None
    times: Array | None
    paths: dict[str, Array]
    frames: Index
    is_part: bool
    notes: list[str]


@dataclass(frozen=True, eq=False)
class _Reference:
    """What paths are compared with: poses of a truth, if `is_truth`, else the first of the paths."""

    name: str
    file: PoseFile
    is_truth: bool
    is_part: bool = False
    notes: tuple[str, ...] = ()


def read_compared(sources: list[Path], truth_file: Path | None = None) -> Compared:
    """Runs and pose files with the truth in a file, else with that of the runs' sequence, if it has one.

    Poses correspond by equal times or, where a file has none, row by row. Only frames that occur in all paths
    are compared.

    Raises
    ------
    DataError : a source is no run and no pose file, the runs are of several sequences, or the paths do not
        correspond.
    """
    files = {str(source): _read_source(source) for source in sources}
    reference = _reference(sources, files, truth_file)
    pairs = {name: _pairs(reference, file, name) for name, file in files.items()}
    common = reduce(np.intersect1d, [rows for rows, _ in pairs.values()])
    if len(common) < 2:
        raise DataError(f"fewer than two poses are at times of all paths of {reference.name}")
    paths = {
        name: files[name].poses[own[np.searchsorted(rows, common)]] for name, (rows, own) in pairs.items()
    }
    notes = list(reference.notes)
    if len(common) < len(reference.file.poses):
        notes.append(f"Compared: {len(common)} of {len(reference.file.poses)} poses of {reference.name}.")
    times, poses = reference.file
    truth = poses if reference.is_truth else None
    return Compared(reference.name, truth, times, paths, common, reference.is_part, notes)


def _read_source(source: Path) -> PoseFile:
    """The poses of a run's folder or of a pose file."""
    if not source.is_dir():
        return read_poses(source)
    if not is_finished(source):
        raise DataError("is not the folder of a finished run, nor a pose file", source)
    return PoseFile(read_poses(source / POSES_TUM).times, read_kitti_poses(source / POSES))


def _reference(sources: list[Path], files: dict[str, PoseFile], truth_file: Path | None) -> _Reference:
    """The truth of a file or of the sequence of the runs, or else the first path."""
    configs = [read_config(source) for source in sources if source.is_dir()]
    names = sorted({str(config["sequence"]) for config in configs})
    if len(names) > 1 or len({Path(str(config["folder"])).resolve() for config in configs}) > 1:
        raise DataError(f"the runs are of several sequences ({', '.join(names)}): compare each alone")
    if truth_file is not None:
        file = read_poses(truth_file)
        name = names[0] if names else truth_file.stem
        return _Reference(name, file, is_truth=True, notes=(f"truth: {truth_file}",))
    first = files[str(sources[0])]
    if not configs:
        return _Reference(str(sources[0]), first, is_truth=False)
    folder = Path(str(configs[0]["folder"]))
    if not folder.is_dir():
        note = f"No ground truth: the sequence of the run is no longer at {folder}."
        return _Reference(names[0], first, is_truth=False, notes=(note,))
    sequence = open_sequence(folder)
    start, end = configs[0]["frames"]
    if sequence.truth is None or not {start, end} <= set(sequence.frames):
        note = f"No ground truth: {folder} has none for the frames of the run."
        return _Reference(names[0], first, is_truth=False, notes=(note,))
    part = sequence.part(sequence.frames.index(start), sequence.frames.index(end) + 1)
    name = names[0] if len(part) == len(sequence) else f"{names[0]}, frames {int(start)}-{int(end)}"
    true_path = PoseFile(part.times, part.true_poses)
    notes = (f"truth: {sequence.truth_file}",)
    return _Reference(name, true_path, is_truth=True, is_part=part.is_part, notes=notes)


def _pairs(reference: _Reference, file: PoseFile, name: str) -> tuple[Index, Index]:
    """Numbers of the poses of the reference and of a file that belong together, by time or by row."""
    count = len(file.poses)
    true_count = len(reference.file.poses)
    if reference.file.times is None or file.times is None:
        if count != true_count:
            counts = f"{name} has {count} poses, and {reference.name} has {true_count}"
            raise DataError(f"{counts}: without times, both need a pose for every frame")
        return np.arange(count), np.arange(count)
    rows, own = match_times(reference.file.times, file.times)
    if len(rows) < max(2, LEAST_SHARE * min(count, true_count)):
        ranges = [f"{times[0]:.13g} to {times[-1]:.13g} s" for times in (file.times, reference.file.times)]
        raise DataError(
            f"only {len(rows)} times of {name} are those of {reference.name} within {TIME_TOLERANCE_S:g} s: "
            f"{' and '.join(ranges)}; expected seconds of one clock"
        )
    refuse_intervals(file.times, name)
    return rows, own


def error_tables(name: str, errors: list[PathErrors], whole_truth: bool) -> list[ReportTable]:
    """A table of TE and RE by length, a column for each path, and one of all errors with a row for each.

    whole_truth : whether every frame of a whole sequence is compared.
    """
    first = errors[0]
    protocol = first.protocol
    count = len(first.kitti)
    as_kitti = is_as_kitti(protocol, count, whole_truth)
    by_length = []
    for length in protocol.lengths:
        parts = [path.kitti[path.kitti.length == length] for path in errors]
        if len(parts[0]):
            cells = [f"{format_number(part.te)} / {format_number(part.re)}" for part in parts]
            by_length.append([f"{length:g} m ({len(parts[0])})", *cells])
    rows = []
    for path in errors:
        other = (rmse(path.ate.distance), rmse(path.rpe.translation), rmse(np.degrees(path.rpe.rotation)))
        kitti = [format_number(path.kitti.te), format_number(path.kitti.re)]
        rows.append([path.name, *kitti, *(format_number(error, 4) for error in other)])
    head = [
        f"warning: {path.name} {path.doubt}: the errors may mean nothing." for path in errors if path.doubt
    ]
    head += _caveats(protocol, count, whole_truth)
    alignment = first.ate.alignment.value
    delta = first.rpe.delta
    interval = "from frame to frame" if delta == ONE_FRAME else f"over {delta.size:g} {delta.unit}"
    notes = [f"ATE with alignment {alignment}, RPE {interval}: root mean squares."]
    title = f"{name}: {subsequences_text(count)} of {protocol.words_with(as_kitti)}"
    names = [path.name for path in errors]
    systems = ReportTable(
        title, ["system", "TE %", "RE deg/100 m", "ATE m", "RPE m", "RPE deg"], rows, notes, head
    )
    lengths = ReportTable("TE % / RE deg/100 m by length (sub-sequences)", ["length", *names], by_length, [])
    return [lengths, systems] if by_length else [systems]


def _caveats(protocol: SubsequenceProtocol, count: int, whole_truth: bool) -> list[str]:
    """Why there is no TE and RE, or why they are not those of the benchmark; empty if they are."""
    if not count:
        return [f"No TE and RE: the path is shorter than {min(protocol.lengths):g} m (--lengths)."]
    reasons = []
    if protocol != KITTI_PROTOCOL:
        reasons.append("other sub-sequences than KITTI's")
    if not whole_truth:
        reasons.append("only a part of a sequence")
    if count < FEW_SUBSEQUENCES:
        reasons.append(f"fewer than {FEW_SUBSEQUENCES} sub-sequences, so a single place may decide")
    return [f"Not comparable with the benchmark: {'; '.join(reasons)}."] if reasons else []


def tables_without_truth(compared: Compared) -> list[ReportTable]:
    """A table of the length and the end of each path, and one of the distances of each pair."""
    facts = []
    warnings = []
    reference = next(iter(compared.paths.values()))
    for name, poses in compared.paths.items():
        length = path_length(poses)
        end = ", ".join(format_number(value + 0.0, 1) for value in end_of(poses).round(1))
        facts.append([name, format_number(length, 2), end])
        fault = doubt(reference, poses).replace("the truth", "the first path")
        if fault:
            warnings.append(f"warning: {name} {fault}.")
    apart = []
    for (first, a), (second, b) in combinations(compared.paths.items(), 2):
        apart.append(
            [f"{first} – {second}", *(format_number(distance) for distance in path_difference(a, b))]
        )
    title = f"{compared.name}: no ground truth, so these numbers are no errors"
    note = "End: the last position in the axes of the first pose, x right, y down, z forward."
    tables = [ReportTable(title, ["path", "length m", "end x, y, z m"], facts, [note], warnings)]
    if apart:
        columns = ["two paths from the same start", "at the end m", "largest m", "rmse m"]
        tables.append(ReportTable(f"Distances at {len(compared.frames)} frames", columns, apart, []))
    return tables


def numbers(compared: Compared, errors: list[PathErrors]) -> dict[str, Any]:
    """All results for JSON; `errors` : those of the paths, empty without truth."""
    paths = []
    for name, poses in compared.paths.items():
        length = path_length(poses)
        paths.append({"name": name, "length_m": length, "end_m": end_of(poses).tolist()})
    differences = []
    for (first, a), (second, b) in combinations(compared.paths.items(), 2):
        apart = path_difference(a, b)
        differences.append(
            {"paths": [first, second], "end_m": apart.end, "max_m": apart.largest, "rmse_m": apart.rmse}
        )
    return {
        "sequence": compared.name,
        "ground_truth": compared.truth is not None,
        "frames": len(compared.frames),
        "notes": compared.notes,
        "paths": paths,
        "differences": differences,
        "systems": [path.to_dict() for path in errors],
    }


def write_pictures(folder: Path, compared: Compared, errors: list[PathErrors]) -> None:
    """Write a figure of the paths from above, aligned as for the ATE, and figures of error curves.

    Paths in doubt are left out of the curves. Without truth, all paths begin at the same pose.
    """
    name = slug(compared.name)
    panel: tuple[Array | None, dict[str, Array]]
    if compared.truth is None:
        title = f"{compared.name}\nno ground truth; all paths begin at the same pose"
        panel = (None, {label: from_first(poses) for label, poses in compared.paths.items()})
    else:
        alignment = errors[0].ate.alignment
        truth = compared.truth[compared.frames]
        to_first = np.linalg.inv(truth[0])  # the axes of the first camera, so that the view is from above
        aligned = {
            label: to_first @ align(truth, poses, alignment)[0] for label, poses in compared.paths.items()
        }
        title = f"{compared.name}\nalignment {alignment.value}"
        panel = (truth, aligned)
    write_atomic(folder / f"trajectory_{name}.png", png(trajectories_figure({title: panel})))
    sound = [path for path in errors if not path.doubt]
    for by, least in MIN_CURVE_POINTS.items():
        curves = {path.name: path.kitti.curve(by, path.protocol.lengths) for path in sound}
        if max(map(len, curves.values()), default=0) >= least:
            figure = error_curves_figure(compared.name, by, curves)
            write_atomic(folder / f"errors_{name}_by_{by}.png", png(figure))
