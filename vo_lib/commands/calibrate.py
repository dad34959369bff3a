"""`vo calibrate`."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from ..beyond.calibration import require_same_camera
from ..config import Config, preset
from ..core.files import write_result
from ..data.stereo_check import doubts
from ..runs.runner import run
from .common import add_cache, add_sequence, open_with_bar, require_place
from .console import reporting, say, tell


def add(parser: argparse.ArgumentParser) -> None:
    """Declare `vo calibrate`."""
    parser.epilog = (
        "example: vo calibrate kitti/00 kitti/01 --out calibration.json, "
        "then vo run kitti/02 --calibration calibration.json --out runs/02"
    )
    add_sequence(parser, "sequences", "sequences of one stereo camera, as `vo run` takes them", nargs="+")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="a file, ending in .json")
    add_cache(parser)
    parser.set_defaults(command=_calibrate)


def _calibrate(options: argparse.Namespace) -> int:
    require_place(options.out, ".json")
    config = preset("solution_selection")
    assert isinstance(config, Config)
    sequences = [open_with_bar(name, options.cache) for name in options.sequences]
    for other in sequences[1:]:
        require_same_camera(sequences[0].camera, other.camera, other.name)
    known = None
    for sequence in sequences:
        with reporting(sequence.name) as report:
            result = run(replace(sequence, calibration=known), config, report)
        known = result.calibration
        assert known is not None
        for sentence in (*result.doubts, *doubts(sequence, result.matches_per_frame)):
            tell(f"warning: {sequence.name}: {sentence}")
        tell(f"after {sequence.name}: {known.in_words(config.calibration)}")
    assert known is not None
    write_result(options.out, known.to_json())
    say(f"written to {options.out}")
    return 0
