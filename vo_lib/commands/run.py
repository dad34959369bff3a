"""`vo run`."""

from __future__ import annotations

import argparse
from typing import Any

from .. import settings
from ..config import METHODS, Config, preset
from ..console import reporting, show_run
from ..errors import DataError
from ..files import write_bytes_atomic
from ..plots import png, trajectory_figure
from ..results import run_folder, write_run
from ..runner import run
from .common import add_cache, open_with_bar


def add(commands: Any) -> None:
    """Declare `vo run`."""
    parser = commands.add_parser(
        "run",
        help="one run over one sequence",
        epilog="example: vo run kitti/07 --method feature_selection --out runs/07 --selection.sets 100",
    )
    parser.add_argument("sequence", help="a KITTI-layout folder, or a name from `vo list` such as kitti/07")
    parser.add_argument("--method", default="feature_selection", help=f"one of {', '.join(METHODS)}")
    parser.add_argument("--out", required=True, metavar="DIR", help="folder for poses, log, errors, picture")
    parser.add_argument("--frames", metavar="A:B", help="only the frames A … B-1, counted from 0")
    parser.add_argument("--labels", metavar="DIR", help="YOLO label files; default: labels/ in the sequence")
    add_cache(parser)
    add_settings(parser)
    parser.set_defaults(command=_run)


def add_settings(parser: argparse.ArgumentParser) -> None:
    """An option for every declared setting, in a group for each section."""
    group = None
    for item in settings.declared(Config):
        section = item.name.partition(".")[0] if "." in item.name else "run"
        if group is None or group.title != section:
            group = parser.add_argument_group(section)
        default = ",".join(map(str, item.default)) if isinstance(item.default, tuple) else item.default
        text = f"{item.text}; {item.describe()}; default {default}".replace("%", "%%")
        group.add_argument(f"--{item.name}", metavar="X", dest=item.name, help=text)


def config_from_options(options: argparse.Namespace) -> Config:
    """The preset of the method with the thresholds given on the command line."""
    config = preset(options.method)
    for item in settings.declared(Config):
        raw = getattr(options, item.name)
        if raw is not None:
            config = settings.replace(config, item.name, item.parse(raw))
    return config


def parse_frames(text: str, number: int) -> tuple[int, int]:
    """Start and stop of "A:B"; either may be left out."""
    start, colon, stop = text.partition(":")
    try:
        if not colon:
            raise ValueError
        return int(start or 0), int(stop or number)
    except ValueError:
        raise DataError(f"--frames {text!r}: expected A:B, two whole numbers") from None


def _run(options: argparse.Namespace) -> int:
    config = config_from_options(options)
    sequence = open_with_bar(options.sequence, options.cache, options.labels)
    if options.frames is not None:
        sequence = sequence.part(*parse_frames(options.frames, len(sequence)))
    label = f"{sequence.name}, {options.method}"
    with run_folder(options.out) as folder:
        with reporting(label) as report:
            result = run(sequence, config, report)
        errors = write_run(folder, result, options.method)
        picture = trajectory_figure(label, sequence.truth, {options.method: result.poses})
        write_bytes_atomic(folder / "trajectory.png", png(picture))
    show_run(result, options.method, errors, folder)
    return 0
