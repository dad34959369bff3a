"""`vo calibrate`."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from ..beyond.calibration import require_same_camera
from ..config import Config, preset
from ..core.errors import DataError
from ..core.files import require_own, write_result
from ..data.stereo_check import doubts
from ..runs.runner import run
from ..tables.field_figure import field_figure
from ..tables.plots import png
from .common import add_cache, add_sequence, open_with_bar
from .console import reporting, say


def add(parser: argparse.ArgumentParser) -> None:
    """Declare `vo calibrate`."""
    parser.epilog = (
        "example: vo calibrate kitti/00 kitti/01 --out calibration.json, "
        "then vo run kitti/02 --calibration calibration.json --out runs/02"
    )
    add_sequence(parser, "sequences", "sequences of one stereo camera, as `vo run` takes them", nargs="+")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="a file, ending in .json")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="a picture (.png) of the errors")
    add_cache(parser)
    parser.set_defaults(command=_calibrate)


def _calibrate(options: argparse.Namespace) -> int:
    for path, ending in ((options.out, ".json"), (options.picture, ".png")):
        if path is not None and (path.suffix != ending or not path.parent.is_dir()):
            raise DataError(f"expected a name ending in {ending}, in a folder that exists", path)
        if path is not None:
            require_own(path)
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
            say(f"warning: {sequence.name}: {sentence}")
        say(f"after {sequence.name}: {known.in_words(config.calibration)}")
    assert known is not None
    write_result(options.out, known.to_json())
    if options.picture is not None:
        coefficients, _ = known.in_use(config.calibration)
        write_result(options.picture, png(field_figure(coefficients, known.camera)))
    say(f"written to {options.out}")
    return 0
