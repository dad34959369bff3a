"""Convert KITTI's object labels to a data set for train_detector.

examples:
  vo data kitti_to_yolo kitti/training data/cars \\
      --mapping train_mapping.txt --order train_rand.txt

Car and Van become car, Truck becomes truck, Tram becomes train; other objects
get no label. Images of the raw drives of the odometry sequences 00-10 are
skipped, and images of unknown origin are refused, because a detector makes
fewer errors on its training images. The files of --mapping and --order are in
the folder `mapping` of the object development kit.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from training.kitti_set import NAMES, check_origin, read_object_set, split, write_set
from vo_lib.commands.common import parse_whole
from vo_lib.commands.console import print_wrapped, reporting
from vo_lib.errors import DataError


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options."""
    parser.add_argument("kitti", type=Path, help="training folder of the object benchmark, with label_2")
    parser.add_argument("out", type=Path, help="folder of the data set")
    parser.add_argument("--mapping", type=Path, metavar="FILE", help="train_mapping.txt")
    parser.add_argument("--order", type=Path, metavar="FILE", help="train_rand.txt")
    parser.add_argument(
        "--valid", type=share, default=0.15, metavar="X", help="share of validation images; default 0.15"
    )
    parser.add_argument("--seed", default="0", metavar="N", help="seed of the split; default 0")
    text = "also use images of odometry sequences and of unknown drives"
    parser.add_argument("--allow-evaluated", action="store_true", help=text)


def run(options: argparse.Namespace) -> int:
    """Read the labels, skip images of evaluated sequences, write the data set."""
    images = read_object_set(options.kitti, options.mapping, options.order)
    allowed = check_origin(images, options.allow_evaluated)
    if len(allowed) < 2:
        raise DataError(f"{len(allowed)} images remain for training: expected two or more", options.kitti)
    parts = split(allowed, options.valid, parse_whole("--seed", options.seed, least=0))
    with reporting("writing the data set") as report:
        write_set(parts, options.out, report)
    kinds = [kind for image in allowed for kind in image.boxes.class_id.tolist()]
    counts = ", ".join(f"{kinds.count(k)} {name}" for k, name in enumerate(NAMES))
    sizes = f"{len(parts['train'])} images for training, {len(parts['valid'])} for validation"
    print_wrapped(f"{options.out}: {sizes}; {counts}")
    print_wrapped(f"{len(images) - len(allowed)} images of evaluated odometry sequences were skipped")
    return 0


def share(text: str) -> float:
    """A number between 0 and 1."""
    value = float(text)
    if not 0.0 < value < 1.0:
        raise ValueError
    return value
