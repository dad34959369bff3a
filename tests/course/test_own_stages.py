"""Chapter 8 names a stage that fails in the loop, with its frame, and a fault in the lines between stages."""

from __future__ import annotations

import contextlib
import json
import math
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import small, winding_road

from course.ch08 import own
from course.ch08.limits import TooLong, within
from course.ch08.loop import first_difference, library_loop
from course.ch08.stages import StageError
from vo_lib.data.sequence import Sequence
from vo_lib.errors import DataError
from vo_lib.evaluation.kitti_errors import trajectory_distances
from vo_lib.evaluation.statistics import mean_and_deviation
from vo_lib.report.page import plus_minus
from vo_lib.runs.front_end import TimedMatches
from vo_lib.runs.match_cache import CachedMatches

NOTEBOOK = Path(__file__).resolve().parents[2] / "notebooks" / "08_your_own_odometry.ipynb"
SHORT_S = 0.3


def endless(*_: Any) -> None:
    while True:
        pass


def asleep(*_: Any) -> None:
    time.sleep(1000)


def endless_with_a_bare_except(*_: Any) -> None:
    while True:
        try:
            math.sqrt(-1)
        except:  # noqa: E722
            time.sleep(0)


def endless_with_a_short_handler(*_: Any) -> None:
    while True:
        try:
            np.linalg.inv(np.eye(60))
        except BaseException:
            continue


def endless_with_handlers_within_handlers(*_: Any) -> None:
    while True:
        try:
            endless_with_a_short_handler()
        except:  # noqa: E722
            try:
                sorted(range(100), key=lambda value: -value)
            except:  # noqa: E722
                continue
        finally:
            continue  # noqa: B012


def endless_with_suppressed_errors(*_: Any) -> None:
    while True:
        with contextlib.suppress(BaseException):
            sum(range(1000))


@pytest.fixture(autouse=True)
def _a_stubborn_function_is_soon_interrupted_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """It computes until then."""
    monkeypatch.setattr("course.ch08.limits.AGAIN_S", SHORT_S)


@pytest.fixture(scope="module")
def turning(street: Sequence) -> tuple[Sequence, list[TimedMatches]]:
    part = street.part(30, 36)
    return part, list(CachedMatches(part, small()))


def with_stages(**functions: Any) -> own.StudentOdometry:
    """An odometry whose checks are left out: these functions are the student's."""
    library = own.join()
    whose = {**library.whose, **dict.fromkeys(functions, "yours")}
    return replace(library, functions={**library.functions, **functions}, whose=whose, limit_s=SHORT_S)


STUBBORN = endless_with_a_short_handler, endless_with_handlers_within_handlers, endless_with_suppressed_errors


@pytest.mark.parametrize("function", [endless, asleep, endless_with_a_bare_except, *STUBBORN])
def test_a_call_without_an_end_is_interrupted_on_any_thread(function: Callable[..., None]) -> None:
    before = sys.gettrace()
    with pytest.raises(TooLong):
        within(SHORT_S, function)
    assert sys.gettrace() is before
    if function is asleep:
        return  # another thread is interrupted before its next line of Python only
    found = list[str]()

    def on_a_thread() -> None:
        try:
            within(SHORT_S, function)
        except TooLong:
            found.append("interrupted")

    thread = threading.Thread(target=on_a_thread)
    thread.start()
    thread.join(60)
    assert found == ["interrupted"]
    assert sys.gettrace() is before
    assert within(SHORT_S, max, 3, 5) == 5  # and nothing is left behind that would interrupt this


def test_a_handler_that_catches_the_interruption_is_reported() -> None:
    mine = own.join(limit_s=SHORT_S, weights=STUBBORN[0], chain=endless)
    assert "its `except:` catches even the interruption" in mine.whose["weights"]
    assert "is there a loop without an end?" in mine.whose["chain"]


def test_a_call_within_its_time_returns_and_leaves_no_timer() -> None:
    assert within(SHORT_S, max, 3, 5) == 5
    with pytest.raises(ZeroDivisionError):
        within(SHORT_S, lambda: 1 / 0)
    time.sleep(2 * SHORT_S)  # a timer that is left would interrupt this


def test_limits_are_nested() -> None:
    def slow() -> None:
        assert within(60, max, 3, 5) == 5
        endless()

    with pytest.raises(TooLong):
        within(SHORT_S, slow)


def in_third_frame(stage: str, fault: Callable[..., Any]) -> Any:
    """The library's stage, with a fault from its third call on; one call a frame is expected."""
    right = own.join().functions[stage]
    calls = list[int]()

    def function(*inputs: Any) -> Any:
        calls.append(1)
        return fault(*inputs) if len(calls) > 2 else right(*inputs)

    return function


def stops(*_: Any) -> Any:
    raise ValueError("no such match")


@pytest.mark.parametrize(
    ("stage", "fault", "words"),
    [
        ("buckets", stops, "stopped with ValueError: no such match"),
        ("buckets", endless, "does not end within 0.3 s"),
        ("buckets", lambda *_: None, "returns None"),
        ("buckets", lambda uv, *_: [len(uv)], "is no index of"),
        ("buckets", lambda uv, *_: uv, "returns the shape"),
        ("buckets", lambda *_: exit(), "calls `exit`"),
        ("keep_outside", lambda uv, *_: uv[:, 0] * math.nan, "returns NaN or infinity in"),
        ("keep_outside", lambda uv, *_: np.flatnonzero(uv[:, 0] > 300), "returns the shape"),
        ("select", lambda E, *_: -1, "returns -1, which is no index of"),
        (
            "four_motions",
            lambda E: np.full((4, 3, 4), math.inf),
            "returns NaN or infinity in 48 of 48 numbers",
        ),
        ("depth_weights", lambda Z: [[1.0], [2.0, 3.0]], "returns rows of different lengths"),
    ],
)
def test_a_stage_that_fails_in_the_loop_is_named_with_its_frame(
    turning: tuple[Sequence, list[TimedMatches]], stage: str, fault: Callable[..., Any], words: str
) -> None:
    sequence, matches = turning
    mine = with_stages(**{stage: in_third_frame(stage, fault)})
    frame = 4 if stage == "select" else 3  # the first frame has no previous essential vector
    with pytest.raises(StageError, match=rf"^frame {frame}: your `{stage}` ") as caught:
        library_loop(sequence, matches, odometry=mine)
    assert words in str(caught.value)
    assert f"own.join({stage}=None)" in str(caught.value)


@pytest.mark.parametrize(
    ("result", "words"),
    [
        (None, "returns None"),
        (1.0, "does not return 2 results"),
        ([1.0, 2.0, 3.0], "does not return 2 results"),
        ([1.0, None], "returns no real numbers, but NoneType"),
        ([np.ones(3), 1.0], "returns the shape (3,), not ()"),
        ([1.0, math.nan], "returns NaN or infinity in 1 of 1 numbers"),
    ],
)
def test_errors_of_another_form_are_refused(result: Any, words: str) -> None:
    """They used to reach the table of the cell as they were."""
    path = winding_road(30, 0.01, 1.0)
    with pytest.raises(StageError, match=r"^after the last frame: your `all_errors` ") as caught:
        with_stages(all_errors=lambda *_: result).all_errors(path, path, (10,), 1)
    assert words in str(caught.value)


def test_errors_are_two_numbers_whether_yours_or_the_librarys() -> None:
    path = winding_road(30, 0.01, 1.0)
    other = winding_road(30, 0.012, 1.0)
    library = np.array(own.join().all_errors(path, other, (10,), 1))
    assert library.shape == (2,)
    assert library.min() > 0
    for form in (list, tuple, np.asarray):
        mine = with_stages(all_errors=lambda *_, form=form: form(library))
        np.testing.assert_array_equal(np.array(mine.all_errors(path, other, (10,), 1)), library)


def test_a_stage_may_return_lists_sets_and_numbers_of_one_entry(
    turning: tuple[Sequence, list[TimedMatches]],
) -> None:
    sequence, matches = turning
    library = own.join()
    right = library.functions
    mine = with_stages(
        keep_outside=lambda *x: [int(each) for each in right["keep_outside"](*x)],
        buckets=lambda *x: set(right["buckets"](*x)),
        truncated_error=lambda *x: [right["truncated_error"](*x)],
        select=lambda *x: float(right["select"](*x)),
        rows_of_one=lambda *x: [each.tolist() for each in right["rows_of_one"](*x)],
    )
    path = library_loop(sequence, matches, odometry=mine)
    # A set has another order of features, and the sets of five are drawn from it.
    np.testing.assert_allclose(path, library_loop(sequence, matches, odometry=library), atol=0.05)


def test_endless_functions_fail_and_endless_files_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    text = "# ---- weights ----\ndef weights(r, s):\n    while True: pass\n"
    text += "# ---- depth_weights ----\ndef depth_weights(Z): return exit()\n"
    (tmp_path / "my_vo.py").write_text(text, encoding="utf-8")
    mine = own.join(limit_s=SHORT_S, chain=None)
    assert "does not end within 0.3 s" in mine.whose["weights"]
    assert "calls `exit`" in mine.whose["depth_weights"]
    assert mine.whose["chain"] == "the library's: as you asked"
    assert mine.facts["borrowed"] == len(own.STAGES)
    (tmp_path / "my_vo.py").write_text("while True: pass\n", encoding="utf-8")
    with pytest.raises(DataError, match=r"my_vo\.py: does not end within 0\.3 s"):
        own.join(limit_s=SHORT_S)


def loop_of_the_notebook(mine: own.StudentOdometry, *changes: tuple[str, str]) -> Callable[..., Any]:
    """The function `drive` of the notebook, with some of its text changed."""
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    source = next(
        text for text in ("".join(cell["source"]) for cell in cells) if text.startswith("def drive(")
    )
    for old, new in changes:
        assert source.count(old) == 1, old
        source = source.replace(old, new)
    names: dict[str, Any] = {"np": np, "own": own, "mine": mine}
    exec(source, names)
    made: Callable[..., Any] = names["drive"]
    return made


def test_the_loop_of_the_notebook_is_composed_as_the_librarys(
    turning: tuple[Sequence, list[TimedMatches]],
) -> None:
    sequence, matches = turning
    mine = own.join()
    path = loop_of_the_notebook(mine)(sequence, matches)
    np.testing.assert_array_equal(path, library_loop(sequence, matches, odometry=mine))
    assert first_difference(loop_of_the_notebook(mine), mine, sequence, matches) == ""


KEEP = "        pair = pair[stage.keep_outside(pair.prev_left, pair.cur_left, *boxes)]\n"
E_PREV = "        e_prev = E[winner].ravel() / np.linalg.norm(E[winner])\n"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("([R_cp, t_cp])", "([R_cp.T, t_cp])", "`chain` gets another `motions`*its rotation is transposed"),
        ("([R_cp, t_cp])", "([R_cp, -t_cp])", "`chain` gets*its translation has the opposite sign"),
        ("append(T_cp)", "append(np.linalg.inv(T_cp))", "`chain` gets*it is inverted"),
        (KEEP, "", "frame 1: your loop does not call `keep_outside`"),
        (KEEP, KEEP.replace(" pair = ", " _ = "), "frame 1: `buckets` gets another `uv`*rows instead of"),
        ("*each, R_cp, camera", "*each, R_cp.T, camera", "frame 1: `rows_of_one` gets*it is transposed"),
        (E_PREV, "", "frame 2: your loop does not call `select`"),
        ("e_prev, 2)", "e_prev, 1)", "frame 2: `select` gets another `k`*it is 1, not 2"),
        ("camera.baseline)", "2 * camera.baseline)", "`rows_of_one` gets another `b`*it is"),
        ("by_depth * stage.weights", "stage.weights", "`translation_of_all` gets another `w`"),
        ("in range(4)", "in range(2)", "calls `translation_of_all` 2 times, the library's 4 times"),
        (
            "(odometry.chain(motions))",
            "(odometry.chain(motions))[:, ::-1]",
            "other poses than those of `chain`",
        ),
        ("(odometry.chain(motions))", "(odometry.chain(motions))[::-1]", "it is in the opposite order"),
        (
            "(odometry.chain(motions))",
            "(odometry.chain(motions[::-1]))",
            "`chain` gets*in the opposite order",
        ),
        ("(odometry.chain(motions))", "(odometry.chain(motions[1:]))", "`chain` gets*first entry is missing"),
        ("(odometry.chain(motions))", "(odometry.chain(motions))[1:]", "its first entry is missing"),
        (
            "([R_cp, t_cp])",
            "([R_cp.T, -t_cp])",
            "`chain` gets*transposed and its translation has the opposite",
        ),
        ("(frame - 1, frame)]", "(frame, frame + 1)]", "`keep_outside` gets*`boxes_p`*it is that of frame 2"),
        ("cur_left, *boxes)", "cur_left, *boxes[::-1])", "`boxes_p` and `boxes_c` in exchanged places"),
        ("(each, x[0], x[2])", "(each, x[2], x[0])", "`x_p` and `x_c` in exchanged places"),
        (
            "(each, x[0], x[2])",
            "(each, x[1], x[2])",
            "*of the previous right image, not of the previous left",
        ),
        (
            "(stage, x[0][fives], x[2]",
            "(stage, x[0][fives], x[3]",
            "`solve_five` gets*the current right image",
        ),
        (
            "[pair.prev_left, pair.prev_right, ",
            "[pair.prev_right, pair.prev_left, ",
            "`solve_five` gets*`x_p`*of the previous right image, not of the previous left image",
        ),
        (
            "pair.prev_left, pair.prev_right)\n        # Ch",
            "pair.cur_left, pair.cur_right)\n        # Ch",
            "current frame",
        ),
        ("zip(*kept)", "zip(*kept[::-1])", "`x_pl` and `x_cr` in exchanged"),
    ],
)
def test_a_fault_of_composition_is_named(
    turning: tuple[Sequence, list[TimedMatches]], old: str, new: str, words: str
) -> None:
    sequence, matches = turning
    mine = own.join()
    found = first_difference(loop_of_the_notebook(mine, (old, new)), mine, sequence, matches)
    for part in words.split("*"):
        assert part in found


INLINE = (
    "    return np.array(odometry.chain(motions))",
    "    poses = [np.eye(4)]\n"
    "    for T in motions:\n"
    "        poses.append(poses[-1] @ np.linalg.inv(T))\n"
    "    return np.array(poses)",
)


def test_a_loop_may_chain_its_motions_by_lines_of_its_own(
    turning: tuple[Sequence, list[TimedMatches]],
) -> None:
    sequence, matches = turning
    mine = own.join()
    assert first_difference(loop_of_the_notebook(mine, INLINE), mine, sequence, matches) == ""
    for old, new, words in (
        ("np.linalg.inv(T)", "T", "of the motions between them, it is inverted"),
        ("poses[-1] @ np.linalg.inv(T)", "np.linalg.inv(T) @ poses[-1]", "other poses than those of `chain`"),
    ):
        wrong = (INLINE[0], INLINE[1].replace(old, new))
        found = first_difference(loop_of_the_notebook(mine, wrong), mine, sequence, matches)
        assert words in found


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "*each, R_cp, camera.baseline",
            "*each, R_cp * np.nan, camera.baseline",
            "frame 1: the lines of the loop between `choose_motion` and `rows_of_one` make a wrong `R_cp`: "
            "it has NaN or infinity in 9 of 9 numbers",
        ),
        (
            "stage.depth_weights(X_p[good, 2])",
            "stage.depth_weights(X_p[good])",
            "between `rows_of_one` and `depth_weights` make a wrong `Z`: it has the shape",
        ),
        ("(each, x[0], x[2])", "(each, x[0][:9], x[2])", "between `solve_five` and `epipolar_distance`"),
        (
            "x[0][good], x[2][good])",
            "x[0][good], x[2])",
            "`choose_motion` make a wrong `x_c`: it has the shape",
        ),
        (" & (X_p[:, 2] < 100)", " & (X_p[:, 2] < 0)", "make a wrong `x_p`: it is empty: no feature is left"),
        (
            "        T_cp[:3] =",
            "        T_cp[:3] = np.nan *",
            "after the last frame: the lines of the loop before `chain`",
        ),
        (
            "append(T_cp)",
            "append(T_cp[:3])",
            "before `chain` make a wrong `motions`: it has the shape (5, 3, 4), not (5, 4, 4)",
        ),
    ],
)
def test_a_wrong_input_is_blamed_on_the_lines_before_the_stage(
    turning: tuple[Sequence, list[TimedMatches]], old: str, new: str, words: str
) -> None:
    sequence, matches = turning
    mine = own.join()
    with pytest.raises(StageError) as caught:
        loop_of_the_notebook(mine, (old, new))(sequence, matches)
    assert words in str(caught.value)
    assert "no stage is to blame" in str(caught.value)


@pytest.mark.parametrize(
    ("path", "words"),
    [
        (None, "returns None: is there a `return`"),
        (np.zeros((4, 4, 4)), "4 poses for 5 frames: the first frame has a pose too"),
        (np.zeros((2, 4, 4)), "2 poses for 5 frames: each frame but the first adds one motion"),
        (np.zeros((7, 4, 4)), "7 poses for 5 frames"),
        (np.zeros((5, 3, 4)), r"the shape (5, 3, 4), not poses (5, 4, 4)"),
        (np.full((5, 4, 4), math.nan), "NaN or infinity, from frame 0 on"),
        ([[1.0], [2.0, 3.0]], "no poses (5, 4, 4), but list"),
        ("a path", "no poses (5, 4, 4), but str"),
    ],
)
def test_a_loop_that_returns_no_path_is_refused(path: Any, words: str) -> None:
    with pytest.raises(StageError) as caught:
        own.usable_path(path, 5)
    assert words in str(caught.value)


def test_poses_of_any_kind_of_list_are_a_path() -> None:
    np.testing.assert_array_equal(own.usable_path([np.eye(4)] * 3, 3), np.tile(np.eye(4), (3, 1, 1)))


@pytest.mark.parametrize(("step", "words"), [(1.0, "errors over 20 m"), (0.4, "errors over 10 m")])
def test_errors_are_over_pieces_that_fit_the_thirty_frames(
    step: float, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    source = next(text for text in ("".join(cell["source"]) for cell in cells) if "def errors_of(" in text)
    right = winding_road(30, 0.01, step)
    names: dict[str, Any] = {
        "np": np,
        "mine": own.join(),
        "right": right,
        "street": None,
        "known": True,
        "paths": {"a path": [right, winding_road(30, 0.012, step)]},
        "trajectory_distances": trajectory_distances,
        "plus_minus": plus_minus,
        "mean_and_deviation": mean_and_deviation,
    }
    exec(source, names)
    printed = capsys.readouterr().out
    assert words in printed
    assert "nan" not in printed
