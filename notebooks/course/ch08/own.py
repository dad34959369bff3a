"""Chapter 8: the student's functions of all chapters; library functions replace missing functions.

Also what the cells in and around the loop need: the matches that go into it (`reporting`, `kept_by`), the solutions
of all sets (`solve_sets`), the residuals (`residuals`), the poses that come out (`usable_path`), a path mixed from
two (`mixed`), and a film (`film`).
"""

from __future__ import annotations

import html
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from vo_lib import preset
from vo_lib.data.sequence import Sequence
from vo_lib.errors import DataError
from vo_lib.geometry.motion import inverse
from vo_lib.geometry.result import FrameResult
from vo_lib.geometry.types import Array, Image, IntArray, Progress
from vo_lib.paper.box_removal import Removal
from vo_lib.paper.five_point import five_point
from vo_lib.report.film import Film, FilmFrame, film_frames
from vo_lib.runs.drive import Run
from vo_lib.runs.front_end import TimedMatches

from ..ch00.exercises import right_chain
from ..ch05.real_drives import line_distances
from ..checker import Exercise
from ..results import Verdict
from ..stored_answers import NAME, load_functions
from ..tasks import functions_to_write
from .limits import TooLong, within
from .stages import LIMIT_S, Endless, StageError, call_stage, ended_within, require_inputs, too_long

# The functions in the order of the loop.
STAGES = (
    "keep_outside",
    "buckets",
    "solve_five",
    "epipolar_distance",
    "truncated_error",
    "select",
    "four_motions",
    "choose_motion",
    "rows_of_one",
    "depth_weights",
    "translation_of_all",
    "weights",
    "chain",
    "all_errors",
)
AFTER_THE_FRAMES = ("chain", "all_errors")
SLOW = 5.0  # a stage is slow above this multiple of the library's time
LEAST_S = 0.1  # processor time of a check; a stage that needs less is never called slow
REPEATS = 3  # measurements of a slow check, of which the shortest counts

# Numbers of the loop in the notebook.
BUCKET = (50, 3)  # the side in pixels, and the number of features
INLIER_PX = 1.0  # largest distance of an inlier from its epipolar line

# Called after each stage of the loop with the frame, the name of the stage, its inputs and its result.
Listener = Callable[[int | None, str, tuple[Any, ...], Any], None]


@dataclass(frozen=True)
class StudentOdometry:
    """The stages as attributes: `mine.select(…)`, or in frame 7 `mine.at(7).select(…)`.

    A stage that stops with an exception, never ends, or returns something that the loop cannot use raises a
    `StageError`, which names the stage, the frame and the reason.

    A stage whose input is not finite or has another shape than expected is not to blame: then the message names
    the lines of the loop between the stage before and this one.

    `whose` : for each stage, "yours" or the reason for the library's function. `slow` : ratio of your
    function's processor time to the library function's. `limit_s` : longest time of one call. `called` : the
    stages that were called in this frame.
    """

    functions: Mapping[str, Any]
    whose: Mapping[str, str]
    slow: Mapping[str, float]
    limit_s: float = LIMIT_S
    frame: int | None = None
    listener: Listener | None = None
    called: list[str] = field(default_factory=list)

    def __getattr__(self, name: str) -> Any:
        if name not in STAGES:
            raise AttributeError(f"no stage is called {name}; there are {', '.join(STAGES)}")
        return partial(self.run_stage, name)

    def run_stage(self, name: str, *inputs: Any) -> Any:
        """The result of a stage; `StageError` if it has none."""
        self.require_inputs(name, inputs)
        function = self.functions[name]
        result = call_stage(name, self.whose[name], self.frame, function, *inputs, limit_s=self.limit_s)
        if self.listener is not None:
            self.listener(self.frame, name, inputs, result)
        return result

    def require_inputs(self, name: str, inputs: tuple[Any, ...], sets: bool = False) -> None:
        """`StageError` if an input is not fit for a stage, which then counts as called in this frame.

        sets : whether the inputs are those of several calls, with a first axis for the calls.
        """
        if self.frame is None and name not in AFTER_THE_FRAMES:
            return  # a call outside a loop, to try something
        before = self.called[-1] if self.called else ""
        require_inputs(name, inputs, self.frame, before, sets)
        self.called.append(name)

    def at(self, frame: int) -> StudentOdometry:
        """The same stages for the calls of one frame; messages name this frame."""
        return replace(self, frame=frame, called=[])

    @property
    def facts(self) -> dict[str, float]:
        """Number of stages from the library, for the check."""
        return {"borrowed": float(sum(words != "yours" for words in self.whose.values()))}

    @property
    def name(self) -> str:
        """Name of an odometry with these stages: "yours" only if all stages are the student's."""
        own = len(STAGES) - int(self.facts["borrowed"])
        return "yours" if own == len(STAGES) else f"{own} of {len(STAGES)} stages yours"

    def _repr_html_(self) -> str:
        rows = ["<tr><th>exercise</th><th>stage</th><th>whose</th></tr>"]
        for name, words in self.whose.items():
            number, _ = functions_to_write()[name]
            if name in self.slow:
                words = f"{words}, slow: {self.slow[name]:.0f} times the library's time"
            rows.append(
                f"<tr><td>{number}</td><td><code>{name}</code></td><td>{html.escape(words)}</td></tr>"
            )
        return f"<table>{''.join(rows)}</table>"


def join(limit_s: float = LIMIT_S, **given: Any) -> StudentOdometry:
    """Each stage from `given` or `my_vo.py` if the function passes its check, otherwise from the library.

    given : functions in place of those of the file, or None for the library's.
    limit_s : longest time of one check, of the file itself, and later of one call in the loop, seconds.

    Raises `DataError` if the file cannot be run, or does not end.
    """
    path = Path(NAME)
    try:
        written = {**within(limit_s, load_functions, path), **given}
    except TooLong as error:
        raise DataError(too_long(limit_s, error), path) from None
    exercises = functions_to_write()
    functions = {}
    whose = {}
    slow = dict[str, float]()
    for name in STAGES:
        own = written.get(name)
        _, exercise = exercises[name]
        start = time.thread_time()
        verdict = _checked(exercise, own, limit_s) if callable(own) else None
        seconds = time.thread_time() - start
        passed = verdict is not None and verdict.passed
        functions[name] = own if passed else exercise.right
        why = f"not in {NAME} yet"
        if verdict is not None:
            why = f"yours fails its check: {verdict.message}"
        elif name in given:
            why = "as you asked"
        whose[name] = "yours" if passed else f"the library's: {why}"
        if passed and seconds > LEAST_S:
            ratio = _shortest(exercise, own) / _shortest(exercise, exercise.right)
            if ratio > SLOW:
                slow[name] = ratio
    return StudentOdometry(functions, whose, slow, limit_s)


def _checked(exercise: Exercise, own: Any, limit_s: float) -> Verdict:
    """The verdict of a check; not passed if the function does not end."""
    with warnings.catch_warnings():  # an interrupted check may leave its own filter of warnings behind
        verdict = ended_within(limit_s, exercise.grade, own)
    if isinstance(verdict, Endless):
        return Verdict(False, f"it {verdict.message}")
    return verdict


def _shortest(exercise: Exercise, function: Any) -> float:
    """The shortest processor time of several checks of a function, seconds.

    Other programs of the computer do not count, and the first call of a function is often the slowest.
    """
    times = []
    for _ in range(REPEATS):
        start = time.thread_time()
        exercise.grade(function)
        times.append(time.thread_time() - start)
    return max(min(times), 1e-6)  # a clock may have coarse steps


def usable_path(path: Any, frames: int) -> Array:
    """The poses (frames, 4, 4) that a loop returned; `StageError`, with the likely reason, if they are none."""
    if path is None:
        raise StageError("your loop returns None: is there a `return` at its end?")
    try:
        poses = np.asarray(path, np.float64)
    except (TypeError, ValueError):
        raise StageError(f"your loop returns no poses ({frames}, 4, 4), but {type(path).__name__}") from None
    if poses.shape[1:] == (4, 4) and len(poses) != frames:
        words = f"your loop returns {len(poses)} poses for {frames} frames"
        if len(poses) == frames - 1:
            words += ": the first frame has a pose too, the identity, and `chain` begins with it"
        elif len(poses) < frames:
            words += ": each frame but the first adds one motion, also where the loop goes on with `continue`"
        raise StageError(words)
    if poses.shape != (frames, 4, 4):
        raise StageError(f"your loop returns the shape {poses.shape}, not poses ({frames}, 4, 4)")
    wrong = np.flatnonzero(~np.isfinite(poses).all(axis=(1, 2)))
    if len(wrong):
        raise StageError(f"your loop returns poses with NaN or infinity, from frame {wrong[0]} on")
    return poses


def reporting(matches: Iterable[TimedMatches], report: Progress, frames: int) -> Iterator[TimedMatches]:
    """The same matches of `frames` frames; `report` hears of each frame when the next one is requested."""
    for number, each in enumerate(matches, start=1):
        yield each
        report(number, frames)


def kept_by(run: Run, matches: Iterable[TimedMatches]) -> list[TimedMatches]:
    """The matches of each frame that the box rule kept in a finished run of variant `kit`."""
    given = list(matches)
    kept = [given[0]]  # frame 0 has no matches
    for shown in film_frames(run, given):
        kept.append((shown.matches[shown.removal.kept], {}))
    return kept


def solve_sets(mine: StudentOdometry, x_p: Array, x_c: Array) -> tuple[Array, IntArray]:
    """Essential matrices (M, 3, 3) of S five-point sets x_p, x_c (S, 5, 2), and the index (M,) of their sets.

    Your solver is called once per set. The library's solver is called once for all sets and is much faster.

    Raises `StageError` if no set has a solution.
    """
    mine.require_inputs("solve_five", (x_p, x_c), sets=True)
    if mine.whose["solve_five"] != "yours":
        solved = five_point(x_p, x_c)
        E = solved.E
        set_index = solved.set_index
    else:
        # A listener hears of all sets at once.
        alone = replace(mine, listener=None)
        of_sets = [alone.solve_five(*five) for five in zip(x_p, x_c, strict=True)]
        E = np.concatenate([np.zeros((0, 3, 3)), *of_sets])
        set_index = np.repeat(np.arange(len(of_sets)), [len(each) for each in of_sets])
    if mine.listener is not None:
        mine.listener(mine.frame, "solve_five", (x_p, x_c), E)
    if len(E) == 0:
        raise StageError(f"frame {mine.frame}: `solve_five` finds no solution for any of {len(x_p)} sets")
    return E, set_index


def mixed(rotations: Array, translations: Array) -> Array:
    """A path (N, 4, 4) whose steps have the rotations of one path (N, 4, 4) and the translations of another."""
    T_cp = inverse(rotations[1:]) @ rotations[:-1]
    other = inverse(translations[1:]) @ translations[:-1]
    T_cp[:, :3, 3] = other[:, :3, 3]
    return np.array(right_chain(T_cp))


def residuals(M: Array, c: Array, t: Array) -> Array:
    """Residuals (N,) of the rows M (N, 8, 6) and c (N, 8) of N features for t (3,), with the best point Q."""
    A = M[..., :3]
    d = c - M[..., 3:] @ t
    rest = d[..., None] - A @ (np.linalg.pinv(A) @ d[..., None])
    return np.asarray(np.linalg.norm(rest[..., 0], axis=1))


def film(
    path: Path,
    mine: StudentOdometry,
    sequence: Sequence,
    matches: Iterable[TimedMatches],
    poses: Array,
    every: int,
) -> Image:
    """Write a film of poses (N, 4, 4) and of the features that your stages keep, from each `every`-th frame.

    Returns the last picture of the film, BGR.
    """
    run = Run(sequence, preset("feature_selection"), poses, [])
    with Film(path, run, "your path and features") as made, np.errstate(all="ignore"):
        for index, (pair, _) in enumerate(matches):
            if index == 0 or index % every:
                continue
            before = sequence.boxes(index - 1)
            boxes = sequence.boxes(index)
            stage = mine.at(index)
            keep = stage.keep_outside(pair.prev_left, pair.cur_left, before.xyxy, boxes.xyxy)
            outside = pair[keep]
            used = outside[stage.buckets(outside.cur_left, outside.age, outside.strength, *BUCKET)]
            T_cp = inverse(poses[index]) @ poses[index - 1]
            near = line_distances(sequence, used, T_cp) < INLIER_PX
            motion = FrameResult(
                T_cp,
                matches=len(pair),
                removed=int(np.sum(~keep)),
                used=len(used),
                inliers=int(np.sum(near)),
            )
            shown = FilmFrame(index, pair, Removal(keep, boxes), motion)
            made.add(shown)
    return made.picture(shown)
