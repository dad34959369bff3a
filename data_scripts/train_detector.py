"""Train a small vehicle detector on a data set in YOLO form, and export it as ONNX (extra `[train]`).

examples:
  vo data train_detector data/street --out runs/street --one-class vehicle
  vo data train_detector roboflow/data.yaml --out runs/cars --epochs 400 --width 640 --height 192
  vo data train_detector data/street --out runs/more --one-class vehicle --start runs/street/detector.onnx

A training that was stopped goes on at its last whole epoch. The folder gets last.pt, curves.png and
detector.onnx, which `vo run --detector` and `vo data write_labels` take.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
from pathlib import Path

from training.assess import assess
from training.config import MODEL, TrainingConfig
from training.dataset import DetectionSet, open_set
from training.evaluated import refuse_evaluated
from vo_lib.commands.console import reporting, say, show_table
from vo_lib.commands.data import run_script
from vo_lib.commands.script import install
from vo_lib.commands.setting_options import add_settings, from_options
from vo_lib.core.errors import DataError
from vo_lib.detection.yolo_layout import LEAST_SIZE, MOST_SIZE


def add_options(parser: argparse.ArgumentParser) -> None:
    """Options: every setting of the training has one."""
    parser.add_argument("data", type=Path, help="folder with data.yaml, or that file")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the training")
    parser.add_argument("--one-class", metavar="NAME", help="take all classes for one of this name")
    parser.add_argument(
        "--start",
        type=Path,
        metavar="FILE",
        help="begin with the weights of another last.pt or detector.onnx",
    )
    parser.add_argument(
        "--export-size",
        type=int,
        metavar="PX",
        help="longer side of the images that the exported model is used with; default: --size",
    )
    parser.add_argument("--allow-evaluated", action="store_true", help="train on KITTI odometry images too")
    add_settings(parser, TrainingConfig)


def run(options: argparse.Namespace) -> int:
    """Train, export, and say how good the exported model is."""
    config = from_options(options, TrainingConfig)
    data = dataclasses.replace(open_set(options.data), merged=options.one_class)
    if not options.allow_evaluated:
        refuse_evaluated(path for part in data.images.values() for path in part)
    if options.export_size is not None and not LEAST_SIZE <= options.export_size <= MOST_SIZE:
        raise DataError(f"--export-size {options.export_size}: expected {LEAST_SIZE} to {MOST_SIZE} px")
    try:
        from training.folder import train_in
    except ImportError as error:
        raise DataError(f"{error.name} is missing: {install('train')}") from None
    with reporting(f"training, {config.epochs} epochs") as report:
        state = train_in(options.out, data, config, options.start, options.export_size or config.size, report)
    model = options.out / MODEL
    say(f"{model}: validation mAP50 {state.maps[-1]:.3f} after {state.epoch} epochs")
    report_quality(model, data)
    return 0


def report_quality(model: Path, data: DetectionSet) -> None:
    """A table of the exported model's quality on the test split, or the validation split without one."""
    split = "test" if data.images["test"] else "valid"
    heights = (16.0, 25.0, 32.0)
    with reporting(f"judging on {split}") as report:
        results = assess(model, data, split, heights, progress=report)
    rows = [
        [f"{r.min_height:g} px", str(r.vehicles), f"{r.map50:.3f}", f"{r.recall:.3f}", f"{r.precision:.3f}"]
        for r in results
    ]
    show_table(
        f"{split}: {results[0].images} images, IoU 0.5, score 0.25",
        ["vehicles at least", "how many", "mAP50", "recall", "precision"],
        rows,
    )


if __name__ == "__main__":
    sys.exit(run_script(sys.modules[__name__]))
