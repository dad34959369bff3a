"""`vo run`: one method on one sequence."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

from .. import settings
from ..config import SETTINGS, change, preset
from ..detection.label_folders import detection_record
from ..detection.settings import DetectorConfig
from ..errors import DataError
from ..evaluation.kitti_errors import suitable_protocol
from ..evaluation.path_errors import evaluate
from ..evaluation.path_facts import path_length
from ..files import write_atomic
from ..geometry.result import Flag
from ..geometry.types import Array
from ..kit.settings import KitConfig
from ..loops.settings import LoopConfig
from ..report.blocks import USED_BY_LOOPS, settings_of
from ..report.compare import error_tables
from ..report.film import FILM_ENDING, Film, film_frames, refuse_foreign_film
from ..report.page import format_number
from ..report.plots import png, trajectories_figure
from ..runs.folder import (
    CONFIG,
    LOOPS,
    LOOPS_POSES,
    PICTURE,
    RUN_FILES,
    changed_files,
    is_as_written,
    is_finished,
    read_config,
    refuse_foreign_files,
    run_folder,
)
from ..runs.identity import run_identity
from ..runs.jobs import refuse_another, run_once
from ..runs.match_cache import CachedMatches
from ..runs.run_quality import path_lost, warnings_of
from . import close_loops, common, vehicle_boxes
from .console import (
    add_option,
    from_options,
    print_notes,
    print_warnings,
    print_wrapped,
    reporting,
    show_report_table,
    show_table,
)

if TYPE_CHECKING:
    from ..data.sequence import Sequence
    from ..kit.calibration import Calibration
    from ..loops.graph import LoopClosure
    from ..paper.settings import MethodConfig
    from ..runs.drive import Run

FLAG_MEANINGS = {
    Flag.STANDSTILL: "hardly any optical flow, so the camera stands still",
    Flag.FEW_MATCHES: "too few matches, so an earlier motion is repeated",
    Flag.NO_MOTION: "no motion with enough inliers, so an earlier motion is repeated",
    Flag.CONTRADICTS_STEREO: "the motion does not fit the depths of the stereo pairs",
    Flag.FILTER_OFF: "too few features would remain, so none is removed in boxes",
    Flag.PRIOR_DROPPED: "another solution is clearly better than those near the previous essential vector",
}
BOX_SETTINGS = ("filter.margin", "filter.classes", "filter.score")  # those that change the boxes of a film
DETECTOR = "detector."  # how the names of the detector's settings begin
DETECTOR_SETTINGS = settings.declared(DetectorConfig, DETECTOR)


def add(parser: argparse.ArgumentParser) -> None:
    """Declare `vo run`."""
    parser.epilog = "example: vo run kitti/07 --out runs/07 --selection.sets 100"
    option = parser.add_argument
    option(
        "sequence", nargs="?", help="a name from `vo list`, such as kitti/07, or a folder in KITTI's layout"
    )
    common.add_method(parser)
    common.add_part(parser)
    vehicle_boxes.add_detector(parser)
    option("--out", metavar="DIR", help="folder for the results; if it has this run already, it is only read")
    option("--fresh", action="store_true", help="compute the run again, even if the folder has it")
    text = (
        "start from the errors in a calibration.json (variant kit); with --calibration.estimate off, they "
        "stay as they are"
    )
    option("--calibration", type=Path, metavar="FILE", help=text)
    common.add_cache(parser)
    text = "store the matches in the cache and, the next time, read them there"
    option("--keep-matches", action="store_true", help=text)
    text = f"draw a film ({FILM_ENDING}) of features, boxes and path; a report shows the films of its runs"
    option("--video", type=Path, metavar="FILE", help=text)
    close_loops.add_loops(parser)
    text = "list the options for all thresholds; they override --config"
    option("--help-settings", action="store_true", help=text)
    for item in [*SETTINGS.values(), *DETECTOR_SETTINGS, *close_loops.LOOP_SETTINGS]:
        add_option(parser, item, item.name, shown=False)  # not in the short help
    parser.set_defaults(command=_run)


def _run(options: argparse.Namespace) -> int:
    """Do the run, or read it from its folder; print its errors, and draw its path and its film."""
    method, base = common.read_method(options)
    if options.help_settings:
        return _print_settings_page(base)
    config, given = _with_typed_settings(base, options)
    _refuse_unused(options, method, config, given)
    _refuse_unused_of_file(options, method, config, given)
    common.require_drawing()
    loop_config = from_options(options, LoopConfig, close_loops.PREFIX)
    _check_options(options)
    calibration = _read_calibration(options, config)
    detector_config = from_options(options, DetectorConfig, DETECTOR)
    sequence = common.open_with_bar(options.sequence, options.cache, options)
    label = f"{sequence.name}, {method}, {config.variant}"
    with run_folder(options.out) as folder:
        changed = _check_folder(folder, options)
        if options.detector is not None and not options.fresh and is_finished(folder):
            # Another run is refused before the detector works for minutes.
            identity = run_identity(sequence, config, method, calibration)
            refuse_another(folder, identity, _detection_record(options, config, detector_config))
        sequence = _with_boxes(sequence, options, method, config, detector_config)
        matches = CachedMatches(sequence, config, options.cache) if options.keep_matches else None
        with reporting(label) as report:
            result, read_back = run_once(
                folder,
                sequence,
                config,
                method,
                matches=matches,
                calibration=calibration,
                fresh=options.fresh,
                progress=report,
            )
        closure = _close_loops(folder, result, loop_config) if options.loops else None
        paths, loop_pairs = _paths_and_loops(result, method, closure)
        picture = trajectories_figure({label: (sequence.truth, paths)}, loop_pairs)
        write_atomic(folder / PICTURE, png(picture))
    _print_result(result, method, paths)
    if closure is not None:
        print_wrapped(f"loops closed: {len(loop_pairs)} (not in the paper); see {LOOPS_POSES} and {LOOPS}")
    print_wrapped(f"written to {folder}")
    if options.video is not None:
        film = Film(options.video, result, label, loop_pairs, method)
        common.draw_with_bar(film, film_frames(result, matches, calibration))
        print_wrapped(f"film: {options.video}")
    if read_back:
        print_wrapped("The folder contains this run already; --fresh repeats the run.")
    elif changed:
        print_wrapped(f"note: {common.changed_words(changed)} in {folder}, so the run was computed again")
    return 0


def _detection_record(
    options: argparse.Namespace, config: MethodConfig, detector_config: DetectorConfig
) -> dict[str, Any]:
    """The record of --detector with the settings of this run (`label_folders.detection_record`)."""
    return detection_record(options.detector, detector_config, config.filter.classes, options.provider)


def _check_folder(folder: Path, options: argparse.Namespace) -> list[str]:
    """The files of a finished run in the folder that were changed since, so that it is computed again.

    Raises `DataError` for files of somebody else, and if the run would replace a file that it reads.
    """
    refuse_foreign_files(folder, options.fresh)
    changed = [] if options.fresh else changed_files(folder)
    if options.fresh or changed or not is_finished(folder):
        _refuse_to_replace_input(options)
    return changed


def _close_loops(folder: Path, result: Run, loop_config: LoopConfig) -> LoopClosure:
    """Find and close the loops of a run; its folder gets the corrected path and the list of loops."""
    compared = close_loops.find_loops_with_bar(result.sequence, result.config, loop_config)
    return close_loops.close_run(folder, result.sequence, result.poses, compared, loop_config)


def _paths_and_loops(
    result: Run, method: str, closure: LoopClosure | None
) -> tuple[dict[str, Array], list[tuple[int, int]]]:
    """The paths to draw and compare, by name, and the pairs of frames between which a loop was closed."""
    paths = {method: result.poses}
    if closure is None:
        return paths, []
    paths[close_loops.CLOSED_NAME] = closure.poses
    loops = closure.loops
    return paths, list(zip(loops.first_frame.tolist(), loops.second_frame.tolist(), strict=True))


def _with_typed_settings(base: MethodConfig, options: argparse.Namespace) -> tuple[MethodConfig, list[str]]:
    """The settings with those that were typed as options, and the names of the latter."""
    config = base
    given = []
    for item in settings_of(base).values():
        text = getattr(options, item.name)
        if text is not None:
            config = change(config, item.name, item.parse(text))
            given.append(item.name)
    return config, given


def _with_boxes(
    sequence: Sequence,
    options: argparse.Namespace,
    method: str,
    config: MethodConfig,
    detector_config: DetectorConfig,
) -> Sequence:
    """The sequence with the boxes of --detector if the option is present; notes on its boxes are printed."""
    what_remains = "; only a film shows the boxes"
    vehicle_boxes.note_unused_boxes(options, [config], f"{method} does not use", what_remains)
    sequence = vehicle_boxes.with_detected_boxes(sequence, options, detector_config, config.filter.classes)
    print_warnings(vehicle_boxes.warnings_without_boxes([(method, sequence, config)]))
    print_notes(vehicle_boxes.remarks_on_labels([(sequence, config)], vehicle_boxes.TYPED_CLASSES))
    return sequence


def _print_result(result: Run, method: str, paths: dict[str, Array]) -> None:
    """Print errors, removals, flags, time and warnings of a run; `paths` : those with errors, by name."""
    sequence = result.sequence
    title = f"{sequence.name}, {method}, {result.config.variant}, {len(result.poses)} frames"
    if sequence.truth is None:
        print_wrapped(f"{title}: no errors, since the sequence has no ground truth")
    else:
        protocol = suitable_protocol(sequence.truth)
        errors = evaluate(sequence.truth, paths, protocol, sequence.times)
        for table in error_tables(title, errors, whole_truth=not sequence.is_part):
            show_report_table(table)
        print_wrapped(f"truth: {sequence.truth_file}")
    flags = sorted({flag for motion in result.motions for flag in motion.flags})
    show_table(["quantity", "value"], _quantities(result, flags))
    print_wrapped(*(f"{flag}: {FLAG_MEANINGS[flag]}." for flag in flags))
    if path_lost(result):
        missing = [motion.measured for motion in result.motions].count(False)
        print_wrapped(
            f"Tracking was lost: {missing} of {len(result.motions)} frames have no motion; see frames.csv."
        )
    print_warnings(warnings_of(result))


def _quantities(result: Run, flags: list[Flag]) -> list[list[str]]:
    """Rows of name and value: what a run did, apart from its errors; `flags` : those of its frames."""
    motions = result.motions
    rows = [
        ["length of the path", f"{path_length(result.poses):.1f} m"],
        ["matches per frame, median", format_number(result.matches_per_frame, 0)],
    ]
    removed = f"{100 * result.removed_share:.1f} %"
    if result.config.filter.uses_boxes:
        rows.append(["features removed in boxes", removed if result.sequence.labels else "no labels"])
    elif result.config.filter.rule != "none":  # `truth` of variant `kit`
        rows.append(["features removed as truly moving", removed])
    used = format_number(median(motion.used for motion in motions), 0)
    rows.append(["matches used per frame (after buckets), median", used])
    for flag in flags:
        count = sum(flag in motion.flags for motion in motions)
        rows.append([f"frames flagged {flag}", str(count)])
    calibration = result.calibration
    if isinstance(result.config, KitConfig) and calibration is not None and calibration.estimate.any():
        errors = calibration.describe(result.config.calibration)
        rows.append(["corrected calibration errors (± σ)", errors.replace("; ", "\n")])
    rows.append(["time per frame", f"{result.ms_per_frame:.1f} ms"])
    return rows


def _print_settings_page(config: MethodConfig) -> int:
    """Print the thresholds of the variant, the detector and the loops with their ranges and defaults."""
    usage = f"vo run … --variant {config.variant} [--SETTING X …]"
    page = argparse.ArgumentParser(usage=usage, add_help=False)
    for item in [*settings.declared(type(config)), *DETECTOR_SETTINGS, *close_loops.LOOP_SETTINGS]:
        add_option(page, item, item.name)
    page.print_help()
    return 0


def _check_options(options: argparse.Namespace) -> None:
    """Raise `DataError` for options that are missing, contradict each other, or name an unusable film."""
    required = {"a sequence (`vo list`)": options.sequence, "--out DIR": options.out}
    missing = [name for name, value in required.items() if value is None]
    if missing:
        # In "--cache kitti/07", the sequence has been taken for the folder.
        hint = "" if options.cache is None else f"; --cache takes a folder, here {options.cache}"
        raise DataError(f"missing: {' and '.join(missing)}{hint}")
    vehicle_boxes.check_options(options, [options.sequence])
    film = options.video
    if film is not None:
        folder = film.absolute().parent
        exists = folder.is_dir() or folder == Path(options.out).absolute()
        if film.suffix.lower() != FILM_ENDING or not exists:
            raise DataError(f"expected an existing folder and a name ending in {FILM_ENDING}", film)
        refuse_foreign_film(film)


def _read_calibration(options: argparse.Namespace, config: MethodConfig) -> Calibration | None:
    """The calibration of --calibration, or None; `DataError` for a variant that takes none."""
    if options.calibration is None:
        return None
    if config.variant == "published":
        raise DataError("--calibration: the paper uses calib.txt unchanged: add --variant kit")
    from ..kit.calibration import read_learnt_calibration

    return read_learnt_calibration(options.calibration)


def _refuse_unused(options: argparse.Namespace, method: str, config: MethodConfig, given: list[str]) -> None:
    """Raise `DataError` for a setting on the command line that has no effect on this run.

    A setting of the loops that has none only causes a note.
    """
    for item in DETECTOR_SETTINGS:
        if getattr(options, item.name) is not None and options.detector is None:
            raise DataError(f"--{item.name} has no effect without --detector")
    for item in close_loops.LOOP_SETTINGS:
        if getattr(options, item.name) is not None and not options.loops:
            print_wrapped(f"note: --{item.name} has no effect without --loops")
    for name in given:
        reason = _unused_because(options, config, name)
        if reason:
            raise DataError(f"--{name}: {method} does not use this setting, since {reason}")


def _refuse_unused_of_file(
    options: argparse.Namespace, method: str, config: MethodConfig, given: list[str]
) -> None:
    """Refuse settings of --config that are no defaults and have no effect on this run.

    In the file of a run, as the run wrote it, they only cause a note: such a file can always be repeated.
    """
    if options.config is None:
        return
    usual = preset(method, variant=config.variant)
    without_effect = []
    for item in settings.declared(type(config)):
        value = settings.value_of(config, item.name)
        is_usual = value in (item.default, settings.value_of(usual, item.name))
        if is_usual or item.name in given:
            continue
        reason = _unused_because(options, config, item.name)
        if reason:
            without_effect.append((item.name, settings.as_typed(value), reason))
    if not without_effect:
        return
    if not is_as_written(read_config(options.config)):
        name, _, reason = without_effect[0]
        raise DataError(f"{name}: {method} does not use this setting, since {reason}", options.config)
    words = ", ".join(f"{name} {value} (since {reason})" for name, value, reason in without_effect)
    print_wrapped(f"note: {options.config}: {method} does not use {words}")


def _unused_because(options: argparse.Namespace, config: MethodConfig, name: str) -> str:
    """Why a setting has no effect on this run; "" if it has one."""
    # Loops are closed with the settings reprojection.…, too, and a film shows the boxes of every rule.
    if options.loops and name.startswith(USED_BY_LOOPS):
        return ""
    if options.video is not None and name in BOX_SETTINGS:
        return ""
    return settings.unused_because(config, name)


def _refuse_to_replace_input(options: argparse.Namespace) -> None:
    """Raise `DataError` if the run would write its results over a file that it reads.

    The config.json of the folder may be read by --config: the run writes the same settings again.
    """
    results = {os.path.realpath(Path(options.out) / name) for name in RUN_FILES if name != CONFIG}
    for name in ("calibration", "masks"):
        path = getattr(options, name)
        if path is not None and os.path.realpath(path) in results:
            raise DataError(f"is read by --{name}, and the run would replace it: choose another --out", path)
