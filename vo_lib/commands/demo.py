"""`vo demo`: `vo reproduce` on one drawn street."""

from __future__ import annotations

import argparse

from ..data.catalogue import DRAWING_PROCESSES
from . import reproduce
from .console import say
from .script import steps

STREET = "synthetic/traffic"
NEXT_STEPS = {
    "vo list": "the other scenes and any KITTI sequences found",
    "vo run synthetic/jam --out runs/jam": "one method on another scene",
    "vo run PATH --out runs/mine": "a KITTI-layout folder of your own",
    "vo check": "what is missing for KITTI, and how to get it",
}


def add(parser: argparse.ArgumentParser) -> None:
    """Declare `vo demo`, which takes the options of `vo reproduce`."""
    reproduce.add(parser)
    parser.epilog = "example: vo demo --variant published. These are the options of `vo reproduce`."
    parser.set_defaults(command=_demo, sequences=STREET, out="runs/demo", fresh=True)
    parser.set_defaults(seeds="1", jobs=str(DRAWING_PROCESSES))


def _demo(options: argparse.Namespace) -> int:
    code = reproduce.reproduce(options)
    say("What next:" + steps(NEXT_STEPS))
    return code
