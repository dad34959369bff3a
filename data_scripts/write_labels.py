"""Keep a detector's boxes as label files beside the images.

examples:
  vo data write_labels kitti/07 --model yolov8n.onnx
  vo data write_labels synthetic/traffic --model street --out runs/traffic_labels

A call that was stopped goes on where it was. The folder's detector.json records the model's SHA-256.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from vo_lib.commands.common import add_cache, open_with_bar
from vo_lib.commands.console import reporting, say
from vo_lib.commands.scripts import run_script
from vo_lib.commands.setting_options import add_settings, from_options
from vo_lib.detection.labels import RECORD, write_label_folder
from vo_lib.detection.settings import DetectorConfig
from vo_lib.detection.yolo import PROVIDERS


def add_options(parser: argparse.ArgumentParser) -> None:
    """Options: every setting of the detector has one."""
    parser.add_argument("sequence", help="a KITTI-layout folder, or a name from `vo list`")
    parser.add_argument("--model", required=True, help="street, a fetched detector's name, or an ONNX file")
    parser.add_argument("--out", type=Path, metavar="DIR", help="default: labels in the sequence's folder")
    parser.add_argument("--replace", action="store_true", help="remove labels that were made otherwise")
    parser.add_argument("--provider", default="cpu", choices=list(PROVIDERS), help="default cpu")
    add_cache(parser)
    add_settings(parser, DetectorConfig)


def run(options: argparse.Namespace) -> int:
    """Detect in the frames that lack a label file."""
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
    return 0


if __name__ == "__main__":
    sys.exit(run_script(sys.modules[__name__]))
