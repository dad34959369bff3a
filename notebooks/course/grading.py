"""Marks of one student: the functions of `my_vo.py` run in a process of their own, with a limit of time.

The process writes a line of JSON before and after each exercise. If it stops in the middle, this exercise has no
marks, and another process continues with the next one. What the functions print goes nowhere.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

from vo_lib.errors import DataError

from . import records, stored_answers
from .results import RIGHT_CLASS, Verdict
from .submissions import Submission
from .tasks import Task, all_tasks

PACKAGE_FOLDER = Path(__file__).resolve().parents[1]
LIMIT_S = 60.0  # for the checks of one function, and for reading my_vo.py
START_S = 120.0  # until the process has imported the course
POLL_S = 0.05
MAX_SAYS = 500  # letters of a message
MEMORY_BYTES = 8 << 30  # address space of the process, where the system can limit it
READING = "reading"  # in place of the number of an exercise, while my_vo.py is read
RUN = "run"  # the function was run now
ANSWER = "answer"  # the answer was checked again
SAID = "said"  # what the check said in the notebook, which had the data


@dataclass(frozen=True)
class Mark:
    """Whether an exercise is solved, what the check says otherwise, and how it was found (`RUN` …)."""

    passed: bool
    says: str
    found: str


def grade(
    submission: Submission, tasks: Sequence[Task], limit_s: float = LIMIT_S
) -> tuple[dict[str, Mark], list[str]]:
    """The marks of a submission by the number of the exercise, and remarks on its file."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for file in (stored_answers.NAME, records.NAME):
            (folder / file).write_bytes(submission.files.get(file, b""))
        functions = [task.number for task in tasks if task.is_function]
        marks, remarks = _run_functions(folder, functions, limit_s)
        noted = records.read_records(folder / records.NAME)
    for task in tasks:
        if task.number not in marks:
            marks[task.number] = _of_records(task, noted, submission)
    return {task.number: marks[task.number] for task in tasks}, remarks


def _of_records(task: Task, noted: dict[str, dict[str, Any]], submission: Submission) -> Mark:
    """The mark of an exercise whose function is not there, or whose answer is no function."""
    entry = noted.get(records.name_of(task.exercise))
    if entry is None:
        shown = not task.is_function and _shows_right(task, submission)
        return Mark(shown, "" if shown else "not there", SAID)
    says = _plain(entry.get("says", ""))
    if task.is_function:  # a function that passed is in my_vo.py
        return Mark(False, says if not entry.get("passed") else "passed once, but is not in my_vo.py", SAID)
    answer = entry.get("answer")
    if not task.has_data and task.exercise.cases is None and answer is not None:
        verdict = task.exercise.grade(answer)
        return Mark(verdict.passed, "" if verdict.passed else _plain(verdict.message), ANSWER)
    passed = entry.get("passed") is True
    return Mark(passed, "" if passed else says, SAID)


def _shows_right(task: Task, submission: Submission) -> bool:
    """Whether the saved notebook shows that the answer is right."""
    content = submission.files.get(task.notebook)
    if content is None:
        return False
    with suppress(ValueError, LookupError, TypeError, AttributeError):
        for cell in json.loads(content)["cells"]:
            if f"{task.check}({task.name}" in "".join(cell["source"]):
                shown = [
                    output["data"]["text/html"] for output in cell.get("outputs", []) if "data" in output
                ]
                return any(f'class="{RIGHT_CLASS}"' in "".join(html) for html in shown)
    return False


def _run_functions(folder: Path, numbers: list[str], limit_s: float) -> tuple[dict[str, Mark], list[str]]:
    """Marks of the functions in the folder's my_vo.py that are there, and remarks on the file."""
    marks = dict[str, Mark]()
    remarks = list[str]()
    left = list(numbers)
    while left:
        lines, stopped, why = _run_process(folder, left, limit_s)
        for line in lines:
            if "fault" in line:
                fault = _plain(line["fault"])
                remarks += [fault] if fault not in remarks else []
            elif "passed" in line:
                marks[line["number"]] = Mark(line["passed"] is True, _plain(line["says"]), RUN)
        if stopped is None:
            return marks, remarks
        if stopped == READING:
            return marks, [*remarks, f"my_vo.py cannot be read: it {why}"]
        marks[stopped] = Mark(False, f"it {why}", RUN)
        left = left[left.index(stopped) + 1 :]
    return marks, remarks


def _run_process(
    folder: Path, numbers: list[str], limit_s: float
) -> tuple[list[dict[str, Any]], str | None, str]:
    """The lines that a process wrote; the exercise in which it stopped, or None; and why it did."""
    results = folder / "results.jsonl"
    results.write_text("", encoding="utf-8")
    command = [sys.executable, "-m", "course.grading", str(folder), *numbers]
    path = os.pathsep.join(filter(None, [str(PACKAGE_FOLDER), os.environ.get("PYTHONPATH", "")]))
    process = subprocess.Popen(
        command,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": path, "COURSE_STRICT": "0"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=os.name == "posix",
    )
    try:
        size = -1
        since = time.monotonic()
        while process.poll() is None:
            if results.stat().st_size != size:
                size = results.stat().st_size
                since = time.monotonic()
            if time.monotonic() - since > (limit_s if size > 0 else START_S):
                lines = _lines(results)
                return lines, _unfinished(lines), f"did not end within {limit_s:g} s"
            time.sleep(POLL_S)
    finally:
        _end(process)
    lines = _lines(results)
    if lines and lines[-1].get("done") is True:
        return lines, None, ""
    return lines, _unfinished(lines), f"ended the process (exit code {process.returncode})"


def _plain(text: object) -> str:
    """A text of a student's process in one printable line: no control character reaches the terminal."""
    line = " ".join(str(text).split())
    return "".join(letter if letter.isprintable() else "?" for letter in line)[:MAX_SAYS]


def _lines(results: Path) -> list[dict[str, Any]]:
    lines = list[dict[str, Any]]()
    for text in results.read_text(encoding="utf-8", errors="replace").splitlines():
        with suppress(ValueError):
            line = json.loads(text)
            lines += [line] if isinstance(line, dict) else []
    return lines


def _unfinished(lines: list[dict[str, Any]]) -> str:
    return next((str(line["start"]) for line in reversed(lines) if "start" in line), READING)


def _end(process: subprocess.Popen[bytes]) -> None:
    """End a process and those that it started."""
    with suppress(ProcessLookupError, PermissionError):
        if os.name == "posix":
            os.killpg(process.pid, signal.SIGKILL)
        elif process.poll() is None:
            process.kill()
    process.wait()


def _check_functions(folder: Path, numbers: Sequence[str]) -> None:
    """In the process: check the functions of the folder's my_vo.py, and write a line for each."""
    _limit_memory()
    tasks = {task.number: task for task in all_tasks()}
    with open(folder / "results.jsonl", "a", encoding="utf-8") as file:
        _write(file, {"start": READING})
        try:
            definitions, faults = stored_answers.load_sections(folder / stored_answers.NAME)
        except DataError as error:
            definitions = {}
            faults = {"": str(error).partition("my_vo.py: ")[2]}
        for section, fault in faults.items():
            where = f"my_vo.py, {section}" if section else "my_vo.py"
            _write(file, {"fault": f"{where}: {fault}"})
        for number in numbers:
            function = definitions.get(tasks[number].name)
            if not callable(function):
                continue
            _write(file, {"start": number})
            try:
                verdict = tasks[number].exercise.grade(function)
            except BaseException as error:  # such as SystemExit, which a check does not expect
                verdict = Verdict(False, f"it raises {type(error).__name__}: {error}")
            says = "" if verdict.passed else f"{verdict.message} {verdict.hint}".strip()
            _write(file, {"number": number, "passed": bool(verdict.passed), "says": says})
        _write(file, {"done": True})


def _write(file: TextIO, line: dict[str, Any]) -> None:
    file.write(json.dumps(line) + "\n")
    file.flush()


def _limit_memory() -> None:
    try:
        import resource
    except ImportError:  # Windows
        return
    with suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))


if __name__ == "__main__":
    _check_functions(Path(sys.argv[1]), sys.argv[2:])
