"""`vo run`."""

from __future__ import annotations

import argparse
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..beyond.calibration import read_calibration
from ..config import Config, DetectorConfig, change, preset
from ..core import settings
from ..core.errors import DataError
from ..core.files import claim, write_result
from ..data.stereo_check import doubts
from ..detection.label_cache import detected_sequence
from ..runs.jobs import run_once
from ..runs.match_cache import CachedMatches, match_folder
from ..runs.results import evaluate_run, run_folder
from ..runs.runner import Run
from ..tables.film import CODES, Film, shown_frames
from ..tables.plots import png, trajectories_figure
from ..tables.view import View
from . import common
from .console import reporting, say, show_run, tell
from .setting_options import add_option, given

DETECTOR = "detector."
PICTURE = "trajectory.png"


def add(parser: argparse.ArgumentParser) -> None:
    """Declare `vo run`."""
    parser.epilog = (
        "example: vo run kitti/07 --method feature_selection --out runs/07 --selection.sets 100. "
        "--help-settings lists the thresholds."
    )
    common.add_sequence(parser, "sequence", "a KITTI-layout folder, or a name from `vo list`: kitti/07")
    common.add_method(parser)
    common.add_config(parser, "thresholds given here go before its own")
    common.add_variant(parser, "kit")
    parser.add_argument(
        "--out",
        required=True,
        metavar="DIR",
        help="folder for poses, log, errors, picture; a run finished there is read back",
    )
    common.add_part(parser)
    common.add_detector(
        parser, "find the vehicles: street (shipped, for drawn streets), a fetched model or an ONNX file"
    )
    parser.add_argument(
        "--calibration",
        type=Path,
        metavar="FILE",
        help="start from a calibration.json of `vo run` or `vo calibrate`; it is held with "
        "--calibration.estimate off",
    )
    text = (
        f"keep the matches and use those kept, in DIR (default {match_folder(None).parent}); scenes that "
        "are drawn are kept there too"
    )
    parser.add_argument("--cache", nargs="?", const="", metavar="DIR", help=text.replace("%", "%%"))
    parser.add_argument(
        "--video",
        type=Path,
        metavar="FILE",
        help="a film (.mp4, .avi): features, boxes, path and errors; goes through the frames once more",
    )
    parser.add_argument(
        "--view",
        type=Path,
        metavar="FILE",
        help="a page (.html) that shows path and points in three dimensions",
    )
    parser.add_argument("--fresh", action="store_true", help="start anew whatever the folder holds")
    parser.add_argument(
        "--help-settings", action=SettingsHelp, nargs=0, help="the thresholds, which are options too"
    )
    for item in every_setting():  # not in the short help
        add_option(parser, item, item.name, shown=False)
    parser.set_defaults(command=_run)


def every_setting() -> list[settings.Setting]:
    """The method's thresholds, then the detector's."""
    return [*settings.declared(Config), *settings.declared(DetectorConfig, DETECTOR)]


class SettingsHelp(argparse.Action):
    """Print the thresholds with their ranges and defaults, and end."""

    def __call__(self, parser: argparse.ArgumentParser, *about: Any) -> None:
        """In a page of their own."""
        page = argparse.ArgumentParser(prog=parser.prog, usage="vo run … [--SETTING X …]", add_help=False)
        for item in every_setting():
            add_option(page, item, item.name)
        page.print_help()
        parser.exit()


def _run(options: argparse.Namespace) -> int:
    config = common.read_settings(options) or preset(options.method, variant=options.variant)
    for name, value in given(options, settings.declared(Config)).items():
        config = change(config, name, value)
    if options.detector is not None and options.labels is not None:
        raise DataError("--labels and --detector: expected one of them, both give the boxes")
    common.require_place(options.video, *CODES)
    common.require_place(options.view, ".html")
    cache = Path(options.cache) if options.cache else None
    sequence = common.open_part(options, cache)
    if options.calibration is not None:
        if config.variant == "published":
            raise DataError("--calibration is the kit's own: the paper as published takes calib.txt as it is")
        known = read_calibration(options.calibration)
        known.check(sequence.camera)
        sequence = replace(sequence, calibration=known)
    common.warn_of_street(options.detector, sequence)
    matches = None
    label = f"{sequence.name}, {options.method}" + (", published" if config.variant == "published" else "")
    with run_folder(options.out, *() if options.fresh else (PICTURE,)) as folder, ExitStack() as stack:
        if options.detector is not None:  # it works ahead in threads of its own
            values = given(options, settings.declared(DetectorConfig, DETECTOR))
            found = DetectorConfig(**{name.removeprefix(DETECTOR): x for name, x in values.items()})
            boxes = detected_sequence(
                sequence, options.detector, found, provider=options.provider, cache=cache
            )
            sequence = stack.enter_context(boxes)
        if options.cache is not None:
            matches = CachedMatches(sequence, config.features, config.matching, cache)
        with reporting(label) as report:
            run = (folder, sequence, config, options.method)
            result, done_before = run_once(*run, matches=matches, fresh=options.fresh, progress=report)
        picture = trajectories_figure({label: (sequence.truth, {options.method: result.poses})})
        if options.fresh:
            claim(folder / PICTURE)
        write_result(folder / PICTURE, png(picture))
        if options.video is not None or options.view is not None:
            _draw_frames(result, label, options, matches)
    show_run(result, options.method, evaluate_run(result), folder)
    for kind, path in (("film", options.video), ("view", options.view)):
        if path is not None:
            say(f"{kind}: {path}")
    for sentence in doubts(sequence, result.matches_per_frame):
        tell(f"warning: {sentence}")
    if done_before:
        say("this run was finished before; --fresh does it again")
    return 0


def _draw_frames(result: Run, label: str, options: argparse.Namespace, matches: CachedMatches | None) -> None:
    """Go through the frames of the run once more, for a film of them and the page in three dimensions."""
    view = View(result, label)
    with reporting("drawing frames") as report, ExitStack() as stack:
        film = None if options.video is None else stack.enter_context(Film(options.video, result, label))
        for shown in shown_frames(result, matches):
            if film is not None:
                film.add(shown)
            if options.view is not None:
                view.add(shown)
            report(shown.index + 1, len(result.sequence))
    if options.view is not None:
        view.write(options.view)
