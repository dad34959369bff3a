"""`vo lab`."""

from __future__ import annotations

import argparse
import json
import os
import re
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from typing import Any

from ..errors import DataError
from ..files import read_bytes, read_mapping, write_atomic
from .console import say
from .script import install

FIRST = "00_start_here.ipynb"
NOTEBOOKS = Path(__file__).resolve().parents[2] / "notebooks"
COURSE = "stereo-vo-course"  # the folder in the user's home, and JupyterLab's workspace
COPIED = ".copied.json"  # in the folder of the course: digest of each file as it was copied, by name
NOT_COPIED = {".ipynb_checkpoints", "__pycache__", "my_vo.py", "my_poses.txt", "my_path.mp4"}  # caches, work
FOR_TEACHERS = {"solutions", "teaching.md"}
TEACHERS_LINK = re.compile(rb"\[([^][]+)\]\((?:solutions/[^)]+|teaching\.md)\)")
NEWS = "@jupyterlab/apputils-extension:announcements"  # asks the reader about news, and PyPI about updates


def add(parser: argparse.ArgumentParser) -> None:
    """Declare `vo lab`."""
    parser.description = (
        f"Open the course in JupyterLab, in a copy: the folder {COURSE} in your home. Each use updates the "
        "copy. A file that you changed stays, and its new version comes beside it with .new in its name; "
        "running a notebook is no change. A file that you deleted comes back."
    )
    parser.epilog = "example: vo lab -- --port 8889 --no-browser"
    parser.add_argument("--copy", metavar="DIR", help="the copy is DIR instead")
    parser.add_argument("--here", dest="copy", action="store_const", const=NOTEBOOKS, help="without a copy")
    parser.add_argument("--teacher", action="store_true", help="also worked answers and notes for teachers")
    parser.add_argument("jupyter", nargs="*", metavar="-- …", help="options of JupyterLab's own")
    parser.set_defaults(command=_lab)


def _lab(options: argparse.Namespace) -> int:
    if not (NOTEBOOKS / FIRST).is_file():
        raise DataError(f"{FIRST} is missing: install the kit from its folder, {install()}", NOTEBOOKS)
    folder = Path(os.path.abspath(options.copy or Path.home() / COURSE))
    if folder != NOTEBOOKS:
        copy_course(NOTEBOOKS, folder, options.teacher)
    from jupyterlab.labapp import LabApp  # type: ignore[import-untyped]

    say(f"the course is in {folder}; JupyterLab opens {FIRST}; Ctrl-C twice ends it")
    LabApp.serverapp_config = {"tornado_settings": {"page_config_hook": _without_news}}
    first = f"--LabApp.default_url=/lab/workspaces/{COURSE}/tree/{FIRST}"  # none of the reader's other tabs
    LabApp.launch_instance([f"--ServerApp.root_dir={folder}", first, *options.jupyter])
    return 0


def _without_news(handler: object, page: dict[str, Any]) -> dict[str, Any]:
    return {**page, "disabledExtensions": [*page["disabledExtensions"], NEWS]}


def copy_course(source: Path, target: Path, teacher: bool) -> None:
    """Bring the course in `target` up to date with `source`; a file that the reader changed stays.

    Changed is a file whose digest is neither noted in COPIED nor that of its source; its new version comes
    beside it, once, and a line says so. For students a link to a file for teachers becomes the command that
    copies the file. Raises `DataError` where the note is damaged or a file cannot be read or written.
    """
    note = target / COPIED
    copied = read_mapping(note, "digests of the files copied, by name") if note.exists() else {}
    left_out = NOT_COPIED if teacher else NOT_COPIED | FOR_TEACHERS
    for path in sorted(source.rglob("*")):
        name = place = path.relative_to(source).as_posix()
        if not path.is_file() or left_out & {*path.relative_to(source).parts}:
            continue
        whole = path.read_bytes()
        content = whole if teacher else TEACHERS_LINK.sub(rb"\1 (`vo lab --teacher`)", whole)
        versions = {new := _digest(content), _digest(whole)}
        while (file := target / place).exists():
            if (there := _digest(read_bytes(file))) in {copied.get(place), *versions}:
                break
            place = f"{place.removesuffix(path.suffix)}.new{path.suffix}"
        if place != name:
            if copied.get(name) in versions:
                continue
            say(f"{name} is kept as you changed it; its new version is {place}")
        if not file.exists() or there != new:
            file.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(file, content)
        copied[name] = copied[place] = new
    write_atomic(note, json.dumps(copied, indent=1) + "\n")


def _digest(content: bytes) -> str:
    """SHA-256 of a file's content; of a notebook's cells alone, as JupyterLab changes the rest by itself."""
    with suppress(ValueError, LookupError, TypeError):  # of other files
        cells = [(cell["cell_type"], "".join(cell["source"])) for cell in json.loads(content)["cells"]]
        content = json.dumps(cells).encode()
    return sha256(content).hexdigest()
