"""Tables and pictures of paths: errors with ground truth, lengths and distances without."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..data.poses import from_first
from ..evaluation.ate_rpe import align, rmse
from ..evaluation.conventions import inverses_agree, orientations_disagree, quaternions_disagree
from ..evaluation.kitti_errors import FEW_SUBSEQUENCES, KITTI_PROTOCOL, SHORT_PROTOCOL, subsequences_text
from ..evaluation.path_errors import Evaluation, PathErrors
from ..evaluation.path_facts import path_differences, path_facts, probably_inverted, unusual_axis
from ..files import write_atomic
from ..geometry.types import Array
from .page import COUNT_COLUMN, ReportTable, format_number, without_empty_columns
from .paths import ComparedPaths, PathsWithoutTruth, WholePath, leap_warnings
from .plots import error_curves_figure, png, trajectories_figure
from .table1 import ERROR_KINDS, STILL_M
from .table1_plan import slug

# A curve with fewer points has no figure. The devkit's speed bins overlap, so nearly equal speeds already
# fall into two or three of them.
MIN_CURVE_POINTS = {"length": 2, "speed": 4}
USUAL_LENGTH_RATIOS = (0.5, 2.0)  # least and largest length of a path, divided by that of its truth
WRITE_INVERSES = "write their inverses (camera to world)"  # the advice of all warnings about inverted poses
ROBOT_AXES = "other axes (in those of a robot or an IMU, x is often forward and z up)"


class _OtherMotion(NamedTuple):
    """What it would mean that poses move along another axis of their own than +z, in which a camera looks.

    direction : in which the camera would have moved, if this were true.
    likely_reason : what the file probably has instead.
    """

    direction: str
    likely_reason: str


# By the letter of that axis. Along z, the motion can only be one along -z.
OTHER_MOTIONS = {
    "x": _OtherMotion("sideways", ROBOT_AXES),
    "y": _OtherMotion("up or down", ROBOT_AXES),
    "z": _OtherMotion("backwards", "other axes, or inverted poses (world to camera)"),
}


def evaluation_tables(name: str, result: Evaluation, of_run: bool = False) -> list[ReportTable]:
    """A table of the systems' errors on a sequence, and a table of TE and RE by length.

    of_run : whether the paths come from a run just done, and not from files, whose units may differ.
    """
    tables = [_table_of_systems(name, result, of_run)]
    by_length = _table_by_length(result)
    if by_length.rows:
        tables.append(by_length)
    return tables


def _table_of_systems(name: str, result: Evaluation, of_run: bool) -> ReportTable:
    """TE, RE, ATE and RPE of each system, with warnings above and the kinds of errors below."""
    protocol = result.protocol
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
    first = result.paths[0]  # its alignment is that of all paths
    title = name
    head = list[str]()
    notes = [f"ATE {first.ate.alignment.words}: root mean square.", _rpe_note(result)]
    if result.subsequences:
        title += f": {subsequences_text(result.subsequences)} of {protocol.words_with(result.as_kitti)}"
        head += _caveats(result)
    else:
        notes.append(_note_without_subsequences(result, of_run))
    if result.frame_step > 1:
        notes.append(
            f"The compared poses are {result.frame_step} frames of the truth apart; intervals and starts in "
            "frames are frames of the truth."
        )
    for system in result.paths:
        head += _doubts(system, of_run)
    units = [unit for unit, _ in ERROR_KINDS.values()]
    columns = ["system", *units, "ATE m", "RPE m", "RPE deg"]
    return without_empty_columns(ReportTable(title, columns, rows, notes, head))


def _note_without_subsequences(result: Evaluation, of_run: bool) -> str:
    """Why a path has no TE and RE, and what helps; `of_run` : as in `evaluation_tables`."""
    shortest = min(result.protocol.lengths)
    note = f"No TE and RE: {_too_short(result)} than the shortest sub-sequence, {shortest:g} m."
    if result.paths[0].distance < STILL_M:
        return f"{note} The truth stands still, so no choice of lengths gives errors."
    return note if of_run else f"{note} The option --lengths chooses shorter ones."


def _too_short(result: Evaluation) -> str:
    """The beginning of a sentence on a path that is too short."""
    first = result.paths[0]
    return f"the path, {first.distance:.1f} m in {first.frames} frames, is shorter"


def _table_by_length(result: Evaluation) -> ReportTable:
    """TE and RE of each system, with a row for each length that has sub-sequences."""
    rows = []
    for length in result.protocol.lengths:
        for system in result.paths:
            of_length = system.kitti[system.kitti.length == length]
            if len(of_length):
                label = f"{length:g} m" if len(result.paths) == 1 else f"{length:g} m, {system.name}"
                errors = [format_number(of_length.te), format_number(of_length.re)]
                rows.append([label, *errors, str(len(of_length))])
    columns = ["length", *(unit for unit, _ in ERROR_KINDS.values()), COUNT_COLUMN]
    return ReportTable("TE and RE by length", columns, rows, [])


def spread_table(result: Evaluation) -> ReportTable:
    """Root mean square, mean, median and maximum of ATE and RPE of each system, as evo prints them."""
    errors_of_systems = {
        "ATE m": [system.ate.distance for system in result.paths],
        "RPE m": [system.rpe.translation for system in result.paths],
        "RPE deg": [np.degrees(system.rpe.rotation) for system in result.paths],
    }
    rows = []
    for kind, of_kind in errors_of_systems.items():
        for system, errors in zip(result.paths, of_kind, strict=True):
            if len(errors):
                spread = (rmse(errors), errors.mean(), np.median(errors), errors.max())
                rows.append([f"{kind}, {system.name}", *(format_number(value, 4) for value in spread)])
    return ReportTable("ATE and RPE", ["error, system", "rmse", "mean", "median", "max"], rows, [])


def tables_without_truth(paths: PathsWithoutTruth) -> list[ReportTable]:
    """A table of the length, duration, speed and end of each path, and one of the distances of each pair."""
    tables = [_table_of_facts(paths)]
    if len(paths.common) > 1:
        tables.append(_table_of_distances(paths))
    return tables


def _table_of_facts(paths: PathsWithoutTruth) -> ReportTable:
    """The length, duration, speed and end of each path, with warnings above."""
    rows = []
    for name, path in paths.wholes.items():
        facts = path_facts(path.poses, path.times)
        rounded_end = facts.end.round(1) + 0.0  # a sum of -0.0 and 0.0 is 0.0, so there is no "-0.0"
        end = ", ".join(format_number(value, 1) for value in rounded_end)
        rows.append(
            [
                name,
                str(facts.poses),
                format_number(facts.length, 2),
                format_number(facts.duration, 2),
                format_number(facts.speed, 2),
                end,
            ]
        )
    title = f"{paths.name}: no ground truth, so these numbers are no errors"
    columns = ["path", "poses", "length m", "time s", "m/s", "end x, y, z m"]
    notes = ["End: position of the last pose in the axes of the first, x right, y down, z forward."]
    if not paths.is_all_common:
        notes.insert(0, "Each row is about all poses of its path, with the path's own times.")
    untimed = [name for name, path in paths.wholes.items() if path.times is None]
    if len(untimed) == len(paths.wholes):
        notes.append("No duration and no speed: no file has times.")
    elif untimed:
        files_have = "its file has" if len(untimed) == 1 else "their files have"
        notes.append(f"No duration and no speed of {' and '.join(untimed)}: {files_have} no times.")
    return ReportTable(title, columns, rows, notes, warnings_without_truth(paths))


def _table_of_distances(paths: PathsWithoutTruth) -> ReportTable:
    """How far the paths of each pair are apart at their common frames."""
    rows = []
    for (first, second), apart in path_differences(paths.common).items():
        distances = (apart.end, apart.largest, apart.rmse)
        cells = [format_number(distance) for distance in distances]
        rows.append([f"{first} – {second}", *cells])
    columns = ["two paths from the same start", "at the end m", "largest m", "rmse m"]
    which = "all" if paths.is_all_common else "only the"
    title = f"Distances between the paths, at {which} {paths.common_count} poses that all paths have"
    notes = [
        "Distances between positions of the same frame: they tell how far the paths differ, not which "
        "one is right."
    ]
    if not paths.is_all_common:
        notes.append("Start and end are the first and the last of these common poses.")
    return ReportTable(title, columns, rows, notes)


def facts_without_truth(paths: PathsWithoutTruth) -> dict[str, Any]:
    """The numbers and warnings of `tables_without_truth` for JSON."""
    systems = []
    for name, path in paths.wholes.items():
        facts = path_facts(path.poses, path.times)
        systems.append({"name": name, "frames": facts.poses, "path": facts.to_dict()})
    differences = []
    for names, apart in path_differences(paths.common).items():
        differences.append({"paths": list(names), **apart.to_dict()})
    return {
        "ground_truth": False,
        "warnings": warnings_without_truth(paths),
        "systems": systems,
        "compared_frames": paths.common_count,
        "differences": differences,
    }


def warnings_without_truth(paths: PathsWithoutTruth) -> list[str]:
    """Warnings about paths that are probably in other units or axes than the first one, or than a camera."""
    between = _doubts_between(paths.common)
    return between + leap_warnings(paths.wholes) + _doubts_about_axes(paths.wholes)


def _doubts_about_axes(paths: Mapping[str, WholePath]) -> list[str]:
    """Warnings about paths from outside that do not move in the direction in which a camera looks."""
    inverted = list[str]()
    names_by_axis = dict[str, list[str]]()
    for name, path in paths.items():
        if not path.from_outside:
            continue
        if probably_inverted(path.poses):
            inverted.append(name)
            continue
        axis = unusual_axis(path.poses)
        if axis:
            names_by_axis.setdefault(axis, []).append(name)
    doubts = []
    if inverted:
        doubts.append(
            f"warning: {' and '.join(inverted)}: the poses are probably inverted (world to camera), since "
            "only their inverses move along their own +z axis, in which a camera looks: so length, speed, "
            f"end and picture are wrong: {WRITE_INVERSES}."
        )
    for axis, names in names_by_axis.items():
        motion = _other_motion(axis)
        doubts.append(
            f"warning: {' and '.join(names)}: the poses move along their own {axis} axis rather than along "
            f"+z, in which a camera looks. Unless the camera really moved {motion.direction}, the file has "
            f"{motion.likely_reason}, and then the end and the picture are in other axes than they say: "
            "write poses of the left camera, with x right, y down and z forward."
        )
    return doubts


def _other_motion(axis: str) -> _OtherMotion:
    """What a motion along an axis means, such as "+x" or "x" (a motion to and fro), from `unusual_axis`."""
    letter = axis.lstrip("+-")
    return OTHER_MOTIONS[letter]


def _doubts_between(paths: Mapping[str, Array]) -> list[str]:
    """Warnings about paths that are probably not in the same units or axes as the first one."""
    doubts = []
    (first, reference), *others = paths.items()
    reference_length = path_facts(reference, None).length
    least_ratio, largest_ratio = USUAL_LENGTH_RATIOS
    for name, poses in others:
        if inverses_agree(reference, poses):
            doubts.append(
                f"warning: {name} and {first} agree only if the poses of one of them are inverted (world to "
                f"camera), so their distances are meaningless: {WRITE_INVERSES}."
            )
            continue
        length = path_facts(poses, None).length
        ratio = length / reference_length if reference_length > 0 else None
        if ratio is not None and not least_ratio <= ratio <= largest_ratio:
            doubts.append(
                f"warning: the path of {name} is {ratio:.3g} times as long as that of {first}: another unit, "
                "or a path without scale."
            )
        if quaternions_disagree(reference, poses) or orientations_disagree(reference, poses):
            doubts.append(
                f"warning: {name} and {first} have other axes or another order of quaternions, so their "
                "distances from a common start are meaningless: name the columns in the first line of a file."
            )
    return doubts


def _caveats(result: Evaluation) -> list[str]:
    """Sentences above a table of errors that are not those of KITTI's benchmark."""
    head = list[str]()
    if result.protocol == SHORT_PROTOCOL:
        head.append(
            "Short path, so sub-sequences are shorter than KITTI's: not comparable with the benchmark."
        )
    elif result.protocol != KITTI_PROTOCOL:
        head.append("Other sub-sequences than KITTI's: not comparable with the benchmark.")
    elif not result.whole_truth:
        head.append("Part of the truth, not comparable with whole sequences of the benchmark.")
    if result.subsequences < FEW_SUBSEQUENCES:
        head.append(
            f"Fewer than {FEW_SUBSEQUENCES} sub-sequences: a single place of the path may decide TE and RE."
        )
    return head


def _rpe_note(result: Evaluation) -> str:
    """The interval of the RPE, or why there is none."""
    first = result.paths[0]
    interval = first.rpe.delta.words
    if len(first.rpe.rotation):
        return f"RPE {interval}: root mean square."
    step = result.frame_step
    if first.rpe.delta.unit == "frames" and step > first.rpe.delta.size:
        return f"No RPE {interval}: the compared poses are {step} frames apart; use --delta {step}f."
    return f"No RPE {interval}: {_too_short(result)}."


def _doubts(system: PathErrors, of_run: bool) -> list[str]:
    """Warnings about a path that is probably not in the frames, the units or the axes of the truth.

    of_run : whether the path comes from a run just done: then the run itself is wrong, not a unit.
    """
    doubts = list[str]()
    name = system.name
    if system.inverted:
        # If other orientations are the reason as well, it may only be a z axis that points backwards: on a
        # straight path, such poses look like inverted ones.
        or_backwards = " (or, on a straight path, to have z backwards)" if system.other_orientations else ""
        return [
            f"warning: {name} and the truth agree only if the poses of one of them are inverted, so all "
            f"errors are meaningless: one file seems to have poses from world to camera{or_backwards}: "
            f"{WRITE_INVERSES}."
        ]
    least_ratio, largest_ratio = USUAL_LENGTH_RATIOS
    if system.length_ratio is not None and not least_ratio <= system.length_ratio <= largest_ratio:
        reason = "other frames, another unit, or a path without scale (--alignment sim3)"
        if of_run:
            reason = "the motion was not found, or the calibration does not fit the images"
        doubts.append(
            f"warning: the path of {name} is {system.length_ratio:.3g} times as long as the truth: {reason}."
        )
    if system.other_quaternions:
        doubts.append(
            f"warning: orientations of {name} and of the truth agree only with the quaternions of one "
            "file in another order (qw first, or last), so TE, RE and RPE are meaningless: name the columns "
            "in the first line of that file in their true order."
        )
    elif system.mirrored:
        doubts.append(
            f"warning: {name} and the truth agree far better if the {system.mirrored} axis of one of them is "
            "reversed, so all errors are wrong: one file has mirrored (left-handed) axes. Write it with x "
            "right, y down and z forward."
        )
    elif system.other_orientations:
        doubts.append(
            f"warning: positions of {name} and of the truth agree, but orientations do not, so TE, RE and "
            "RPE are meaningless: one file may have qw first, or axes of another sensor (IMU, not camera)."
        )
    return doubts


def write_pictures(folder: Path, paths: ComparedPaths, result: Evaluation) -> list[str]:
    """Write figures of the paths and the truth, aligned as for the ATE, and figures of error curves.

    Returns sentences if there are too few points for a figure of curves, and if the truth moves in another
    direction than that in which a camera looks.
    """
    alignment = result.paths[0].ate.alignment
    truth = paths.compared_truth
    # In the axes of the first camera, the path can be seen from above.
    to_first_camera = np.linalg.inv(truth[0])
    aligned_paths = {}
    for name, poses in paths.estimates.items():
        aligned, _ = align(truth, poses, alignment)
        aligned_paths[name] = to_first_camera @ aligned
    figure = trajectories_figure({f"{paths.name}\n{alignment.words}": (truth, aligned_paths)})
    write_atomic(folder / f"trajectory_{slug(paths.name)}.png", png(figure))
    sentences = _write_curves(folder, paths.name, result)
    axis = unusual_axis(paths.truth) if paths.truth_from_outside else ""
    if axis:
        direction = _other_motion(axis).direction
        sentences.append(
            f"warning: {paths.name}: the true poses move along their own {axis} axis rather than along +z, "
            f"in which a camera looks: unless the camera moved {direction}, the picture of the paths is in "
            "other axes than it says."
        )
    return sentences


def _write_curves(folder: Path, name: str, result: Evaluation) -> list[str]:
    """Write figures of errors by length and by speed; return a sentence on those with too few points."""
    missing = []
    for by, least in MIN_CURVE_POINTS.items():
        curves = {path.name: path.kitti.curve(by, result.protocol.lengths) for path in result.paths}
        if max(map(len, curves.values())) < least:
            missing.append(by)
            continue
        figure = error_curves_figure(name, by, curves)
        write_atomic(folder / f"errors_{slug(name)}_by_{by}.png", png(figure))
    if not missing:
        return []
    by_words = " and ".join(missing)
    return [f"{name}: no figure of errors by {by_words}, since too few sub-sequences differ in {by_words}."]


def write_picture_without_truth(folder: Path, paths: PathsWithoutTruth) -> None:
    """Write a figure of the paths from above at their common frames, all from the same first pose."""
    from_start = {name: from_first(poses) for name, poses in paths.common.items()}
    title = f"{paths.name}\nno ground truth; all paths begin at the same pose"
    if not paths.is_all_common:
        title += f"\nonly the {paths.common_count} poses that all paths have"
    figure = trajectories_figure({title: (None, from_start)})
    write_atomic(folder / f"trajectory_{slug(paths.name)}.png", png(figure))
