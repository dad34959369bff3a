"""`vo lab`."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..errors import DataError
from ..files import read_bytes, write_atomic
from .console import say
from .script import install

FIRST = "00_start_here.ipynb"
NOTEBOOKS = Path(__file__).resolve().parents[2] / "notebooks"
NOT_COPIED = {".ipynb_checkpoints", "__pycache__"}


def add(parser: argparse.ArgumentParser) -> None:
    """Declare `vo lab`."""
    parser.epilog = "example: vo lab -- --port 8889 --no-browser"
    text = "work in a copy: notebooks missing in DIR are copied there first"
    parser.add_argument("--copy", metavar="DIR", help=text)
    parser.add_argument("jupyter", nargs="*", metavar="-- …", help="options of JupyterLab's own")
    parser.set_defaults(command=_lab)


def _lab(options: argparse.Namespace) -> int:
    if not (NOTEBOOKS / FIRST).is_file():
        raise DataError(f"{FIRST} is missing: install the kit from its folder, {install()}", NOTEBOOKS)
    folder = NOTEBOOKS if options.copy is None else copy_notebooks(NOTEBOOKS, Path(options.copy))
    from jupyterlab.labapp import LabApp  # type: ignore[import-untyped]

    say(f"JupyterLab opens {folder / FIRST}; Ctrl-C twice ends it")
    LabApp.launch_instance([str(folder / FIRST), f"--ServerApp.root_dir={folder}", *options.jupyter])
    return 0


def copy_notebooks(source: Path, target: Path) -> Path:
    """Copy notebooks and pictures that `target` lacks, each whole; a file that the student changed stays.

    A file that is the beginning of its source was cut by a full disk or a kill, and is copied again.
    """
    for path in sorted(source.rglob("*")):
        if not path.is_file() or NOT_COPIED & {*path.parts}:
            continue
        place, content = target / path.relative_to(source), path.read_bytes()
        if not place.exists() or (content.startswith(old := read_bytes(place)) and old != content):
            place.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(place, content)
    return target.resolve()
