"""`vo lab`."""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path

from ..core.errors import DataError
from .console import say

FIRST = "00_start_here.ipynb"
NOTEBOOKS = Path(__file__).resolve().parents[2] / "notebooks"


def add(parser: argparse.ArgumentParser) -> None:
    """Declare `vo lab`."""
    parser.epilog = "example: vo lab -- --port 8889 --no-browser"
    parser.add_argument(
        "--copy", metavar="DIR", help="work in a copy: notebooks missing in DIR are copied there first"
    )
    parser.add_argument(
        "--html",
        metavar="DIR",
        help="write all notebooks, executed, as pages into DIR, their pictures into DIR/slides; open nothing",
    )
    parser.add_argument("jupyter", nargs="*", metavar="-- …", help="options of JupyterLab's own")
    parser.set_defaults(command=_lab)


def _lab(options: argparse.Namespace) -> int:
    if not (NOTEBOOKS / FIRST).is_file():
        raise DataError(
            f"the notebooks are missing: expected {FIRST} there. They lie beside the package in the kit's "
            "folder: install from there with pip install -r environment.txt",
            NOTEBOOKS,
        )
    places = [Path(place).resolve() for place in (options.copy, options.html) if place is not None]
    if len(set(places)) < len(places):
        raise DataError("--copy and --html: expected two folders")
    folder = NOTEBOOKS if options.copy is None else copy_notebooks(NOTEBOOKS, Path(options.copy))
    # Both are slow to import.
    if options.html is not None:
        from .lab_html import write_pages

        return min(write_pages(folder, Path(options.html)), 1)
    from jupyterlab.labapp import LabApp  # type: ignore[import-untyped]

    say(f"JupyterLab opens {folder / FIRST}; Ctrl-C twice ends it")
    LabApp.launch_instance([str(folder / FIRST), f"--ServerApp.root_dir={folder}", *options.jupyter])
    return 0


def copy_notebooks(source: Path, target: Path) -> Path:
    """Copy notebooks and pictures that `target` does not have yet; what is there stays as it is."""
    try:
        for path in sorted(source.rglob("*")):
            place = target / path.relative_to(source)
            made = {".ipynb_checkpoints", "__pycache__"} & {*path.parts}
            if path.is_file() and not made and not place.exists():
                place.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(path, place)
    except OSError as error:
        raise DataError(f"the notebooks cannot be copied: {error.strerror}", target) from None
    return target.resolve()
