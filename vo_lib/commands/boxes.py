"""`vo boxes`."""

from __future__ import annotations

import argparse
from contextlib import nullcontext
from pathlib import Path

import numpy as np

from ..beyond.box_tracks import MOVING, PARKED, UNKNOWN, Judgement
from ..config import preset
from ..core.files import write_result
from ..data.sequence import Sequence
from ..runs.results import run_folder
from ..runs.runner import FoundMatches, make_odometry, single_threaded
from ..tables.plots import jpeg, match_image
from .common import add_cache, add_part, add_sequence, open_part
from .console import reporting, say, show_table

WORDS = {MOVING: "moves", PARKED: "parked", UNKNOWN: "unknown"}
COLUMNS = ["frame", "box: left, top,\nright, bottom", "score", "features", "step m", "m/s", "judged"]


def add(parser: argparse.ArgumentParser) -> None:
    """Declare `vo boxes`."""
    parser.epilog = (
        "example: vo boxes synthetic/traffic --frames 100:130 --out runs/boxes. In the pictures boxes "
        "that move have a whole line, parked ones a dashed one; removed features are orange."
    )
    add_sequence(parser, "sequence", "a KITTI-layout folder, or a name from `vo list`")
    add_part(parser)
    parser.add_argument("--out", metavar="DIR", help="folder for a picture of every frame")
    add_cache(parser)
    parser.set_defaults(command=_boxes)


def _boxes(options: argparse.Namespace) -> int:
    sequence = open_part(options, options.cache)
    pictures = [f"{frame}.jpg" for frame in sequence.frames[1:]]
    with nullcontext() if options.out is None else run_folder(options.out, *pictures) as folder:
        rows = _judge(sequence, folder)
    show_table(f"{sequence.name}: boxes judged by the features in them", COLUMNS, rows)
    if options.out is not None:
        say(f"pictures in {options.out}")
    return 0


def _judge(sequence: Sequence, folder: Path | None) -> list[list[str]]:
    """Run the method over the sequence; a row for each box, and a picture of each frame into the folder."""
    config = preset("moving_selection")
    odometry = make_odometry(sequence.camera, config)
    rows: list[list[str]] = []
    with single_threaded(), reporting(sequence.name) as report:
        for index, (matches, _) in enumerate(FoundMatches(sequence, config.features, config.matching)):
            report(index + 1, len(sequence))
            if index == 0:
                odometry.start(sequence.boxes(0))
                continue
            odometry.step(matches, sequence.boxes(index))
            assert odometry.filtered is not None
            judgement, keep = odometry.filtered.judgement, odometry.filtered.keep
            assert judgement is not None
            seconds = float(sequence.times[index] - sequence.times[index - 1])
            rows += [[sequence.frames[index], *row] for row in _rows(judgement, seconds)]
            if folder is not None:
                left, _ = sequence.stereo(index)
                words = [f"{row[1]} {row[-1]}" for row in _rows(judgement, seconds)]
                picture = match_image(left, matches, keep, judgement.boxes, judgement.state, words)
                write_result(folder / f"{sequence.frames[index]}.jpg", jpeg(picture))
    return rows


def _rows(judgement: Judgement, seconds: float) -> list[list[str]]:
    """The columns after the frame, for each box."""
    boxes, rows = judgement.boxes, []
    for k, (xyxy, state) in enumerate(zip(boxes.xyxy, judgement.state.tolist(), strict=True)):
        step = float(np.linalg.norm(judgement.step[k]))
        seen = [f"{step:.2f}", f"{step / seconds:.1f}"] if np.isfinite(step) and seconds > 0 else ["–", "–"]
        place = ", ".join(str(round(x)) for x in xyxy.tolist())
        rows.append([place, f"{boxes.score[k]:.2f}", str(judgement.matches[k]), *seen, WORDS[state]])
    return rows
