"""`vo lab`: the course in JupyterLab, in a copy of the notebooks."""

from __future__ import annotations

import argparse
import json
import os
import re
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from typing import Any

from ..checkout import folder_of_checkout
from ..errors import DataError
from ..files import read_bytes, read_mapping, write_atomic
from .console import install, print_lines

FIRST_NOTEBOOK = "00_start_here.ipynb"
COURSE = "stereo-vo-course"  # name of the folder in the user's home and of JupyterLab's workspace
DIGESTS_FILE = ".copied.json"  # in the course's folder: digest of each copied file by name
CACHES = {".ipynb_checkpoints", "__pycache__"}
WORK = {"my_vo.py", "my_poses.txt", "my_path.webm"}  # files that the notebooks write
FOR_TEACHERS = {"solutions", "teaching.md"}
TEACHERS_LINK = re.compile(rb"\[([^][]+)\]\((?:solutions/[^)]+|teaching\.md)\)")
NEWS = "@jupyterlab/apputils-extension:announcements"  # dialogues on news, and requests to PyPI for updates


def add(parser: argparse.ArgumentParser) -> None:
    """Declare `vo lab`."""
    parser.description = (
        f"Open the course in JupyterLab. The course is copied to {COURSE} in your home folder; each call "
        "updates the copy. A file that you changed is kept; the new version is a file with .new in the "
        "name. Running a notebook does not count as a change. A file that you deleted is copied again."
    )
    parser.epilog = "example: vo lab -- --port 8889 --no-browser"
    place = parser.add_mutually_exclusive_group()
    place.add_argument("--copy", metavar="DIR", help="folder of the copy")
    text = "open the kit's own notebooks, not a copy"
    place.add_argument("--here", action="store_true", help=text)
    parser.add_argument("--teacher", action="store_true", help="also copy solutions and teaching notes")
    parser.add_argument("jupyter", nargs="*", metavar="-- …", help="options for JupyterLab")
    parser.set_defaults(command=_lab, others="JupyterLab's options follow --")


def _lab(options: argparse.Namespace) -> int:
    if options.jupyter and not options.jupyter[0].startswith("-"):
        raise DataError(f"unexpected {options.jupyter[0]!r}: --copy DIR chooses the folder of the course")
    notebooks = folder_of_checkout("notebooks")
    if not (notebooks / FIRST_NOTEBOOK).is_file():
        raise DataError(f"no {FIRST_NOTEBOOK}: install the kit from its folder, {install()}", notebooks)
    folder = notebooks if options.here else Path(os.path.abspath(options.copy or Path.home() / COURSE))
    if folder != notebooks:
        of_course = {DIGESTS_FILE, *(path.name for path in notebooks.glob("*.ipynb"))}
        if folder.exists() and (present := {*os.listdir(folder)}) and not present & of_course:
            raise DataError("contains other files and no course: choose a new or an empty folder", folder)
        copy_course(notebooks, folder, options.teacher)
    from jupyterlab.labapp import LabApp  # type: ignore[import-untyped]

    print_lines(f"The course is in {folder}. JupyterLab opens {FIRST_NOTEBOOK}; press Ctrl-C twice to quit.")
    with suppress(OSError, ValueError):  # settings that cannot be read or written: it opens as usual
        _collapse_sidebar()
    LabApp.serverapp_config = {"tornado_settings": {"page_config_hook": _without_news}}
    # A separate workspace: the tabs of the reader's other work stay closed.
    url = f"--LabApp.default_url=/lab/workspaces/{COURSE}/tree/{FIRST_NOTEBOOK}"
    LabApp.launch_instance([f"--ServerApp.root_dir={folder}", url, *options.jupyter])
    return 0


def _collapse_sidebar() -> None:
    """Let the course's workspace begin with a closed file browser: the pictures need the width.

    A workspace that exists is as the reader left it.
    """
    from jupyterlab.labapp import LabWorkspaceImportApp

    importer = LabWorkspaceImportApp()
    importer.initialize([])
    layout = {
        "main": {"dock": None},
        "left": {"collapsed": True, "visible": True, "current": None, "widgets": ["filebrowser"]},
    }
    if not importer.manager.load(COURSE)["data"]:
        workspace = {"data": {"layout-restorer:data": layout}, "metadata": {"id": COURSE}}
        importer.manager.save(COURSE, json.dumps(workspace))


def _without_news(handler: object, page: dict[str, Any]) -> dict[str, Any]:
    return {**page, "disabledExtensions": [*page["disabledExtensions"], NEWS]}


def copy_course(source: Path, target: Path, teacher: bool) -> None:
    """Update the course in `target` from `source`, and keep the files that the reader changed.

    A file counts as changed if its digest differs from the digest in DIGESTS_FILE and from the digest of the
    source. The new version of a changed file is written once, under another name, with a message. In a
    student's copy, the address in a link to a file for teachers is replaced by the command that copies the
    file. Raises `DataError` if a file cannot be read or written.
    """
    digests_file = target / DIGESTS_FILE
    copied = dict[str, Any]()
    with suppress(DataError):  # without digests, every file that differs from the source counts as changed
        copied = read_mapping(digests_file, "digests of copied files by name")
    left_out = CACHES | WORK if teacher else CACHES | WORK | FOR_TEACHERS
    for path in sorted(source.rglob("*")):
        name = path.relative_to(source).as_posix()
        place = name
        if not path.is_file() or left_out & {*path.relative_to(source).parts}:
            continue
        original = path.read_bytes()
        content = original if teacher else TEACHERS_LINK.sub(rb"\1 (`vo lab --teacher`)", original)
        new = _digest(content)
        versions = new, _digest(original)
        while (file := target / place).exists():
            if (present := _digest(read_bytes(file))) in (copied.get(place), *versions):
                break
            place = f"{place.removesuffix(path.suffix)}.new{path.suffix}"
        if place != name:
            if copied.get(name) in versions:
                continue
            print_lines(f"Your change of {name} is kept; the new version is {place}")
        if not file.exists() or present != new:
            file.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(file, content)
        copied[name] = new
        copied[place] = new
    write_atomic(digests_file, json.dumps(copied, indent=1) + "\n")


def _digest(content: bytes) -> str:
    """SHA-256 of a file's content; for a notebook, of its cells only, since JupyterLab changes the rest."""
    with suppress(ValueError, LookupError, TypeError):  # raised for a file that is not a notebook
        cells = [(cell["cell_type"], "".join(cell["source"])) for cell in json.loads(content)["cells"]]
        content = json.dumps(cells).encode()
    return sha256(content).hexdigest()
