"""What a student hands in, as one zip; `vo lab --hand-in` calls this.

    python -m course.hand_in FOLDER hand_in.zip

The zip contains my_vo.py, the answers that the checks wrote down, the notebooks that were used, the poses of the own
drive of chapter 8, and marks.json with the exercises that pass.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import sys
import zipfile
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from vo_lib.commands.console import ENDINGS, OneLineParser, exit_code, print_wrapped
from vo_lib.errors import DataError
from vo_lib.files import read_bytes, write_atomic

from . import answer_log, stored_answers
from .grading import SAID, grade
from .notebook_folder import NOTEBOOKS
from .submissions import ANSWERS, CHANGED, MARKS, MAX_MEMBER_BYTES, NOTEBOOK, POSES, Submission
from .tasks import all_tasks

DATE = (1980, 1, 1, 0, 0, 0)  # of all members, so that the same files give the same bytes
# The files that a hand-in should have, and why one of them may be missing.
WHY_MISSING = {
    stored_answers.NAME: "no function has passed its check yet",
    answer_log.NAME: "no check was run yet",
    POSES: "the drive of chapter 8 was not run",
}


def write_hand_in(folder: Path, target: Path) -> None:
    """Write the zip of a folder of the course, and say what it contains and what it lacks.

    Raises `DataError` if the folder is no course, or if `target` is a file of somebody else.
    """
    if not (folder / stored_answers.COURSE_FILE).is_file():
        raise DataError("contains no course: give the folder of your notebooks with --copy", folder)
    _refuse_foreign(target)
    files, too_large = _files_of(folder)
    marks, remarks = grade(Submission("", files), all_tasks())
    passed = [number for number, mark in marks.items() if mark.checked]
    said = [number for number, mark in marks.items() if mark.cell == SAID]
    times = [(folder / name).stat().st_mtime for name in ANSWERS if name in files]
    exercises = {}
    for number, mark in marks.items():
        exercises[number] = {"passed": mark.passed, "found": mark.found, "says": mark.says}
    summary = {
        "passed": len(passed),
        "said": len(said),
        "of": len(marks),
        CHANGED: max(times, default=None),
        "remarks": remarks,
        "exercises": exercises,
    }
    files[MARKS] = (json.dumps(summary, indent=1) + "\n").encode()
    write_atomic(target, _zipped(files))
    print_wrapped(f"written: {target}")
    print_wrapped(f"It contains {', '.join(files)}, as last saved.")
    print_wrapped(f"{len(passed)} of {len(marks)} exercises pass: {' '.join(passed) or 'none'}")
    if said:
        print_wrapped(
            f"{len(said)} more are right in your notebooks, and cannot be checked again: {' '.join(said)}"
        )
    notes = list(remarks)
    for name, why in WHY_MISSING.items():
        if name not in files:
            notes.append(f"{name} is missing: {why}")
    limit = f"{MAX_MEMBER_BYTES / 1e6:.0f} MB"
    for name in too_large:
        notes.append(f"{name} is left out, since it is larger than {limit}: clear its outputs")
    print_wrapped(*(f"note: {note}" for note in notes))


def _files_of(folder: Path) -> tuple[dict[str, bytes], list[str]]:
    """The answers and the used notebooks of a folder, by name; and the notebooks that are too large."""
    files = {name: read_bytes(folder / name) for name in WHY_MISSING if (folder / name).is_file()}
    too_large = []
    for path in sorted(folder.glob(f"*{NOTEBOOK}")):
        content = read_bytes(path)
        if not _was_used(content, path.name):
            continue
        if len(content) > MAX_MEMBER_BYTES:
            too_large.append(path.name)
        else:
            files[path.name] = content
    return files, too_large


def _was_used(content: bytes, name: str) -> bool:
    """Whether a notebook has outputs, or other cells than the kit's."""
    with suppress(ValueError, LookupError, TypeError, AttributeError, DataError):
        notebook = json.loads(content)
        if any(cell.get("outputs") for cell in notebook["cells"]):
            return True
        return _sources(notebook) != _sources(json.loads(read_bytes(NOTEBOOKS / name)))
    return True


def _sources(notebook: dict[str, Any]) -> list[str]:
    """The code of each cell."""
    return ["".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "code"]


def _zipped(files: dict[str, bytes]) -> bytes:
    """A zip of files by name; the same files give the same bytes."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            member = zipfile.ZipInfo(name, DATE)
            member.compress_type = zipfile.ZIP_DEFLATED
            member.external_attr = 0o644 << 16
            archive.writestr(member, content)
    return buffer.getvalue()


def _refuse_foreign(target: Path) -> None:
    """Raise `DataError` if the target exists and is no hand-in."""
    if not os.path.lexists(target):
        return
    with suppress(zipfile.BadZipFile, OSError), zipfile.ZipFile(target) as archive:
        if MARKS in archive.namelist():
            return
    raise DataError("is not a zip of --hand-in: choose another name", target)


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the zip; return 2 if a file cannot be read or written, else 0."""
    parser = OneLineParser(prog="vo lab --hand-in", description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="folder of the notebooks")
    parser.add_argument("target", type=Path, metavar="ZIP", help="the file to write")
    options: argparse.Namespace = parser.parse_args(arguments)
    try:
        write_hand_in(options.folder, options.target)
    except ENDINGS as error:
        return exit_code(parser.prog, error)
    return 0


if __name__ == "__main__":
    sys.exit(main())
