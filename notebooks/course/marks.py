"""Marks of a class: for the `my_vo.py` of each student, the functions that pass the checks of the exercises.

    python -m course.marks my_vo.py
    python -m course.marks --json class/*/my_vo.py

Run the command in the folder of the notebooks. The command executes the code of the students.
"""

from __future__ import annotations

import argparse
import functools
import importlib
import json
import re
import sys
from pathlib import Path
from typing import Any

from vo_lib.errors import DataError

from .checker import Exercise
from .results import Verdict
from .stored_answers import load

NOTEBOOKS = Path(__file__).resolve().parents[1]
HEADING = re.compile(r"^#{3,4} Exercise (\d+\.\d+)", re.MULTILINE)
CHECK = re.compile(r"^(ch\d\d)\.(\w+)\((\w+)\)$", re.MULTILINE)


@functools.cache
def tasks() -> dict[str, tuple[str, Exercise]]:
    """Number and check of each exercise whose answer is a function, by the name of the function."""
    checks = {}
    number = ""
    for path in sorted(NOTEBOOKS.glob("0*.ipynb")):
        for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
            text = "".join(cell["source"])
            number = (HEADING.findall(text) or [number])[-1]
            for chapter, check, name in CHECK.findall(text):
                if f"def {name}(" in text:
                    exercises = importlib.import_module(f"course.{chapter}.exercises")
                    checks[name] = number, getattr(exercises, check)
    return checks


def marks(path: Path) -> dict[str, Any]:
    """The number of functions of a file that pass, and for each function its exercise, result and message.

    Raises `DataError` if the file is missing or cannot be run.
    """
    if not path.is_file():
        raise DataError("the file is missing: expected a student's my_vo.py", path)
    definitions = load(path)
    functions: dict[str, dict[str, Any]] = {}
    for name, (number, exercise) in tasks().items():
        verdict = Verdict(False, "not there")
        if callable(definitions.get(name)):
            verdict = exercise.grade(definitions[name])
        says = "" if verdict.passed else verdict.message
        functions[name] = {"exercise": number, "passed": verdict.passed, "says": says}
    passed = sum(each["passed"] for each in functions.values())
    return {"passed": passed, "of": len(functions), "functions": functions}


def main() -> int:
    """Print the marks of the files as text or JSON; return 2 if a file could not be read, else 0."""
    parser = argparse.ArgumentParser(prog="python -m course.marks", description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="+", type=Path, metavar="my_vo.py")
    parser.add_argument("--json", action="store_true", help="print JSON instead of lines of text")
    options = parser.parse_args()
    results: dict[str, Any] = {}
    for path in options.files:
        try:
            results[str(path)] = marks(path)
        except DataError as error:
            print(f"error: {error}", file=sys.stderr)
    if options.json:
        print(json.dumps(results, indent=1))
    for path, each in ({} if options.json else results).items():
        print(f"{path}: {each['passed']} of {each['of']} pass")
        for name, one in each["functions"].items():
            print(f"  {one['exercise']:4} {name:20} {'passes' if one['passed'] else one['says']}")
    return 0 if len(results) == len(options.files) else 2


if __name__ == "__main__":
    sys.exit(main())
