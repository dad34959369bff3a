"""Draw a data set of streets with vehicle boxes, in YOLO format.

examples:
  vo data make_detection_set data/street --jobs 2
  vo data make_detection_set data/small --train 500 --valid 50

The test split has the named scenes of the kit, which are not in the training
split. After an interruption, repeat the command to continue.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from training.street_set import DetectionSetConfig, write_street_set
from vo_lib.commands.common import parse_jobs
from vo_lib.commands.console import add_settings, from_options, print_wrapped, reporting


def add_options(parser: argparse.ArgumentParser) -> None:
    """Options of the script, one for every setting of the data set."""
    parser.add_argument("folder", type=Path, help="folder of the data set")
    parser.add_argument(
        "--jobs", default="1", metavar="N", help="number of processes at the same time; default 1"
    )
    add_settings(parser, DetectionSetConfig)


def run(options: argparse.Namespace) -> int:
    """Draw the missing images."""
    config = from_options(options, DetectionSetConfig)
    with reporting("drawing streets") as report:
        write_street_set(options.folder, config, parse_jobs(options.jobs), report)
    print_wrapped(f"written to {options.folder}")
    return 0
