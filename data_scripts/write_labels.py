"""Keep a detector's boxes as label files beside the images.

examples:
  vo data write_labels kitti/07 --model yolov8n.onnx
  vo data write_labels synthetic/traffic --model street --out runs/traffic_labels --pictures runs/seen

A call that was stopped goes on where it was. The folder's detector.json records the model's SHA-256.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from vo_lib.commands.common import add_cache, open_with_bar
from vo_lib.commands.console import reporting, say
from vo_lib.commands.data import run_script
from vo_lib.commands.setting_options import add_settings, from_options
from vo_lib.config import DetectorConfig
from vo_lib.core.files import write_bytes_atomic
from vo_lib.core.matches import empty_matches
from vo_lib.core.types import Progress
from vo_lib.data.kitti import read_image
from vo_lib.data.sequence import Sequence, open_sequence
from vo_lib.detection.class_names import COCO
from vo_lib.detection.label_cache import RECORD, write_label_folder
from vo_lib.detection.yolo import PROVIDERS
from vo_lib.tables.plots import jpeg, match_image


def add_options(parser: argparse.ArgumentParser) -> None:
    """Options: every setting of the detector has one."""
    parser.add_argument("sequence", help="a KITTI-layout folder, or a name from `vo list`")
    parser.add_argument("--model", required=True, help="street, a fetched detector's name, or an ONNX file")
    parser.add_argument("--out", type=Path, metavar="DIR", help="default: labels in the sequence's folder")
    parser.add_argument("--replace", action="store_true", help="remove labels that were made otherwise")
    parser.add_argument("--pictures", type=Path, metavar="DIR", help="draw each frame with its boxes too")
    parser.add_argument("--provider", default="cpu", choices=list(PROVIDERS), help="default cpu")
    add_cache(parser)
    add_settings(parser, DetectorConfig)


def run(options: argparse.Namespace) -> int:
    """Detect in what is missing; draw if asked."""
    config = from_options(options, DetectorConfig)
    sequence = open_with_bar(options.sequence, options.cache)
    folder = options.out or sequence.folder / "labels"
    with reporting(f"detecting in {sequence.name}") as report:
        count = write_label_folder(
            sequence,
            options.model,
            config,
            folder,
            provider=options.provider,
            replace=options.replace,
            progress=report,
        )
    say(f"{folder}: {len(sequence)} frames, {count} of them detected now; {RECORD} records the model")
    if options.pictures:
        with reporting("drawing boxes") as report:
            draw_all(open_sequence(sequence.folder, folder), options.pictures, report)
        say(f"{options.pictures}: each frame with its boxes")
    return 0


def draw_all(sequence: Sequence, folder: Path, progress: Progress) -> None:
    """A JPEG of each left image with its boxes, above each its class and score."""
    folder.mkdir(parents=True, exist_ok=True)
    for index, frame in enumerate(sequence.frames):
        image, boxes = read_image(sequence.folder / "image_0" / f"{frame}.png"), sequence.boxes(index)
        names = [COCO[k] if k < len(COCO) else str(k) for k in boxes.class_id.tolist()]
        words = [f"{name} {score:.2f}" for name, score in zip(names, boxes.score, strict=True)]
        picture = match_image(image, empty_matches(), np.zeros(0, np.bool_), boxes, words=words)
        write_bytes_atomic(folder / f"{frame}.jpg", jpeg(picture))
        progress(index + 1, len(sequence))


if __name__ == "__main__":
    sys.exit(run_script(sys.modules[__name__]))
