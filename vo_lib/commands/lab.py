"""`vo lab`: the course in JupyterLab, in a copy of the notebooks."""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import subprocess
import sys
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from typing import Any

from ..checkout import kit_subfolder
from ..errors import DataError
from ..files import read_bytes, read_mapping, write_atomic
from .carry_over import carry_over
from .console import install, print_lines, print_wrapped

FIRST_NOTEBOOK = "00_start_here.ipynb"
NOTEBOOK = ".ipynb"
# A file that its reader has changed stays. Beside it, the current version is NAME.new.ipynb or, if that was
# changed as well, NAME.new.new.ipynb.
NEW = ".new"
COURSE = "stereo-vo-course"  # name of the folder in the user's home and of JupyterLab's workspace
# In the course's folder: by name, the digest of each file as it was copied. For a file that the reader has
# changed, it is that of the version last offered, which lies beside it.
DIGESTS_FILE = ".copied.json"
FOR_TEACHERS = {"solutions", "teaching.md"}
TEACHERS_LINK = re.compile(rb"\[([^][]+)\]\((?:solutions/[^)]+|teaching\.md)\)")
HAND_IN = "hand_in.zip"
KIT_PYTHON = ".kit_python"  # in the course's folder: the Python with the kit, for a kernel that lacks it
MODULES = "course"  # the folder of the course's Python code
CACHES = {".ipynb_checkpoints", "__pycache__"}
# Files that the notebooks write, and this command.
WORK = {"my_vo.py", "my_answers.json", "my_poses.txt", "my_path.webm", HAND_IN, KIT_PYTHON}
OTHER_JUPYTERS = (
    "In VS Code, open this folder and choose the kernel {python}",
    "In a Jupyter of your own, this command adds a kernel with the name Stereo VO:",
)
KERNEL_COMMAND = '  {python} -m ipykernel install --user --name stereo-vo --display-name "Stereo VO"'
# Options with which JupyterLab starts as root, or does not start at all.
STARTS_AS_ROOT = ("allow-root", "ServerApp.allow_root", "version", "help", "help-all", "h", "generate-config")
KERNEL = "Python 3 (ipykernel)"  # how the kernel of a Python environment names itself
# How this kernel describes its language, but for the version.
LANGUAGE = {
    "codemirror_mode": {"name": "ipython", "version": 3},
    "file_extension": ".py",
    "mimetype": "text/x-python",
    "name": "python",
    "nbconvert_exporter": "python",
    "pygments_lexer": "ipython3",
}
SIDEBAR_SHARE = 0.3  # of the window's width
NEWS = "@jupyterlab/apputils-extension:announcements"  # dialogues on news, and requests to PyPI for updates


def add(parser: argparse.ArgumentParser) -> None:
    """Declare `vo lab`."""
    parser.description = (
        f"Open the course in JupyterLab. The course is copied to {COURSE} in your home folder; each call "
        "updates the copy. A file that you changed is kept; the new version is a file with .new in the "
        "name, and a new notebook has your answers already. Running a notebook does not count as a change. A "
        "file of the course that you deleted is copied again, but not a new version beside a file of yours."
    )
    parser.epilog = "example: vo lab -- --port 8889 --no-browser"
    place = parser.add_mutually_exclusive_group()
    place.add_argument("--copy", metavar="DIR", help="make the copy in this folder instead")
    text = "open the kit's own notebooks instead of a copy"
    place.add_argument("--here", action="store_true", help=text)
    only = parser.add_mutually_exclusive_group()
    text = "only update the copy, for VS Code or a Jupyter of your own"
    only.add_argument("--copy-only", action="store_true", help=text)
    text = f"only write a zip for the teacher; default {HAND_IN} in the folder of the course"
    only.add_argument("--hand-in", nargs="?", const="", metavar="ZIP", help=text)
    parser.add_argument("--teacher", action="store_true", help="copy solutions and teaching notes, too")
    parser.add_argument("jupyter", nargs="*", metavar="-- OPTION", help="options for JupyterLab")
    parser.set_defaults(command=_lab)


def _lab(options: argparse.Namespace) -> int:
    """Update the copy of the course; then open it, write the zip for the teacher, or only say where it is."""
    if options.jupyter and not options.jupyter[0].startswith("-"):
        raise DataError(f"unexpected {options.jupyter[0]!r}: --copy DIR chooses the folder of the course")
    _refuse_without_effect(options)
    notebooks = kit_subfolder("notebooks")
    if not (notebooks / FIRST_NOTEBOOK).is_file():
        raise DataError(f"no {FIRST_NOTEBOOK}: install the kit from its folder, {install()}", notebooks)
    folder = notebooks if options.here else Path(os.path.abspath(options.copy or Path.home() / COURSE))
    if folder != notebooks:
        _refuse_other_folder(folder, notebooks)
        if options.hand_in is None:
            copy_course(notebooks, folder, options.teacher)
    if options.hand_in is not None:
        return _hand_in(notebooks, folder, options.hand_in)
    if options.copy_only:
        print_wrapped(
            f"The course is in {folder}.", *(line.format(python=sys.executable) for line in OTHER_JUPYTERS)
        )
        print_lines(KERNEL_COMMAND.format(python=sys.executable))
        return 0
    _refuse_root(options.jupyter)
    from jupyterlab.labapp import LabApp  # type: ignore[import-untyped]

    print_wrapped(
        f"The course is in {folder}. JupyterLab opens {FIRST_NOTEBOOK}; press Ctrl-C twice to quit."
    )
    with suppress(OSError, ValueError):  # settings that cannot be read or written: it opens as usual
        _collapse_sidebar()
    LabApp.serverapp_config = {"tornado_settings": {"page_config_hook": _without_news}}
    # A separate workspace: the tabs of the reader's other work stay closed.
    url = f"--LabApp.default_url=/lab/workspaces/{COURSE}/tree/{FIRST_NOTEBOOK}"
    LabApp.launch_instance([f"--ServerApp.root_dir={folder}", url, *options.jupyter])
    return 0


def _refuse_without_effect(options: argparse.Namespace) -> None:
    """Raise `DataError` for options that another option leaves without an effect."""
    if options.jupyter and options.copy_only:
        raise DataError("--copy-only: JupyterLab does not start, so omit its options")
    if options.hand_in is not None and (options.jupyter or options.teacher):
        raise DataError("--hand-in: only the zip is written, so omit --teacher and JupyterLab's options")


def _refuse_other_folder(folder: Path, notebooks: Path) -> None:
    """Raise `DataError` for a folder that has files, but none of a copy of the course."""
    if not folder.exists():
        return
    present = set(os.listdir(folder))
    of_course = {DIGESTS_FILE, *(path.name for path in notebooks.glob("*.ipynb"))}
    if present and not present & of_course:
        raise DataError("contains other files and no course: choose a new or an empty folder", folder)


def _hand_in(notebooks: Path, folder: Path, target: str) -> int:
    """Let the course write the zip of a folder; the library does not import the course."""
    zip_file = Path(os.path.abspath(target)) if target else folder / HAND_IN
    command = [sys.executable, "-m", "course.hand_in", str(folder), str(zip_file)]
    return subprocess.run(command, cwd=notebooks, check=False).returncode


def _refuse_root(options: list[str]) -> None:
    """Raise `DataError` where JupyterLab would end with a hint that is not how `vo` takes the option."""
    is_root = hasattr(os, "geteuid") and os.geteuid() == 0
    names = {word.lstrip("-").split("=")[0] for word in options}
    if is_root and not names.intersection(STARTS_AS_ROOT):
        raise DataError("JupyterLab does not start as root unless it is told to: vo lab -- --allow-root")


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
        # Wide enough, once it is opened, to tell a notebook from its new version.
        "relativeSizes": [SIDEBAR_SHARE, 1.0 - SIDEBAR_SHARE, 0.0],
    }
    if not importer.manager.load(COURSE)["data"]:
        workspace = {"data": {"layout-restorer:data": layout}, "metadata": {"id": COURSE}}
        importer.manager.save(COURSE, json.dumps(workspace))


def _without_news(handler: object, page: dict[str, Any]) -> dict[str, Any]:
    """The configuration of a page of JupyterLab, without the extension `NEWS`."""
    return {**page, "disabledExtensions": [*page["disabledExtensions"], NEWS]}


def copy_course(source: Path, target: Path, teacher: bool) -> None:
    """Update the course in `target` from `source`, and keep the files that the reader changed.

    A file counts as changed if its digest differs from the digest in DIGESTS_FILE and from the digest of the
    source. The new version of a changed file is written once, under another name, with a message; a new
    notebook contains the reader's answers. In a student's copy, the address in a link to a file for teachers
    is replaced by the command that copies it. A module that the course no longer has is deleted, unless the
    reader changed it: an older notebook that imports it fails, instead of meeting old code beside new.

    teacher : copy the files for teachers as well.

    Raises `DataError` if a file cannot be read or written.
    """
    digests_file = target / DIGESTS_FILE
    copied = dict[str, Any]()
    with suppress(DataError):  # without digests, every file that differs from the source counts as changed
        copied = read_mapping(digests_file, "digests of copied files by name")
    left_out = CACHES | WORK if teacher else CACHES | WORK | FOR_TEACHERS
    for path in sorted(source.rglob("*")):
        relative = path.relative_to(source)
        if not path.is_file() or left_out.intersection(relative.parts):
            continue
        name = relative.as_posix()
        original = path.read_bytes()
        content = original if teacher else TEACHERS_LINK.sub(rb"\1 (`vo lab --teacher`)", original)
        digest = _digest(content)
        this_version = (digest, _digest(original))  # as this kit has the file, for students or for teachers
        place, changed = _free_place(target, name, copied, this_version)
        if changed:
            if copied.get(name) in this_version:
                # The reader changed this very version, or an earlier call has written it beside the reader's
                # file.
                continue
            answers = ""
            if path.suffix == NOTEBOOK:
                content, answers = _with_answers(changed, content)
            print_wrapped(f"Your change of {name} is kept; the new version is {place}{answers}")
        if path.suffix == NOTEBOOK:
            content = _as_jupyter_writes(content)
        file = target / place
        if not file.exists() or _digest(read_bytes(file)) != _digest(content):
            file.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(file, content)
        # Under `name`, the version last offered, so that it is offered once; under `place`, the file written
        # there, which for a notebook has the answers.
        copied[name] = digest
        copied[place] = _digest(content)
    _delete_old_modules(source, target, copied)
    write_atomic(digests_file, json.dumps(copied, indent=1) + "\n")
    write_atomic(target / KIT_PYTHON, f"{sys.executable}\n")


def _free_place(
    target: Path, name: str, copied: dict[str, Any], this_version: tuple[str, ...]
) -> tuple[str, list[bytes]]:
    """The first name for a file that has no changes of the reader, and the contents of the files before it.

    It is `name` or, if the reader has changed that file, the name with `NEW`, and so on.

    copied : the digests of copied files by name; this_version : those of the file as this kit has it.
    """
    suffix = Path(name).suffix
    changed = list[bytes]()
    place = name
    while (target / place).exists():
        content = read_bytes(target / place)
        if _digest(content) in (copied.get(place), *this_version):
            break
        changed.append(content)
        place = f"{place.removesuffix(suffix)}{NEW}{suffix}"
    return place, changed


def _delete_old_modules(source: Path, target: Path, copied: dict[str, Any]) -> None:
    """Delete the modules in `target` that an earlier course had, and that the reader did not change.

    copied : the digests of copied files by name.

    Raises `DataError` if a module cannot be read.
    """
    for path in sorted((target / MODULES).rglob("*.py")):
        name = path.relative_to(target).as_posix()
        is_of_this_course = (source / name).exists() or NEW in path.suffixes
        if not is_of_this_course and copied.get(name) == _digest(read_bytes(path)):
            path.unlink()
            del copied[name]


def _with_answers(changed: list[bytes], content: bytes) -> tuple[bytes, str]:
    """A new notebook with the answers of the changed ones, and words that name these answers.

    changed : from the oldest to the latest; an answer of a later one goes before that of an earlier one.
    """
    as_code = list[str]()
    as_comments = list[str]()
    for notebook in reversed(changed):
        carried = carry_over(notebook, content)
        content = carried.content
        as_code += carried.as_code
        as_comments += carried.as_comments
    words = ""
    if as_code:
        words = f", with your answers: {', '.join(as_code)}"
    if as_comments:
        names = ", ".join(dict.fromkeys(as_comments))
        words += f"; as comments, since they do not fit the new exercises: {names}"
    return content, words


def _as_jupyter_writes(content: bytes) -> bytes:
    """A notebook with the kernel's description, as JupyterLab adds it when it opens the notebook.

    Without it, the notebook would count as changed as soon as it is open.
    """
    with suppress(ValueError, LookupError, TypeError):  # raised for a file that is not a notebook
        notebook = json.loads(content)
        metadata = notebook["metadata"]
        metadata["kernelspec"] = {"display_name": KERNEL, "language": "python", "name": "python3"}
        metadata["language_info"] = {**LANGUAGE, "version": platform.python_version()}
        content = (json.dumps(notebook, indent=1, ensure_ascii=False) + "\n").encode()
    return content


def _digest(content: bytes) -> str:
    """SHA-256 of a file's content; for a notebook, of its cells only, since JupyterLab changes the rest."""
    with suppress(ValueError, LookupError, TypeError):  # raised for a file that is not a notebook
        cells = [(cell["cell_type"], "".join(cell["source"])) for cell in json.loads(content)["cells"]]
        content = json.dumps(cells).encode()
    return sha256(content).hexdigest()
