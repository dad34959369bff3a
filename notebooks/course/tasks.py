"""The exercises of the course, read from the notebooks: number, check, and the name of the answer."""

from __future__ import annotations

import functools
import importlib
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import FunctionType

from vo_lib.errors import DataError

from .checker import Exercise
from .notebook_folder import NOTEBOOKS

HEADING = re.compile(r"^#{3,4} Exercise (\w+\.\d+)", re.MULTILINE)
# A cell calls the check of its exercise: `ch04.stack(translation_of_all)`, `ch08.drift(percent, yours, street)`.
CHECK = re.compile(r"^(ch\d\d|appendix)\.(\w+)\((\w+)(\.facts)?((?:, *[\w.]+)*)\)$", re.MULTILINE)


@dataclass(frozen=True)
class Task:
    """An exercise of a notebook.

    Attributes
    ----------
    number : as in its heading, such as "3.5". chapter : the part before the point. notebook : name of the file.
    check : the call in the notebook, such as "ch03.select". name : the function or variable with the answer.
    is_function : whether the answer is a function that `my_vo.py` keeps. has_data : whether the check also gets
        data of the notebook, so that the answer alone cannot be checked. exercise : the check.
    """

    number: str
    chapter: str
    notebook: str
    check: str
    name: str
    is_function: bool
    has_data: bool
    exercise: Exercise


@functools.cache
def all_tasks() -> tuple[Task, ...]:
    """All exercises, in the order of the notebooks, the appendix last."""
    tasks_in_order = list[Task]()
    for path in sorted(NOTEBOOKS.glob("*.ipynb")):
        tasks_in_order += _tasks_of(path)
    return tuple(tasks_in_order)


@functools.cache
def functions_to_write() -> dict[str, tuple[str, Exercise]]:
    """Number and check of each exercise whose answer is a function, by the name of the function."""
    return {task.name: (task.number, task.exercise) for task in all_tasks() if task.is_function}


def chosen_tasks(chapters: str | None) -> tuple[Task, ...]:
    """The exercises of the chapters in a text such as "0,3,5,8" or "0-3,A"; all without a text.

    Raises `DataError` for a chapter that has no exercises.
    """
    every = all_tasks()
    if chapters is None:
        return every
    known = list(dict.fromkeys(task.chapter for task in every))
    wanted = set[str]()
    for word in chapters.split(","):
        names = _chapters_of(word.strip(), known)
        if not names:
            raise DataError(
                f"--chapters {chapters!r}: expected chapters such as 0,3,5,8, from {', '.join(known)}"
            )
        wanted |= set(names)
    return tuple(task for task in every if task.chapter in wanted)


def _chapters_of(word: str, known: list[str]) -> list[str]:
    """The known chapters that a word such as "3" or "0-3" names; none if it names an unknown one."""
    if word in known:
        return [word]
    first, _, last = word.partition("-")
    if first not in known or last not in known:
        return []
    return known[known.index(first) : known.index(last) + 1]


def _tasks_of(path: Path) -> Iterator[Task]:
    """The exercises of a notebook; a copy with another version of it (`.new`) has none."""
    if path.stem.endswith(".new"):
        return
    number = ""
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        text = "".join(cell["source"])
        headings = HEADING.findall(text)
        if headings:
            number = headings[-1]
        for chapter, check, name, _facts, data in CHECK.findall(text):
            exercise, measures = _exercise(chapter, check)
            if exercise is None or not number:
                continue
            yield Task(
                number=number,
                chapter=number.partition(".")[0],
                notebook=path.name,
                check=f"{chapter}.{check}",
                name=name,
                is_function=f"def {name}(" in text and exercise.cases is not None,
                has_data=bool(data) and exercise.cases is None and not measures,
                exercise=exercise,
            )


def exercise_of(check: str) -> Exercise:
    """The check that a notebook calls, such as "ch03.select"; imports its chapter only."""
    chapter, _, name = check.partition(".")
    exercise, _ = _exercise(chapter, name)
    if exercise is None:
        raise LookupError(f"{check} is no check of an exercise")
    return exercise


def _exercise(chapter: str, check: str) -> tuple[Exercise | None, bool]:
    """The exercise that a notebook checks, and whether the check measures first.

    Such a check (`ch08.better`) is a function, and its exercise is the one that it calls. None if there is none.
    The chapter is imported by its name in the notebook: nothing else that the chapters share imports a chapter.
    """
    module = importlib.import_module(f"course.{chapter}.exercises")
    found = getattr(module, check, None)
    if isinstance(found, Exercise):
        return found, False
    if isinstance(found, FunctionType):
        for name in found.__code__.co_names:
            called = getattr(module, name, None)
            if isinstance(called, Exercise):
                return called, True
    return None, False
