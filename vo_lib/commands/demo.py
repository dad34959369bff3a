"""`vo demo`: a short `vo reproduce` on a drawn street, as evidence for the paper's claim."""

from __future__ import annotations

import argparse
import shlex

from ..data.catalogue import DRAWING_PROCESSES
from . import common, reproduce
from .console import print_lines, steps

# Moving vehicles fill the images of this street, so the removal has a clear effect.
OPTIONS = ["--sequences", "synthetic/jam", "--variant", "published", "--lengths", "50", "--seeds", "3"]
FOLDER = "runs/demo"
NEXT_STEPS = {
    "vo lab": "the course: notebooks that build the method step by step",
    "vo reproduce --sequences synthetic/parked --variant published --seeds 1 --out runs/parked": (
        "a street of parked cars"
    ),
    "vo list": "the other streets, and the KITTI sequences on this machine",
    "vo run PATH --out runs/mine": "a folder of your own in KITTI's layout",
    "vo check": "missing data and packages, with the commands that install them",
}
CLOSING_REMARKS = (
    "Where all vehicles are parked, removal costs the published method good features and gains nothing.",
    "These numbers are means over three seeds; the table in the README has means over five seeds.",
)


def add(parser: argparse.ArgumentParser) -> None:
    """Declare `vo demo`."""
    parser.epilog = f"equivalent to: vo reproduce {shlex.join(_words(FOLDER))}"
    parser.add_argument(
        "--out", default=FOLDER, metavar="DIR", help="folder for the results; default %(default)s"
    )
    common.add_cache(parser)
    parser.set_defaults(command=_demo)


def _words(folder: str) -> list[str]:
    """The options of `vo reproduce` for results in a folder."""
    return [*OPTIONS, "--jobs", str(DRAWING_PROCESSES), "--out", folder, "--fresh"]


def _demo(options: argparse.Namespace) -> int:
    """Call `vo reproduce` and return its exit code; then say what to do next."""
    parser = argparse.ArgumentParser()
    reproduce.add(parser)
    words = _words(options.out)
    line = f"vo reproduce {shlex.join(words)}"
    # argparse keeps an attribute that is there already: so the command in the report has no --cache.
    arguments = parser.parse_args(words, argparse.Namespace(line=line, cache=options.cache))
    code = reproduce.reproduce(arguments, *CLOSING_REMARKS)
    print_lines("\nWhat next:" + steps(NEXT_STEPS))
    return code
