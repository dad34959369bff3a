"""Marks of one student: the functions of `my_vo.py` run in a process of their own, with a limit of time.

The process writes a line of JSON before each section of my_vo.py, and before and after each exercise, into a file
outside the student's folder, with a word that only this run knows. If it stops in the middle, this section or exercise
is left out, and another process does the rest. What the functions print goes nowhere, and what they start ends with
them.
"""

from __future__ import annotations

import json
import os
import secrets
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, TextIO

from vo_lib.errors import DataError

from . import answer_log, stored_answers, supervised
from .checker import STRICT, Exercise
from .notebook_folder import NOTEBOOKS
from .results import RIGHT_CLASS, Verdict
from .submissions import Submission
from .tasks import Task, all_tasks, exercise_of

LIMIT_S = 60.0  # for the checks of one function, and for reading a section of my_vo.py
START_S = 120.0  # until the process has imported the course
END_S = 30.0  # until the processes that a student's program started have ended
POLL_S = 0.05
MAX_SAYS = 500  # letters of a message
MEMORY_BYTES = 8 << 30  # address space of the process, where the system can limit it
RUN = "run"  # the function was run now
ANSWER = "answer"  # the answer was checked again
SAID = "said"  # what the check said in the notebook, by the student's file; it cannot be checked again
UNSEEN = "unseen"  # the student's file says that a function was right, but the function is not in my_vo.py


@dataclass(frozen=True)
class Mark:
    """Whether an exercise is solved, what the check says otherwise, and how it was found (`RUN` …)."""

    passed: bool
    says: str
    found: str

    @property
    def checked(self) -> bool:
        """Whether the exercise is solved, and its answer was checked now."""
        return self.passed and self.found in (RUN, ANSWER)

    @property
    def cell(self) -> str:
        """The mark in a table: 1, 0, "said" for a verdict of the student's file alone, or "?" for `UNSEEN`."""
        if self.found == UNSEEN:
            return "?"
        if self.passed and self.found == SAID:
            return SAID
        return str(int(self.passed))


class _Function(NamedTuple):
    """A function to be checked: the check in the notebook, such as "ch03.select", and names it may have."""

    check: str
    names: list[str]


def grade(
    submission: Submission, tasks: Sequence[Task], limit_s: float = LIMIT_S
) -> tuple[dict[str, Mark], list[str]]:
    """The marks of a submission by the number of the exercise, and remarks on its files.

    limit_s : longest time of the checks of one function, seconds.
    """
    code = ""
    remarks = list(submission.remarks)
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        folder = Path(name)
        # What the checks wrote down is read before a student's function runs, which could change it.
        (folder / answer_log.NAME).write_bytes(submission.files.get(answer_log.NAME, b""))
        noted = answer_log.read_records(folder / answer_log.NAME)
        (folder / answer_log.NAME).unlink()
        content = submission.files.get(stored_answers.NAME, b"")
        functions = {
            task.number: _Function(task.check, _names(task, noted)) for task in tasks if task.is_function
        }
        try:
            code, remark = stored_answers.decoded(content, Path(stored_answers.NAME))
            if remark:
                remarks.append(f"{stored_answers.NAME}: {remark}")
        except DataError as error:
            remarks.append(str(error))
        (folder / stored_answers.NAME).write_bytes(code.encode())
        marks = dict[str, Mark]()
        if code:  # otherwise no function is there, and no process has to start
            marks, faults = _run_functions(folder, functions, limit_s)
            remarks += faults
    for task in tasks:
        if task.number not in marks:
            marks[task.number] = _of_records(task, noted, submission)
        remarks += _remarks_on(task, marks[task.number], noted)
    remarks += _remarks_on_unknown_names(code, noted)
    return {task.number: marks[task.number] for task in tasks}, remarks


def _remarks_on_unknown_names(code: str, noted: dict[str, dict[str, Any]]) -> list[str]:
    """A remark on the functions of my_vo.py that answer no exercise, as far as the names say."""
    known = {task.name for task in all_tasks()} | {str(entry.get("function")) for entry in noted.values()}
    unknown = [section for section in stored_answers.SECTION.findall(code) if section not in known]
    if not unknown:
        return []
    why = f"of no exercise in the notebooks, and {answer_log.NAME} does not say whose they are"
    return [_plain(f"{stored_answers.NAME}: {', '.join(unknown)}: names {why}")]


def _names(task: Task, noted: dict[str, dict[str, Any]]) -> list[str]:
    """The names under which the function of an exercise may be saved, that of the notebook's check first."""
    noted_name = noted.get(answer_log.name_of(task.exercise), {}).get("function")
    if isinstance(noted_name, str) and noted_name.isidentifier() and noted_name != task.name:
        return [noted_name, task.name]
    return [task.name]


def _remarks_on(task: Task, mark: Mark, noted: dict[str, dict[str, Any]]) -> list[str]:
    """What a teacher should know about a mark, although the table does not say it."""
    entry = noted.get(answer_log.name_of(task.exercise), {})
    was_right = entry.get("passed") is True
    if mark.found == UNSEEN:
        return [f"{task.number}: {mark.says}"]
    if was_right and not mark.passed:
        return [f"{task.number}: right in the notebook, but not here: {mark.says}"]
    if mark.passed and was_right and entry.get("later"):
        return [
            _plain(f"{task.number}: the right answer counts; a later one was not right: {entry['later']}")
        ]
    return []


def _of_records(task: Task, noted: dict[str, dict[str, Any]], submission: Submission) -> Mark:
    """The mark of an exercise whose function is not there, or whose answer is no function."""
    entry = noted.get(answer_log.name_of(task.exercise))
    if entry is None:
        shown = not task.is_function and _shows_right(task, submission)
        return Mark(shown, "" if shown else "not there", SAID)
    passed = entry.get("passed") is True
    says = _plain(entry.get("says", ""))
    if task.is_function and passed:
        kept = _plain(entry.get("kept") or "its function is not there")
        return Mark(False, f"right by {answer_log.NAME}, but not in {stored_answers.NAME}: {kept}", UNSEEN)
    answer = entry.get("answer")
    if not task.has_data and task.exercise.cases is None and answer is not None:
        verdict = task.exercise.grade(answer)
        return Mark(verdict.passed, "" if verdict.passed else _plain(verdict.message), ANSWER)
    return Mark(passed, "" if passed else says, SAID)


def _shows_right(task: Task, submission: Submission) -> bool:
    """Whether the saved notebook shows that the answer is right."""
    content = submission.files.get(task.notebook)
    if content is None:
        return False
    with suppress(ValueError, LookupError, TypeError, AttributeError):
        for cell in json.loads(content)["cells"]:
            if f"{task.check}({task.name}" not in "".join(cell["source"]):
                continue
            pages = [output["data"]["text/html"] for output in cell.get("outputs", []) if "data" in output]
            return any(f'class="{RIGHT_CLASS}"' in "".join(page) for page in pages)
    return False


def _run_functions(
    folder: Path, functions: dict[str, _Function], limit_s: float
) -> tuple[dict[str, Mark], list[str]]:
    """Marks of the functions in the folder's my_vo.py that are there, and remarks on the file.

    functions : by the number of an exercise.
    """
    marks = dict[str, Mark]()
    remarks = list[str]()
    skipped = list[str]()  # sections that end the process
    left = list(functions)
    while left:
        wanted = {number: functions[number] for number in left}
        lines, why = _run_process(folder, wanted, skipped, limit_s)
        for line in lines:
            if "fault" in line:
                fault = _plain(line["fault"])
                if fault not in remarks:
                    remarks.append(fault)
            elif "passed" in line:
                marks[line["number"]] = Mark(line["passed"] is True, _plain(line["says"]), RUN)
        if not why:
            return marks, remarks
        last = lines[-1] if lines else {}
        if "section" in last:
            skipped.append(last["section"])
            remarks.append(f"{_place(last['section'])} cannot be read: it {why}")
        elif "number" in last:
            marks.setdefault(last["number"], Mark(False, f"it {why}", RUN))
            left = left[left.index(last["number"]) + 1 :]
        else:
            return marks, [*remarks, f"{stored_answers.NAME}: its functions cannot be run: it {why}"]
    return marks, remarks


def _place(section: object) -> str:
    """Where a fault of my_vo.py is: the file, and the name of the section if it has one."""
    return _plain(f"{stored_answers.NAME}, {section}") if section else stored_answers.NAME


def _run_process(
    folder: Path, functions: dict[str, _Function], skipped: list[str], limit_s: float
) -> tuple[list[dict[str, Any]], str]:
    """The lines that a process wrote, and why it stopped in the middle; "" if it did not."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as outside:
        results = Path(outside) / "results.jsonl"
        results.touch()
        word = secrets.token_hex(16)
        task = {"word": word, "results": str(results), "functions": functions, "skipped": skipped}
        process = _start_process(folder)
        try:
            if process.stdin is not None:
                with suppress(BrokenPipeError), process.stdin as pipe:
                    pipe.write(json.dumps(task).encode())
            lines_if_late = _wait_for_end(process, results, word, limit_s)
        finally:
            _end(process)
        lines = _lines(results, word)
    if lines_if_late is not None:
        return lines_if_late, f"did not end within {limit_s:g} s"
    if lines and lines[-1].get("done") is True:
        return lines, ""
    return lines, f"ended the process (exit code {process.returncode})"


def _start_process(folder: Path) -> subprocess.Popen[bytes]:
    """Start `_check_functions` in a folder; the process reads its task from the standard input."""
    path = os.pathsep.join(filter(None, [str(NOTEBOOKS), os.environ.get("PYTHONPATH", "")]))
    command = [sys.executable, "-m", "course.grading"]
    if os.name == "posix":
        command = [sys.executable, "-P", supervised.__file__, *command]
    return subprocess.Popen(
        command,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": path, STRICT: "0"},
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=os.name == "posix",
    )


def _wait_for_end(
    process: subprocess.Popen[bytes], results: Path, word: str, limit_s: float
) -> list[dict[str, Any]] | None:
    """Wait until a process ends: None; or until it is late, and then return the lines that it wrote before.

    It is late once it has written no line for `limit_s` (before the first line: `START_S`).
    """
    lines = list[dict[str, Any]]()
    since = time.monotonic()  # of the last line
    while process.poll() is None:
        written = _lines(results, word)
        if len(written) != len(lines):
            lines = written
            since = time.monotonic()
        longest = limit_s if lines else START_S
        if time.monotonic() - since > longest:
            return lines
        time.sleep(POLL_S)
    return None


def _plain(text: object) -> str:
    """A text of a student's process in one printable line: no control character reaches the terminal."""
    line = " ".join(str(text).split())
    return "".join(letter if letter.isprintable() else "?" for letter in line)[:MAX_SAYS]


def _lines(results: Path, word: str) -> list[dict[str, Any]]:
    """The lines with the word of this run; what a student's function writes into the file does not count."""
    lines = list[dict[str, Any]]()
    with suppress(OSError):
        for text in results.read_text(encoding="utf-8", errors="replace").splitlines():
            with suppress(ValueError):
                line = json.loads(text)
                if isinstance(line, dict) and line.get("word") == word:
                    lines.append(line)
    return lines


def _end(process: subprocess.Popen[bytes]) -> None:
    """End a process and those that it started; the process itself sees to the latter."""
    with suppress(ProcessLookupError, PermissionError):
        process.terminate()
    try:
        process.wait(END_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _check_functions(task: dict[str, Any], my_vo: Path) -> None:
    """In the process: check the functions of my_vo.py, and write a line for each.

    task : the "functions" (`_Function`) by number of the exercise, sections to be "skipped", the file for the
        "results" and the "word" of each line.
    """
    _limit_memory()
    functions = {number: _Function(*entry) for number, entry in task["functions"].items()}
    # Only the chapters of these exercises are imported: the imports are most of the process's work.
    exercises = {number: exercise_of(entry.check) for number, entry in functions.items()}
    word = task["word"]
    with open(task["results"], "a", encoding="utf-8") as file:
        _write(file, word, {"ready": True})
        definitions, faults = stored_answers.load_sections(
            my_vo, task["skipped"], lambda section: _write(file, word, {"section": section})
        )
        _write(file, word, {"read": True})
        for section, fault in faults.items():
            _write(file, word, {"fault": f"{_place(section)}: {fault}"})
        for number, entry in functions.items():
            answers = [definitions[name] for name in entry.names if callable(definitions.get(name))]
            if not answers:
                continue
            _write(file, word, {"number": number})
            for answer in answers:
                try:
                    verdict = _verdict(exercises[number], answer)
                except BaseException as error:  # such as SystemExit, which a check does not expect
                    verdict = Verdict(False, f"it raises {type(error).__name__}: {error}")
                if verdict.passed:
                    break
            says = "" if verdict.passed else f"{verdict.message} {verdict.hint}".strip()
            _write(file, word, {"number": number, "passed": bool(verdict.passed), "says": says})
        _write(file, word, {"done": True})


def _verdict(exercise: Exercise, function: Any) -> Verdict:
    """The verdict of an exercise on a function of my_vo.py, which must not be the kit's own."""
    if module := stored_answers.kit_module_of(function):
        return Verdict(False, f"it is the kit's own function, of {module}.")
    return exercise.grade(function)


def _write(file: TextIO, word: str, line: dict[str, Any]) -> None:
    """Write a line of JSON with the word of this run, so that it is there even if the process ends next."""
    file.write(json.dumps({"word": word, **line}) + "\n")
    file.flush()


def _limit_memory() -> None:
    """Limit the address space of this process, where the system can do so."""
    try:
        import resource
    except ImportError:  # Windows
        return
    with suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))


if __name__ == "__main__":
    _check_functions(json.loads(sys.stdin.buffer.read()), Path(stored_answers.NAME).resolve())
