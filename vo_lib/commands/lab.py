"""`vo lab`."""

from __future__ import annotations

import argparse
import importlib.util
import shutil
import subprocess
import sys
from pathlib import Path

from ..core.errors import DataError
from .common import parse_whole
from .console import say
from .lab_html import write_pages
from .script import Ended, install, unbroken

FIRST = "00_start_here.ipynb"
NOTEBOOKS = Path(__file__).resolve().parents[2] / "notebooks"


def add(parser: argparse.ArgumentParser) -> None:
    """Declare `vo lab`."""
    parser.add_argument(
        "--copy", metavar="DIR", help="work in a copy: notebooks missing in DIR are copied there first"
    )
    parser.add_argument(
        "--port", default="8888", metavar="N", help="port of the server (default %(default)s)"
    )
    parser.add_argument(
        "--html",
        metavar="DIR",
        help="write all notebooks, executed, as pages into DIR, their pictures into DIR/slides; open nothing",
    )
    parser.add_argument("--no-browser", action="store_true", help="only start the server")
    parser.set_defaults(command=_lab)


def _lab(options: argparse.Namespace) -> int:
    folder = find_notebooks(NOTEBOOKS)
    places = [Path(place).resolve() for place in (options.copy, options.html) if place is not None]
    if len(set(places)) < len(places):
        raise DataError("--copy and --html: expected two folders")
    if options.copy is not None:
        folder = copy_notebooks(folder, Path(options.copy))
    if importlib.util.find_spec("jupyterlab") is None:
        raise DataError(f"JupyterLab is not installed: {install()}")
    port = parse_whole("--port", options.port, most=65535)
    if options.html is not None:
        write_pages(folder, Path(options.html))
        return 0
    say(f"JupyterLab opens {folder / FIRST}; Ctrl-C twice ends it")
    server: subprocess.Popen[bytes] | None = None
    while True:
        try:
            if server is None:
                with unbroken():
                    server = subprocess.Popen(command(folder, port, not options.no_browser))
            return server.wait()
        except KeyboardInterrupt as end:
            if server is None:
                raise
            # After Ctrl-C the server got the same signal: it asks, or ends.
            if isinstance(end, Ended):
                server.terminate()


def command(folder: Path, port: int, browser: bool) -> list[str]:
    """The program that serves a folder and opens the first notebook."""
    words = [sys.executable, "-m", "jupyterlab", str(folder / FIRST)]
    words += [f"--ServerApp.root_dir={folder}", f"--ServerApp.port={port}"]
    return words if browser else [*words, "--no-browser"]


def find_notebooks(folder: Path) -> Path:
    """The folder of notebooks; `DataError` where it does not hold the first one."""
    if not (folder / FIRST).is_file():
        raise DataError(
            f"the notebooks are missing: expected {FIRST} there. They lie beside the package in the kit's "
            "folder: install from there with pip install -r environment.txt",
            folder,
        )
    return folder


def copy_notebooks(source: Path, target: Path) -> Path:
    """Copy notebooks and pictures that `target` does not have yet; what is there stays as it is."""
    try:
        for path in sorted(source.rglob("*")):
            place = target / path.relative_to(source)
            if (
                path.is_file()
                and not {".ipynb_checkpoints", "__pycache__"} & {*path.parts}
                and not place.exists()
            ):
                place.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(path, place)
    except OSError as error:
        raise DataError(f"the notebooks cannot be copied: {error.strerror}", target) from None
    return target.resolve()
