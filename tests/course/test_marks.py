"""What students hand in, and their marks: functions in a process of their own, answers, hostile zips."""

from __future__ import annotations

import csv
import io
import json
import linecache
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from course import answer_log, checker, hand_in, marks, stored_answers
from course.ch00 import exercises as ch00
from course.ch04 import exercises as ch04
from course.ch08 import exercises as ch08
from course.grading import grade
from course.notebook_folder import NOTEBOOKS
from course.results import Verdict
from course.submissions import MAX_MEMBERS, Submission, find_submissions, read_submission
from course.tasks import all_tasks, chosen_tasks, exercise_of, functions_to_write
from vo_lib.commands.cli import main
from vo_lib.errors import DataError

WEIGHTS = """# ---- weights ----
def weights(r, s):
    BODY
    return 1 / (1 + (r / s) ** 2)


"""
CHAIN = """# ---- chain ----
import numpy as np


def chain(motions):
    poses = [np.eye(4)]
    for motion in motions:
        poses.append(poses[-1] @ np.linalg.inv(motion))
    return np.array(poses)
"""


def my_vo(body: str = "pass") -> str:
    return WEIGHTS.replace("BODY", body) + CHAIN


def zipped(path: Path, **files: str | bytes) -> Path:
    """A zip of files, in whose names two underscores are a point."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name.replace("__", "."), content)
    return path


def numbers(text: str) -> list[str]:
    return re.findall(r"Exercise (\w+\.\d+)", text)


def test_exercises_are_those_of_the_notebooks() -> None:
    """Each heading of an exercise is one task, in every notebook."""
    headings = list[str]()
    for path in sorted(NOTEBOOKS.glob("*.ipynb")):
        for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
            if cell["cell_type"] == "markdown":
                headings += re.findall(r"^#{3,4} Exercise (\w+\.\d+)", "".join(cell["source"]), re.MULTILINE)
    assert [task.number for task in all_tasks()] == headings
    chapters = {task.chapter for task in all_tasks()}
    assert chapters == {*"0123456789", "A"}
    assert {task.name for task in all_tasks() if task.chapter == "8"} >= {
        "mine",
        "percent",
        "te_re",
        "my_drive",
    }
    assert functions_to_write()["weights"][1] is ch04.robust_weight
    assert all(exercise_of(task.check) is task.exercise for task in all_tasks())
    assert [task.chapter for task in chosen_tasks("0,8")] == [
        task.chapter for task in all_tasks() if task.chapter in "08"
    ]
    assert {task.chapter for task in chosen_tasks("1-3,A")} == {*"123", "A"}
    for wrong in ("0,12", "0-12", "3-", "5-3"):  # a range with an unknown end is not its first chapter
        with pytest.raises(DataError, match=f"--chapters '{wrong}': expected chapters"):
            chosen_tasks(wrong)


# Bodies of functions, and what is said of each. After these, the process goes on.
RAISING = {
    "chain": ("import sys; sys.exit(0)", "SystemExit"),
    "solve_five": ("raise KeyboardInterrupt", "KeyboardInterrupt"),
    "select": ("raise ValueError('\\x1b[31mred')", "ValueError"),
}
ENDLESS_PROGRAM = "[sys.executable, '-c', 'import time; time.sleep(1000)']"
# Each of these ends the process, and another one goes on.
DEADLY = {
    "chain": ("while True: pass", "did not end within 2 s"),
    "solve_five": ("import os; os._exit(7)", "ended the process (exit code 7)"),
    "nearest": ("import ctypes; ctypes.string_at(0)", "ended the process"),
    "select": (f"import subprocess, sys; subprocess.run({ENDLESS_PROGRAM})", "did not end within 2 s"),
}


@pytest.mark.parametrize(
    "bodies",
    [
        pytest.param(RAISING, id="raising"),
        pytest.param(DEADLY, id="deadly", marks=pytest.mark.slow),  # starts many processes
    ],
)
def test_a_faulty_function_fails_only_its_own_exercise(bodies: dict[str, tuple[str, str]]) -> None:
    """The last function is right, though it prints a lot."""
    content = WEIGHTS.replace("BODY", "print('flood ' * 100000)")
    for name, (body, _) in bodies.items():
        content += f"# ---- {name} ----\ndef {name}(*case):\n    {body}\n\n\n"
    submission = Submission("anna", {"my_vo.py": content.encode()})
    found, remarks = grade(submission, all_tasks(), limit_s=2.0)
    for name, (_, says) in bodies.items():
        mark = found[functions_to_write()[name][0]]
        assert not mark.passed, name
        assert says in mark.says, name
        assert mark.says.isprintable()
    assert found[functions_to_write()["weights"][0]].passed
    assert remarks == []


@pytest.mark.parametrize(
    ("head", "remark"),
    [
        ("1 / 0\n", "my_vo.py: line 1: ZeroDivisionError"),
        ("import time; time.sleep(1000)\n", "my_vo.py cannot be read: it did not end within 2 s"),
        ("import os; os._exit(0)\n", "my_vo.py cannot be read: it ended the process"),
        ("# \xff\n", "my_vo.py: line 1 is not in UTF-8, so the file was read as cp1252"),
        ("\x81", "my_vo.py, line 1: is not text in UTF-8: save the file with the encoding UTF-8"),
    ],
)
def test_a_file_that_cannot_be_run_is_a_remark(head: str, remark: str) -> None:
    content = head.encode("latin-1") + my_vo().encode()
    answers = json.dumps({"ch00.depth_error_ratio": {"passed": True, "answer": 4, "says": ""}}).encode()
    files = {"my_vo.py": content, "my_answers.json": answers}
    found, remarks = grade(Submission("ben", files), chosen_tasks("0,4"), limit_s=2.0)
    assert [each for each in remarks if remark in each]
    ratio = next(task.number for task in all_tasks() if task.exercise is ch00.depth_error_ratio)
    assert found[ratio].says == ch00.depth_error_ratio.grade(4).message or found[ratio].passed


def test_a_faulty_section_fails_only_its_own_function() -> None:
    content = my_vo().replace("def weights(r, s):", "def weights(r, s:")
    found, (remark,) = grade(Submission("cleo", {"my_vo.py": content.encode()}), chosen_tasks("0,4"))
    assert remark.startswith("my_vo.py, weights: SyntaxError")
    assert found[functions_to_write()["chain"][0]].passed


def test_answers_that_are_no_functions_are_checked_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Numbers and facts from what the checks wrote down; the verdict only where the check needs data."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "00_start_here.ipynb").touch()
    right = ch00.depth_error_ratio.right
    assert ch00.depth_error_ratio(right).passed
    assert not ch00.depth_error_ratio(right + 1).passed  # a right answer stays
    assert not ch08.all_yours({"borrowed": 2.0}).passed
    assert ch08.less_luck({"RE": 0.1, "RE published": 0.5}).passed
    kept = json.loads((tmp_path / "my_answers.json").read_text(encoding="utf-8"))
    assert kept["ch00.depth_error_ratio"]["answer"] == right
    kept["ch08.drift"] = {"passed": True, "answer": 3.0, "says": ""}
    kept["ch08.all_yours"]["passed"] = True  # a student who changes the file
    submission = Submission("dora", {"my_answers.json": json.dumps(kept).encode()})
    found, _ = grade(submission, chosen_tasks("0,8"))
    of_names = {task.name: found[task.number] for task in chosen_tasks("0,8")}
    assert (of_names["factor"].passed, of_names["factor"].found) == (True, "answer")
    assert (of_names["mine"].passed, of_names["mine"].found) == (False, "answer")
    assert "stages that are still the library's: 2" in of_names["mine"].says
    assert (of_names["my_drive"].passed, of_names["my_drive"].found) == (True, "answer")
    assert (of_names["percent"].passed, of_names["percent"].found) == (True, "said")
    assert (of_names["te_re"].passed, of_names["te_re"].says) == (False, "not there")


def test_a_student_without_functions_costs_no_process(monkeypatch: pytest.MonkeyPatch) -> None:
    started = list[Any]()

    def run_process(*parameters: Any) -> tuple[list[dict[str, Any]], str]:
        started.append(parameters)
        return [], ""

    monkeypatch.setattr("course.grading._run_process", run_process)
    found, remarks = grade(Submission("dora", {"my_answers.json": b"{}"}), all_tasks())
    assert (started, remarks) == ([], [])
    assert not any(mark.passed for mark in found.values())
    grade(Submission("anna", {"my_vo.py": my_vo().encode()}), all_tasks())
    assert len(started) == 1


def test_a_function_that_failed_says_why(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "00_start_here.ipynb").touch()
    assert not ch04.robust_weight(lambda r, s: -1 / (1 + (r / s) ** 2)).passed
    files = {"my_answers.json": (tmp_path / "my_answers.json").read_bytes()}
    found, _ = grade(Submission("emil", files), chosen_tasks("4"))
    assert "wrong sign" in found[functions_to_write()["weights"][0]].says


def test_saved_notebooks_count_where_nothing_was_written_down() -> None:
    notebook = json.loads((NOTEBOOKS / "08_your_own_odometry.ipynb").read_text(encoding="utf-8"))
    verdict = Verdict(True, "good")._repr_html_()
    for cell in notebook["cells"]:
        if "ch08.drift(percent" in "".join(cell["source"]):
            cell["outputs"] = [{"output_type": "execute_result", "data": {"text/html": [verdict]}}]
    files = {"08_your_own_odometry.ipynb": json.dumps(notebook).encode()}
    found, _ = grade(Submission("finn", files), chosen_tasks("8"))
    assert [task.name for task in chosen_tasks("8") if found[task.number].passed] == ["percent"]


def hostile(path: Path, kind: str) -> Path:
    """A zip that must not be read."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        link = zipfile.ZipInfo("my_vo.py")
        link.external_attr = 0o120777 << 16
        names: dict[str, list[tuple[Any, bytes]]] = {
            "parent": [("../my_vo.py", b"")],
            "deep parent": [("a/../../my_vo.py", b"")],
            "absolute": [("/tmp/my_vo.py", b"")],
            "windows": [("..\\my_vo.py", b"")],
            "drive": [("C:\\my_vo.py", b"")],
            "link": [(link, b"/etc/passwd")],
            "bomb": [("my_vo.py", b"#" * 31_000_000)],
            "many": [(f"{k}.txt", b"") for k in range(MAX_MEMBERS + 1)],
            "twice": [("my_vo.py", b""), ("hand_in/my_vo.py", b"")],
            "empty": [("other.txt", b"")],
        }
        for name, content in names.get(kind, []):
            archive.writestr(name, content)
    if kind == "cut":
        whole = zipped(path, my_vo__py=my_vo()).read_bytes()
        path.write_bytes(whole[:200])
    if kind == "damaged":
        damaged = bytearray(zipped(path, my_vo__py=my_vo()).read_bytes())
        damaged[60:80] = bytes(20)
        path.write_bytes(damaged)
    if kind == "encrypted":
        locked = bytearray(zipped(path, my_vo__py=my_vo()).read_bytes())
        for start in (locked.index(b"PK\3\4") + 6, locked.index(b"PK\1\2") + 8):
            locked[start] |= 1
        path.write_bytes(locked)
    return path


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("parent", "a name outside its folder"),
        ("deep parent", "a name outside its folder"),
        ("absolute", "a name outside its folder"),
        ("windows", "a name outside its folder"),
        ("drive", "a name outside its folder"),
        ("link", "a link or a device"),
        ("bomb", "my_vo.py is too large"),
        ("many", f"has {MAX_MEMBERS + 1} files, expected at most {MAX_MEMBERS}"),
        ("twice", "contains my_vo.py twice"),
        ("empty", "contains no my_vo.py and no my_answers.json"),
        ("cut", "is no zip, or it is damaged"),
        ("damaged", "the zip cannot be read"),
        ("encrypted", "the zip cannot be read"),
    ],
)
def test_hostile_zips_are_refused(tmp_path: Path, kind: str, words: str) -> None:
    path = hostile(tmp_path / "eve.zip", kind)
    with pytest.raises(DataError, match=rf"eve\.zip: .*{words}"):
        read_submission("eve", path)
    assert [each.name for each in tmp_path.iterdir()] == ["eve.zip"]


@pytest.mark.parametrize("folder", ["", "work/", "Abgabe/stereo-vo-course/"])
def test_a_zip_may_contain_folders_and_files_of_the_system(tmp_path: Path, folder: str) -> None:
    path = tmp_path / "anna.zip"
    names = ("my_vo.py", "notes.txt", "course/results.py", "00_start_here.ipynb", "deep/00_start_here.ipynb")
    with zipfile.ZipFile(path, "w") as archive:
        for name in names:
            archive.writestr(folder + name, name)
        for name in ("._my_vo.py", "my_vo.py"):
            archive.writestr(f"__MACOSX/{folder}{name}", "")
        for number in range(300):  # a folder of the course has the kit's modules
            archive.writestr(f"{folder}course/module_{number}.py", "")
    files = read_submission("anna", path).files
    assert files == {name: name.encode() for name in ("my_vo.py", "00_start_here.ipynb")}


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (("work/my_vo.py", "work/deep/my_vo.py"), "my_vo.py twice, work/my_vo.py, work/deep/my_vo.py"),
        (("a/my_vo.py", "b/my_answers.json"), "in several folders, a/my_vo.py, b/my_answers.json"),
        (
            ("Abgabe/hand_in.zip", "__MACOSX/my_vo.py"),
            "no my_vo.py and no my_answers.json; found Abgabe/hand_in.zip",
        ),
        ((), "found nothing"),
        (tuple(f"{name}.txt" for name in "abcdefg"), "found a.txt, b.txt, c.txt, d.txt, e.txt and 2 more"),
    ],
)
def test_the_error_about_an_unclear_zip_lists_its_files(
    tmp_path: Path, names: tuple[str, ...], words: str
) -> None:
    path = tmp_path / "anna.zip"
    with zipfile.ZipFile(path, "w") as archive:
        for name in names:
            archive.writestr(name, "")
    with pytest.raises(DataError, match=re.escape(words)):
        read_submission("anna", path)


@pytest.mark.slow  # starts many processes
def test_a_class_becomes_a_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Zips, folders and single files; one that cannot be read does not stop the others."""
    zipped(tmp_path / "anna.zip", my_vo__py=my_vo())
    zipped(tmp_path / "=ben.zip", my_vo__py=my_vo("import time; time.sleep(1000)"))
    hostile(tmp_path / "eve.zip", "parent")
    for name in ("cleo", "dora"):
        (tmp_path / name).mkdir()
    zipped(tmp_path / "cleo" / "hand_in.zip", my_vo__py=my_vo())
    (tmp_path / "dora" / "my_vo.py").write_text(my_vo(), encoding="utf-8")
    table = tmp_path / "marks.csv"
    words = [str(tmp_path), "--chapters", "0,4", "--csv", str(table), "--limit", "2"]
    assert marks.main(words) == 2
    output = capsys.readouterr()
    assert re.search(r"error: .*eve\.zip: contains '../my_vo.py', a name outside its folder", output.err)
    rows = {row["student"]: row for row in csv.DictReader(io.StringIO(table.read_text(encoding="utf-8")))}
    assert {name: row["passed"] for name, row in rows.items()} == {
        "anna": "2",
        "'=ben": "1",
        "cleo": "2",
        "dora": "2",
        "eve": "0",
    }
    assert rows["anna"][functions_to_write()["weights"][0]] == "1"
    assert rows["'=ben"][functions_to_write()["weights"][0]] == "0"
    assert "a name outside its folder" in rows["eve"]["remarks"]
    assert marks.main(["--json", "--chapters", "4", str(tmp_path / "anna.zip")]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["anna"]["exercises"][functions_to_write()["weights"][0]]["passed"] is True
    assert marks.main([str(tmp_path / "nowhere")]) == 2
    assert "is missing: expected a zip" in capsys.readouterr().err


def test_students_have_names_of_their_own(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        zipped(tmp_path / name / "work.zip", my_vo__py="")
    assert [student for student, _ in find_submissions([tmp_path]).students] == ["a/work", "b/work"]


@pytest.mark.slow  # starts many processes
def test_hand_in_contains_what_was_done(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "course"
    assert main(["lab", "--copy-only", "--copy", str(folder)]) == 0
    assert main(["lab", "--hand-in", "--copy", str(folder)]) == 0
    printed = " ".join(capfd.readouterr().out.split())
    assert f"written: {folder / 'hand_in.zip'} It contains marks.json, as last saved." in printed
    assert f"0 of {len(all_tasks())} exercises pass: none" in printed
    assert "note: my_vo.py is missing: no function has passed its check yet" in printed
    (folder / "my_vo.py").write_text(my_vo(), encoding="utf-8")
    (folder / "my_poses.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n", encoding="utf-8")
    notebook = json.loads((folder / "03_solution_selection.ipynb").read_text(encoding="utf-8"))
    notebook["cells"][1]["outputs"] = [{"output_type": "stream", "name": "stdout", "text": "1"}]
    (folder / "03_solution_selection.ipynb").write_text(json.dumps(notebook), encoding="utf-8")
    assert hand_in.main([str(folder), str(folder / "hand_in.zip")]) == 0
    first = (folder / "hand_in.zip").read_bytes()
    assert hand_in.main([str(folder), str(folder / "hand_in.zip")]) == 0
    assert first == (folder / "hand_in.zip").read_bytes()
    with zipfile.ZipFile(folder / "hand_in.zip") as archive:
        names = {"my_vo.py", "my_poses.txt", "marks.json", "03_solution_selection.ipynb"}
        assert {*archive.namelist()} == names
        assert json.loads(archive.read("marks.json"))["passed"] == 2
    capfd.readouterr()
    assert marks.main(["--chapters", "0,4", str(folder / "hand_in.zip")]) == 0
    assert "course: 2 of" in capfd.readouterr().out
    # A file of somebody else stays.
    (tmp_path / "other.zip").write_bytes(b"mine")
    assert hand_in.main([str(folder), str(tmp_path / "other.zip")]) == 2
    assert "is not a zip of --hand-in" in capfd.readouterr().err
    assert (tmp_path / "other.zip").read_bytes() == b"mine"
    shutil.rmtree(folder)
    folder.mkdir()
    assert main(["lab", "--hand-in", "--copy", str(folder)]) == 2


def test_strict_checks_raise(monkeypatch: pytest.MonkeyPatch) -> None:
    """For programs that give marks to cells without an error: a verdict alone would be full marks."""
    monkeypatch.setenv(checker.STRICT, "0")
    right = ch00.depth_error_ratio.right
    assert not ch00.depth_error_ratio(right + 1).passed
    checker.strict()
    assert ch00.depth_error_ratio(right).passed
    for answer in (right + 1, ..., None):
        with pytest.raises(checker.NotRight):
            ch00.depth_error_ratio(answer)
    with pytest.raises(checker.NotRight):
        ch08.better(..., None)  # type: ignore[arg-type]
    checker.strict(False)
    assert not ch00.depth_error_ratio(right + 1).passed


def test_answers_are_written_down_as_json() -> None:
    assert answer_log.as_json(np.float64(2.5)) == 2.5
    assert answer_log.as_json({"a": np.int64(1), "b": 2.0}) == {"a": 1, "b": 2.0}
    assert answer_log.as_json(np.arange(3)) == [0, 1, 2]
    assert answer_log.as_json(np.zeros(1000)) is None
    assert answer_log.as_json(sys) is None
    assert answer_log.as_json({"a": sys}) is None


def in_course(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, source: str) -> Any:
    """A function of a notebook's cell in a folder of the course."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "00_start_here.ipynb").touch()
    cell = tmp_path / "cell.py"
    cell.write_text(source, encoding="utf-8")
    linecache.checkcache()
    here: dict[str, Any] = {"__name__": "__main__"}
    exec(compile(source, str(cell), "exec"), here)
    return here[name]


def handed_in(folder: Path) -> Submission:
    return read_submission("anna", folder)


def test_a_function_with_another_name_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = CHAIN.replace("chain(", "my_chain(").replace("# ---- chain ----\n", "")
    my_chain = in_course(tmp_path, monkeypatch, "my_chain", source)
    assert "saved in `my_vo.py`" in ch00.chain(my_chain).message
    number = functions_to_write()["chain"][0]
    found, remarks = grade(handed_in(tmp_path), chosen_tasks("0"))
    assert (found[number].passed, found[number].found, remarks) == (True, "run", [])
    (tmp_path / "my_answers.json").unlink()
    found, (remark,) = grade(handed_in(tmp_path), chosen_tasks("0"))
    assert found[number].cell == "0"
    assert "my_chain: names of no exercise" in remark


def test_a_function_named_as_an_earlier_answer_is_not_saved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = CHAIN.replace("chain(", "f(").replace("# ---- chain ----\n", "")
    assert "saved in `my_vo.py`" in ch00.chain(in_course(tmp_path, monkeypatch, "f", source)).message
    other = WEIGHTS.partition("\n")[2].replace("weights(", "f(").replace("BODY", "pass")
    verdict = ch04.robust_weight(in_course(tmp_path, monkeypatch, "f", other))
    assert (
        "not saved: in `my_vo.py`, `f` is the answer to ch00.chain; give it another name" in verdict.message
    )
    found, (remark,) = grade(handed_in(tmp_path), chosen_tasks("0,4"))
    assert found[functions_to_write()["chain"][0]].cell == "1"
    assert found[functions_to_write()["weights"][0]].cell == "?"
    assert "`f` is the answer to ch00.chain" in remark


@pytest.mark.parametrize(
    ("source", "why"),
    [
        (
            "panel = object()\ndef weights(r, s):\n    panel\n    return 1 / (1 + (r / s) ** 2)\n",
            "uses `panel`",
        ),
        ("weights = lambda r, s: 1 / (1 + (r / s) ** 2)\n", "its function is not there"),
        ("from course.ch04.exercises import robust_weight as e\nweights = e.right\n", "it is the kit's own"),
    ],
)
def test_a_right_function_that_is_not_saved_has_a_mark_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], source: str, why: str
) -> None:
    assert ch04.robust_weight(in_course(tmp_path, monkeypatch, "weights", source)).passed
    table = tmp_path / "table.csv"
    assert marks.main([str(tmp_path), "--chapters", "4", "--csv", str(table)]) == 0
    (row,) = csv.DictReader(io.StringIO(table.read_text(encoding="utf-8")))
    number = functions_to_write()["weights"][0]
    assert (row[number], row["passed"], row["said"]) == ("?", "0", "0")
    assert f"{number}: right by my_answers.json, but not in my_vo.py" in row["remarks"]
    assert why in row["remarks"]
    assert f"{number}  weights              ? right by" in capsys.readouterr().out


@pytest.mark.slow  # starts many processes
def test_a_right_answer_stays_and_a_later_wrong_one_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    weights = WEIGHTS.partition("\n")[2].replace("BODY", "pass")
    assert ch04.robust_weight(in_course(tmp_path, monkeypatch, "weights", weights)).passed
    assert not ch04.robust_weight(
        in_course(tmp_path, monkeypatch, "weights", weights.replace("1 /", "-1 /"))
    ).passed
    right = ch00.depth_error_ratio.right
    for answer in (right, right + 1):
        ch00.depth_error_ratio(answer)
    _, remarks = grade(handed_in(tmp_path), chosen_tasks("0,4"))
    assert [remark.partition(":")[0] for remark in remarks] == ["0.3", functions_to_write()["weights"][0]]
    assert all("the right answer counts; a later one was not right" in remark for remark in remarks)
    ch00.depth_error_ratio(right)
    assert len(grade(handed_in(tmp_path), chosen_tasks("0"))[1]) == 0


# Ways to hand in the kit's own answer, each for another exercise, so that one process checks them all.
FUNCTIONS_OF_THE_KIT = {
    "weights": "from course.ch04.exercises import robust_weight\nweights = robust_weight.right\n",
    "rows_of_one": "from course.ch04 import exercises as e\n"
    "globals().update({'rows_of_one': e.feature_rows.right})\n",
    "translation_of_one": "import functools\nfrom course.ch04 import exercises as e\n"
    "translation_of_one = functools.partial(e.one_feature.right)\n",
    "translation_of_all": "import functools\nfrom course.ch04 import exercises as e\n"
    "translation_of_all = functools.lru_cache(e.stack.right)\n",
    "depth_weights": "from course.ch04.exercises import depth_weight as depth_weights\n",
    "bias_and_scatter": "from types import FunctionType\nfrom course.ch04.exercises import bias as e\n"
    "bias_and_scatter = FunctionType(e.right.__code__, e.right.__globals__)\n"
    "bias_and_scatter.__module__ = 'my_vo'\n",
}


def test_functions_of_the_kit_have_no_marks() -> None:
    content = "".join(f"# ---- {name} ----\n{source}\n\n" for name, source in FUNCTIONS_OF_THE_KIT.items())
    found, remarks = grade(Submission("eve", {"my_vo.py": content.encode()}), chosen_tasks("4"))
    assert remarks == []
    for name in FUNCTIONS_OF_THE_KIT:
        mark = found[functions_to_write()[name][0]]
        assert (mark.passed, mark.found) == (False, "run"), name
        assert "it is the kit's own function" in mark.says, name


def test_results_cannot_be_written_by_the_student() -> None:
    number = functions_to_write()["weights"][0]
    forged = json.dumps({"number": number, "passed": True, "says": ""})
    body = f"""import glob, os
    for name in ['results.jsonl', *glob.glob('/tmp/*/results.jsonl'), *glob.glob('/proc/self/fd/*')]:
        try:
            with open(name, 'a') as file:
                file.write({forged!r} + chr(10) + '{{"done": true}}' + chr(10))
        except OSError:
            pass
    os._exit(0)"""
    found, _ = grade(Submission("eve", {"my_vo.py": my_vo(body).encode()}), chosen_tasks("0,4"))
    assert not found[number].passed
    assert found[functions_to_write()["chain"][0]].passed


def test_a_verdict_by_the_students_file_alone_has_a_mark_of_its_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = {"ch08.drift": {"passed": True, "answer": 3.0, "says": ""}}
    zipped(tmp_path / "eve.zip", my_vo__py=my_vo(), my_answers__json=json.dumps(said))
    table = tmp_path / "marks.csv"
    assert marks.main([str(tmp_path), "--chapters", "0,4,8", "--csv", str(table)]) == 0
    (row,) = csv.DictReader(io.StringIO(table.read_text(encoding="utf-8")))
    assert (row["8.2"], row[functions_to_write()["chain"][0]], row["8.3"]) == ("said", "1", "0")
    assert (row["passed"], row["said"]) == ("2", "1")
    printed = capsys.readouterr().out
    assert "eve: 2 of 19 pass, 1 more by the student's file alone" in printed
    assert re.search(r"8\.2 +percent +right, by the student's file alone", printed)


@pytest.mark.parametrize(
    ("encoded", "remark"),
    [
        (("# Größe\n" + my_vo()).encode("latin-1"), "line 1 is not in UTF-8, so the file was read as cp1252"),
        (("# coding: latin-1\n# Größe\n" + my_vo()).encode("latin-1"), "so the file was read as latin-1"),
        (("# Größe\n" + my_vo()).encode("utf-16"), "so the file was read as utf-16"),
        (("# Größe\n" + my_vo()).encode("utf-8-sig"), ""),
        (my_vo().encode("utf-8-sig"), ""),
        (my_vo("é = 1").encode("latin-1"), "line 3 is not in UTF-8"),
    ],
)
def test_other_encodings_are_read(tmp_path: Path, encoded: bytes, remark: str) -> None:
    # Chapter 8 has no functions, so that no process starts; the file is read and remarked on all the same.
    _, remarks = grade(Submission("ben", {"my_vo.py": encoded}), chosen_tasks("8"))
    assert len(remarks) == bool(remark)
    assert remark in "".join(remarks)
    (tmp_path / "my_vo.py").write_bytes(encoded)
    definitions = stored_answers.load_functions(tmp_path / "my_vo.py")
    assert ch04.robust_weight.grade(definitions["weights"]).passed
    assert ch00.chain.grade(definitions["chain"]).passed


def test_the_process_gets_a_file_of_another_encoding_as_text() -> None:
    encoded = ("# Größe\n" + my_vo("é = 1")).encode("utf-16")
    found, _ = grade(Submission("ben", {"my_vo.py": encoded}), chosen_tasks("0,4"))
    assert found[functions_to_write()["weights"][0]].passed
    assert found[functions_to_write()["chain"][0]].passed


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("import os; os._exit(3)", "ended the process (exit code 3)"),
        ("while True: pass", "did not end within 2 s"),
        ("import ctypes; ctypes.string_at(0)", "ended the process"),
        ("\0", "SyntaxError"),
    ],
)
@pytest.mark.slow  # starts many processes
def test_a_section_that_ends_the_process_fails_only_itself(line: str, why: str) -> None:
    content = my_vo().replace("# ---- weights ----\n", f"# ---- weights ----\n{line}\n").encode()
    found, (remark,) = grade(Submission("ben", {"my_vo.py": content}), chosen_tasks("0,4"), limit_s=2.0)
    assert found[functions_to_write()["chain"][0]].passed
    assert not found[functions_to_write()["weights"][0]].passed
    assert remark.startswith("my_vo.py, weights")
    assert why in remark


@pytest.mark.slow  # starts many processes
def test_every_student_has_a_row_in_the_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Each entry of the class has a row, or a line that names it."""
    zipped(tmp_path / "UPPER.ZIP", my_vo__py=my_vo())
    for name in ("only_answers", "empty", "texts", "group/ina", "moodle_12", "course"):
        (tmp_path / name).mkdir(parents=True)
    (tmp_path / "only_answers" / "my_answers.json").write_text("{}", encoding="utf-8")
    (tmp_path / "texts" / "a.pdf").write_text("", encoding="utf-8")
    (tmp_path / "course" / "00_start_here.ipynb").write_text("{}", encoding="utf-8")
    zipped(tmp_path / "group" / "ina" / "hand_in.zip", my_vo__py=my_vo())
    (tmp_path / "group" / "jo.rar").write_bytes(b"Rar!")
    zipped(tmp_path / "moodle_12" / "Work.Zip", my_vo__py=my_vo())
    (tmp_path / "moodle_12" / "report.pdf").write_bytes(b"")
    (tmp_path / "my_vo.py").write_text(my_vo(), encoding="utf-8")  # somebody's, not the class's
    (tmp_path / "kim.py").write_text(my_vo(), encoding="utf-8")
    (tmp_path / "script.py").write_text("raise SystemExit(1)", encoding="utf-8")
    for name in ("dora.7z", "emil.tar.gz", "finn.ipynb", ".DS_Store", "list.txt"):
        (tmp_path / name).write_bytes(b"7z")
    (tmp_path / "lost.zip").symlink_to("nowhere.zip")
    table = tmp_path / "marks.csv"
    table.write_text("student,passed\n", encoding="utf-8")  # of an earlier call, and nobody's
    assert marks.main([str(tmp_path), "--chapters", "4", "--csv", str(table)]) == 2
    told = capsys.readouterr()
    rows = {row["student"]: row for row in csv.DictReader(io.StringIO(table.read_text(encoding="utf-8")))}
    solved = {"UPPER", "group/ina", "moodle_12/Work", tmp_path.name, "kim"}
    refused = {"empty", "texts", "group/jo", "script", "dora", "emil.tar", "finn", "lost"}
    assert {*rows} == solved | refused | {"only_answers", "course"}
    assert {name for name, row in rows.items() if row["passed"] == "1"} == solved
    words = re.compile("was not read|is no zip|is missing")
    assert [name for name in refused if not words.search(rows[name]["remarks"])] == []
    assert "found a.pdf" in rows["texts"]["remarks"]
    assert "there is no my_vo.py and no my_answers.json" in rows["course"]["remarks"]
    for name in (".DS_Store", "list.txt", "report.pdf"):
        assert re.search(f"note: not read: .*{re.escape(name)}", told.err)
    assert "marks.csv" not in told.err


@pytest.mark.slow  # starts many processes
def test_two_submissions_of_a_student_are_noted_in_both_rows(tmp_path: Path) -> None:
    for name in ("cleo", "ben"):
        (tmp_path / name).mkdir()
    earlier = json.dumps({"last change": 1_000_000_000.0})
    later = json.dumps({"last change": 1_700_000_000.0})
    zipped(tmp_path / "cleo" / "hand_in.zip", my_answers__json="{}", marks__json=earlier)
    zipped(tmp_path / "cleo" / "hand_in (1).zip", my_answers__json="{}", marks__json=later)
    zipped(tmp_path / "anna.zip", my_answers__json="{}", marks__json=earlier)
    zipped(tmp_path / "Anna (2).zip", my_answers__json="{}", marks__json=earlier)
    zipped(tmp_path / "ben.zip", my_answers__json="{}", marks__json=earlier)
    (tmp_path / "ben" / "my_answers.json").write_text("{}", encoding="utf-8")  # now
    zipped(tmp_path / "dora.zip", my_answers__json="{}")
    (tmp_path / "dora - Copy.zip").write_bytes(b"PK")
    table = tmp_path / "marks.csv"
    assert marks.main([str(tmp_path), "--chapters", "3", "--csv", str(table)]) == 2
    remarks = {
        row["student"].removeprefix(f"{tmp_path}/"): row["remarks"]
        for row in csv.DictReader(io.StringIO(table.read_text(encoding="utf-8")))
    }
    assert "hand_in (1).zip, which is newer: 2023-11" in remarks["cleo/hand_in.zip"]
    assert "hand_in.zip, which is older: 2001-09" in remarks["cleo/hand_in (1).zip"]
    assert "anna.zip; which one is newer cannot be seen" in remarks["Anna (2)"]
    assert "ben.zip, which is older" in remarks["ben"]
    assert "ben, which is newer" in remarks["ben.zip"]
    assert "dora - Copy.zip, which cannot be read" in remarks["dora"]
    assert "is no zip, or it is damaged; also handed in as" in remarks["dora - Copy"]


def test_a_copy_of_the_course_with_its_own_zip_is_one_student(tmp_path: Path) -> None:
    (tmp_path / "anna").mkdir()
    (tmp_path / "anna" / "my_vo.py").write_text(my_vo(), encoding="utf-8")
    zipped(tmp_path / "anna" / "hand_in.zip", my_vo__py=my_vo())
    assert [path.name for _, path in find_submissions([tmp_path]).students] == ["hand_in.zip"]
    (tmp_path / "anna" / "my_vo.py").write_text(my_vo("1"), encoding="utf-8")
    assert [path.name for _, path in find_submissions([tmp_path]).students] == ["hand_in.zip", "anna"]


SLEEPER = "import sys, time; open(sys.argv[1], 'w').write(str(__import__('os').getpid())); time.sleep(600)"


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells which processes a process started")
@pytest.mark.parametrize("end", ["pass", "time.sleep(1000)", "os._exit(1)"])
def test_no_process_of_a_student_is_left(tmp_path: Path, end: str) -> None:
    mine = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
    note = tmp_path / "pid"
    body = f"""import subprocess, sys, os, time
    child = [sys.executable, '-c', {SLEEPER!r}, {str(note)!r}]
    if not os.path.exists({str(note)!r}):
        subprocess.Popen(child, start_new_session=True, env={{}})
        while not (os.path.exists({str(note)!r}) and open({str(note)!r}).read()): time.sleep(0.01)
    {end}"""
    try:
        grade(Submission("eve", {"my_vo.py": my_vo(body).encode()}), chosen_tasks("4"), limit_s=3.0)
        assert not Path(f"/proc/{note.read_text(encoding='utf-8')}").exists()
        assert mine.poll() is None
    finally:
        mine.kill()
        mine.wait()


def test_a_table_that_cannot_be_written_is_refused_before_grading(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    zipped(tmp_path / "anna.zip", my_vo__py=my_vo())
    for table, why in ((tmp_path / "gone" / "marks.csv", "cannot be written"), (tmp_path, "is a folder")):
        assert marks.main([str(tmp_path / "anna.zip"), "--csv", str(table)]) == 2
        told = capsys.readouterr()
        assert why in told.err
        assert told.out == ""
