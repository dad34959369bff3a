"""Marks of a class: for each student, the exercises that are solved.

    python -m course.marks class/ --chapters 0,3,5,8 --csv marks.csv
    python -m course.marks my_vo.py
    python -m course.marks --json anna.zip ben.zip

Run the command in the folder of the notebooks. A student is a zip of `vo lab --hand-in`, a folder of the course, or a
file my_vo.py; a folder of a class contains several. The command executes the functions of the students, in a process
for each student that ends after a limit: use an account without anything of value.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

from vo_lib.commands.console import ENDINGS, OneLineParser, exit_code
from vo_lib.data.tables import csv_text
from vo_lib.errors import DataError
from vo_lib.files import write_atomic

from .grading import LIMIT_S, SAID, grade
from .submissions import find_submissions, namesakes, read_submission
from .tasks import Task, chosen_tasks

WORDS = {"1": "passes", "said": "right, by the student's file alone", "?": "? "}  # by `Mark.cell`
FORMULA = ("=", "+", "-", "@", "\t", "\r")  # beginnings that a spreadsheet takes for a formula


def marks(student: str, path: Path, chosen: Sequence[Task], limit_s: float = LIMIT_S) -> dict[str, Any]:
    """The number of solved exercises of a student, each exercise with its answer and message, and remarks.

    "passed" counts the exercises whose answers were checked now, and "said" those for which there is only what the
    student's file says. Raises `DataError` if the submission cannot be read.
    """
    by_number, remarks = grade(read_submission(student, path), chosen, limit_s)
    exercises = {}
    for task in chosen:
        mark = by_number[task.number]
        exercises[task.number] = {
            "answer": task.name,
            "mark": mark.cell,
            "passed": mark.passed,
            "found": mark.found,
            "says": mark.says,
        }
    passed = sum(mark.checked for mark in by_number.values())
    said = sum(mark.cell == SAID for mark in by_number.values())
    return {"passed": passed, "said": said, "of": len(exercises), "remarks": remarks, "exercises": exercises}


def table(results: dict[str, dict[str, Any]], problems: dict[str, str], chosen: Sequence[Task]) -> str:
    """The marks of a class as CSV: a row per student, and for each exercise `Mark.cell`.

    results : of `marks`, by student. problems : why the submission of a student cannot be read.
    """
    numbers = [task.number for task in chosen]
    rows: list[list[object]] = [["student", "passed", "said", "of", *numbers, "remarks"]]
    for student, each in results.items():
        cells = [each["exercises"][number]["mark"] for number in numbers]
        counts = [each["passed"], each["said"], each["of"]]
        rows.append([_cell(student), *counts, *cells, _cell("; ".join(each["remarks"]))])
    for student, problem in problems.items():
        no_marks = [0] * len(numbers)
        rows.append([_cell(student), 0, 0, len(numbers), *no_marks, _cell(problem)])
    return csv_text(rows)


def _cell(text: str) -> str:
    """A text in one line that no spreadsheet executes."""
    line = " ".join(text.split())
    return f"'{line}" if line.startswith(FORMULA) else line


def as_text(student: str, each: dict[str, Any]) -> str:
    """The marks of a student as lines of text."""
    said = f", {each['said']} more by the student's file alone" if each["said"] else ""
    lines = [f"{student}: {each['passed']} of {each['of']} pass{said}"]
    lines += [f"  note: {remark}" for remark in each["remarks"]]
    for number, one in each["exercises"].items():
        lines.append(f"  {number:4} {one['answer']:20} {WORDS.get(one['mark'], '')}{one['says']}".rstrip())
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the marks as text or JSON, or write a table; return 2 if a submission could not be read, else 0."""
    parser = OneLineParser(prog="python -m course.marks", description=__doc__.splitlines()[0])
    parser.add_argument(
        "paths", nargs="+", type=Path, metavar="PATH", help="zip, my_vo.py, or folder of them"
    )
    parser.add_argument("--chapters", metavar="C,C,…", help="only these chapters, such as 0,3,5,8 or 0-3,A")
    parser.add_argument("--csv", type=Path, metavar="FILE", help="write a table with a row for each student")
    parser.add_argument("--json", action="store_true", help="print JSON in place of lines of text")
    text = "seconds for each function; default %(default)g"
    parser.add_argument("--limit", type=float, default=LIMIT_S, metavar="S", help=text)
    options = parser.parse_args(arguments)
    try:
        return _main(options)
    except ENDINGS as error:
        return exit_code(parser.prog, error)


def _main(options: argparse.Namespace) -> int:
    """Grade the submissions and print or write their marks; return 2 if one of them could not be read, else 0."""
    if not 0 < options.limit < 1e6:
        raise DataError(f"--limit {options.limit:g}: expected seconds")
    chosen = chosen_tasks(options.chapters)
    if options.csv is not None:
        _try_to_write(options.csv)
    results: dict[str, dict[str, Any]] = {}
    problems: dict[str, str] = {}
    found = find_submissions(options.paths)
    for path in found.others:
        if options.csv is None or path.resolve() != options.csv.resolve():
            print(f"note: not read: {path}", file=sys.stderr)
    also = _also_handed_in(found.students)
    for student, path in _named(found.students).items():
        try:
            results[student] = marks(student, path, chosen, options.limit)
        except DataError as error:
            problems[student] = "; ".join([str(error), *also.get(path, [])])
            print(f"error: {error}", file=sys.stderr)
            continue
        results[student]["remarks"] += also.get(path, [])
        if not options.json:
            print(as_text(student, results[student]), flush=True)
    if options.json:
        unread = {name: {"not read": why} for name, why in problems.items()}
        print(json.dumps({**results, **unread}, indent=1))
    if options.csv is not None:
        write_atomic(options.csv, table(results, problems, chosen))
        if not options.json:
            print(f"table: {options.csv}")
    return 2 if problems else 0


def _try_to_write(path: Path) -> None:
    """Raise an error now, and not after the whole class is graded, if a table cannot be written here."""
    if path.is_dir():
        raise DataError("is a folder, expected the name of a table", path)
    try:
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        raise DataError(f"cannot be written: {error.strerror}", path) from None


def _also_handed_in(students: list[tuple[str, Path]]) -> dict[Path, list[str]]:
    """For each submission, remarks on the others of the same student: which one is the newer."""
    remarks = dict[Path, list[str]]()  # by submission
    for group in namesakes(students):
        times = dict[Path, float | str | None]()  # of the last change, or why it is not known
        for student, path in group:
            try:
                times[path] = read_submission(student, path).changed
            except DataError:
                times[path] = "cannot be read"
        for _, path in group:
            remarks[path] = [
                _comparison(other, times[path], times[other]) for _, other in group if other != path
            ]
    return remarks


def _comparison(other: Path, own_time: float | str | None, time_of_other: float | str | None) -> str:
    """A remark on another submission of the same student; a text in place of its time says why it is unknown."""
    if isinstance(time_of_other, str):
        return f"also handed in as {other}, which {time_of_other}"
    if not isinstance(own_time, float) or time_of_other is None or own_time == time_of_other:
        return f"also handed in as {other}; which one is newer cannot be seen"
    when = datetime.fromtimestamp(time_of_other).isoformat(" ", "minutes")
    return f"also handed in as {other}, which is {'newer' if time_of_other > own_time else 'older'}: {when}"


def _named(found: list[tuple[str, Path]]) -> dict[str, Path]:
    """Submissions by a name that no other one has."""
    named: dict[str, Path] = {}
    for student, path in found:
        name = student
        if name in named or sum(other == student for other, _ in found) > 1:
            name = str(path)
        named[name] = path
    return named


if __name__ == "__main__":
    sys.exit(main())
