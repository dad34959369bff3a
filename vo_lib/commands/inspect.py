"""`vo list` and `vo check`."""

from __future__ import annotations

import argparse
import json
from typing import Any

from ..data.sequence import available
from .console import say, show_findings, show_table
from .environment import check


def add(commands: Any) -> None:
    """Declare `vo list` and `vo check`."""
    for name, command, text in (
        ("list", _list, "sequences found and where"),
        ("check", _check, "packages and data: what is there, what is missing"),
    ):
        parser = commands.add_parser(name, help=text)
        parser.add_argument("--json", action="store_true", help="print JSON")
        parser.set_defaults(command=command)


def _list(options: argparse.Namespace) -> int:
    found = {name: str(path or "drawn on first use") for name, path in available().items()}
    if options.json:
        print(json.dumps(found, indent=2))
        return 0
    show_table("", ["name", "folder"], [list(row) for row in found.items()], numbers=False)
    if not any(name.startswith("kitti/") for name in found):
        say("no KITTI sequences found; `vo check` says how to get them")
    return 0


def _check(options: argparse.Namespace) -> int:
    findings = check()
    if options.json:
        print(json.dumps([vars(finding) for finding in findings], indent=2))
    else:
        show_findings(findings)
    return 1 if any(finding.state == "problem" for finding in findings) else 0
