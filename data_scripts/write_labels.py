"""Write a detector's boxes as label files of a sequence.

examples:
  vo data write_labels kitti/07 --model yolov8n.onnx
  vo data write_labels synthetic/traffic --model street --out labels

After an interruption, repeat the command to continue. The file detector.json
in the folder contains the model's SHA-256. With --replace, only the frames'
label files of another detector are replaced; every other file is kept, and the
folder of a sequence or of a run is refused.
"""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path

from vo_lib.commands.common import add_cache, open_with_bar
from vo_lib.commands.console import (
    add_option,
    add_settings,
    continues_when_repeated,
    from_options,
    option_values,
    print_wrapped,
    reporting,
)
from vo_lib.commands.vehicle_boxes import naming_classes, warn_without_vehicles
from vo_lib.config import SETTINGS
from vo_lib.data.label_names import DETECTOR_RECORD
from vo_lib.detection.label_folders import write_label_folder
from vo_lib.detection.settings import DetectorConfig
from vo_lib.detection.yolo import PROVIDERS

CLASSES = SETTINGS["filter.classes"]


def add_options(parser: argparse.ArgumentParser) -> None:
    """Options of the script, one for every setting of the detector."""
    parser.add_argument("sequence", help="a name from `vo list`, or a folder in KITTI's layout")
    parser.add_argument("--model", required=True, help="`street`, a downloaded model, or an ONNX file")
    text = "label folder; default: labels in the sequence's folder"
    parser.add_argument("--out", type=Path, metavar="DIR", help=text)
    parser.add_argument("--replace", action="store_true", help="replace labels of another detector")
    parser.add_argument(
        "--provider", default="cpu", choices=list(PROVIDERS), help="where the detector runs; default cpu"
    )
    add_cache(parser)
    add_settings(parser, DetectorConfig)
    add_option(parser, CLASSES, "classes")


def run(options: argparse.Namespace) -> int:
    """Detect vehicles in the frames without a label file."""
    config = from_options(options, DetectorConfig)
    classes = option_values(options, [CLASSES]).get(CLASSES.name, CLASSES.default)
    sequence = open_with_bar(options.sequence, options.cache)
    folder = options.out or sequence.folder / "labels"
    with (
        reporting(f"detecting vehicles in {sequence.name}") as report,
        continues_when_repeated(),
        naming_classes("--classes {}"),
    ):
        count = write_label_folder(
            sequence,
            options.model,
            config,
            folder,
            classes=classes,
            provider=options.provider,
            replace=options.replace,
            progress=report,
        )
    warn_without_vehicles(dataclasses.replace(sequence, labels=folder))
    print_wrapped(
        f"{folder}: {len(sequence)} frames, {count} of them new; {DETECTOR_RECORD} describes the model"
    )
    return 0
