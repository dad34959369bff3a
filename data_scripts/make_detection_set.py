"""Draw a data set of synthetic streets with vehicle boxes, in YOLO form.

examples:
  python make_detection_set.py data/street --jobs 2
  python make_detection_set.py data/small --train 500 --valid 50

The test split holds the kit's named scenes, which training never draws. A call that was stopped goes on.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from data_scripts.training.config import DetectionSetConfig
from data_scripts.training.street_set import write_street_set
from vo_lib.commands.common import parse_whole
from vo_lib.commands.console import OneLineParser, reporting, say
from vo_lib.commands.script import guarded
from vo_lib.commands.setting_options import add_options, from_options


def parser() -> argparse.ArgumentParser:
    """Options: every setting of the data set has one."""
    made = OneLineParser(
        prog="make_detection_set.py",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    made.add_argument("folder", type=Path, help="where the data set is written")
    made.add_argument("--jobs", default="1", metavar="N", help="processes that draw (default 1)")
    add_options(made, DetectionSetConfig)
    return made


def main(words: list[str] | None = None) -> int:
    """Run the script."""
    options = parser().parse_args(words)
    return guarded("make_detection_set.py", lambda: draw(options))


def draw(options: argparse.Namespace) -> int:
    """Draw what is missing."""
    config = from_options(options, DetectionSetConfig)
    with reporting("drawing streets") as report:
        write_street_set(options.folder, config, parse_whole("--jobs", options.jobs), report)
    say(f"written to {options.folder}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
