"""Write YOLO label files of a sequence, with a detector: `labels/` beside the images.

examples:
  python write_labels.py kitti/07 --model yolov8n.onnx
  python write_labels.py synthetic/traffic --model street --out runs/traffic_labels --pictures runs/seen

A call that was stopped goes on where it was. The folder's detector.json records the model's SHA-256.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from data_scripts.training.detection_plots import detection_image
from vo_lib.commands.console import OneLineParser, reporting, say
from vo_lib.commands.script import guarded
from vo_lib.commands.setting_options import add_options, from_options
from vo_lib.config import DetectorConfig
from vo_lib.core.files import write_bytes_atomic
from vo_lib.core.types import Progress
from vo_lib.data.kitti import read_image
from vo_lib.data.sequence import Sequence, open_sequence
from vo_lib.detection.label_cache import RECORD, write_label_folder
from vo_lib.detection.yolo import PROVIDERS
from vo_lib.tables.plots import jpeg


def main(words: list[str] | None = None) -> int:
    """Run the script."""
    options = parser().parse_args(words)
    return guarded("write_labels.py", lambda: write(options))


def write(options: argparse.Namespace) -> int:
    """Detect in what is missing; draw if asked."""
    config = from_options(options, DetectorConfig)
    with reporting(f"drawing {options.sequence}") as report:
        sequence = open_sequence(options.sequence, cache=options.cache, progress=report)
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


def parser() -> argparse.ArgumentParser:
    """Options: every setting of the detector has one."""
    made = OneLineParser(
        prog="write_labels.py", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    made.add_argument("sequence", help="a KITTI-layout folder, or a name from `vo list`")
    made.add_argument("--model", required=True, help="street, a fetched detector's name, or an ONNX file")
    made.add_argument("--out", type=Path, metavar="DIR", help="default: labels in the sequence's folder")
    made.add_argument("--replace", action="store_true", help="remove labels that were made otherwise")
    made.add_argument("--pictures", type=Path, metavar="DIR", help="draw each frame with its boxes too")
    made.add_argument("--provider", default="cpu", choices=list(PROVIDERS), help="default cpu")
    made.add_argument("--cache", type=Path, metavar="DIR", help="where drawn scenes are kept")
    add_options(made, DetectorConfig)
    return made


def draw_all(sequence: Sequence, folder: Path, progress: Progress) -> None:
    """A JPEG of each left image with its boxes."""
    folder.mkdir(parents=True, exist_ok=True)
    for index, frame in enumerate(sequence.frames):
        image = read_image(sequence.folder / "image_0" / f"{frame}.png")
        write_bytes_atomic(folder / f"{frame}.jpg", jpeg(detection_image(image, sequence.boxes(index))))
        progress(index + 1, len(sequence))


if __name__ == "__main__":
    sys.exit(main())
