"""What the checks said in the notebooks: `my_answers.json`, which a hand-in contains.

Functions that pass are kept in `my_vo.py` and can be checked again. Numbers and the facts of panels are in no
file, and some checks need data of their notebook; so each check writes down its answer and its verdict.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np

from vo_lib.errors import DataError
from vo_lib.files import read_mapping, write_atomic

from .results import Verdict
from .stored_answers import COURSE_FILE, NOT_SAVED

NAME = "my_answers.json"
LARGEST = 100  # numbers of an answer that is written down


def record(exercise: object, answer: Any, verdict: Verdict, kept: str = "") -> None:
    """Write a verdict and its answer down; after a right answer, a wrong one is only a note ("later").

    In a folder without `00_start_here.ipynb` (of tests or scripts), nothing is written. Never raises.

    kept : what `store_answer` said about a right function.
    """
    if not Path(COURSE_FILE).is_file():
        return
    name = name_of(exercise)
    if not name:
        return
    says = verdict.message if verdict.passed else f"{verdict.message} {verdict.hint}".strip()
    with suppress(DataError, OSError):
        records = read_records(Path(NAME))
        before = records.get(name, {})
        if before.get("passed") is True and not verdict.passed:
            records[name] = {**before, "later": says}
        else:
            function = ""
            if isinstance(answer, FunctionType) and answer.__name__.isidentifier() and NOT_SAVED not in kept:
                function = answer.__name__
            records[name] = {
                "passed": verdict.passed,
                "answer": as_json(answer),
                "says": says,
                "function": function,
                "kept": kept.strip(),
            }
        write_atomic(Path(NAME), json.dumps(records, indent=1, sort_keys=True) + "\n")


def answered_by(function: Any, exercise: object) -> str:
    """The other exercise that a function of this name answered in this folder; "" if there is none."""
    function_name = getattr(function, "__name__", "")
    if not function_name:
        return ""
    own = name_of(exercise)
    for name, entry in read_records(Path(NAME)).items():
        if entry.get("function") == function_name and name != own and entry.get("passed") is True:
            return name
    return ""


def read_records(path: Path) -> dict[str, dict[str, Any]]:
    """The records by name of the exercise; none without a file, or if the file is damaged."""
    if not path.is_file():
        return {}
    with suppress(DataError):
        records = read_mapping(path, "the answers of the notebooks")
        return {name: each for name, each in records.items() if isinstance(each, dict)}
    return {}


def name_of(exercise: object) -> str:
    """The name of an exercise in its chapter, such as "ch03.select"; "" for a check of no chapter."""
    for module_name, module in list(sys.modules.items()):
        if not (module_name.startswith("course.") and module_name.endswith(".exercises")):
            continue
        for name, value in vars(module).items():
            if value is exercise:
                return f"{module_name.split('.')[1]}.{name}"
    return ""


def as_json(answer: Any) -> Any:
    """An answer that JSON can hold: numbers, lists of numbers, facts; None for everything else."""
    if isinstance(answer, Mapping):
        facts = {str(name): as_json(value) for name, value in answer.items()}
        return facts if all(value is not None for value in facts.values()) else None
    if isinstance(answer, str):
        return answer
    try:
        numbers = np.asarray(answer)
    except (TypeError, ValueError):
        return None
    if numbers.dtype.kind not in "biuf" or numbers.size > LARGEST:
        return None
    return numbers.tolist()
