"""`vo list`."""

from __future__ import annotations

import argparse

from ..data.catalogue import KITTI, available
from .console import say, show_table


def add(parser: argparse.ArgumentParser) -> None:
    """Declare `vo list`."""
    parser.set_defaults(command=_list)


def _list(options: argparse.Namespace) -> int:
    rows = [[name, str(path or "drawn on first use")] for name, path in available().items()]
    show_table("", ["name", "folder"], rows, numbers=False)
    if not any(name.startswith(KITTI) for name, _ in rows):
        say("no KITTI sequences found; `vo check` says how to get them")
    return 0
