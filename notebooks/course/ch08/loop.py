"""Chapter 8: the loop as the library composes it, and the first step at which another loop differs from it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any

import numpy as np

from vo_lib.data.sequence import Sequence
from vo_lib.geometry.camera import StereoCamera
from vo_lib.geometry.matches import StereoMatches
from vo_lib.geometry.types import Array
from vo_lib.runs.front_end import TimedMatches

from .own import STAGES, StudentOdometry, residuals, solve_sets
from .stages import named_inputs

SETS = 30
NEAREST = 2  # solutions of a set that are near the previous essential vector
SCALE_PX = 0.5
ROUNDS = 4
MIN_MATCHES = 12
STILL_PX = 0.5
FARTHEST_M = 100.0
FIRST_FRAMES = 4  # most differences show in these; only without one, all frames are compared
CLOSE = 1e-6  # relative difference of equal numbers


def library_loop(
    sequence: Sequence, matches: Iterable[TimedMatches], seed: int = 0, *, odometry: StudentOdometry
) -> Array:
    """Poses (N, 4, 4) by the stages of an odometry, composed as in the loop that chapter 8 begins with."""
    rng = np.random.default_rng(seed)
    e_prev: Array | None = None
    motions = []
    for frame, (pair, _) in enumerate(matches):
        if frame > 0:
            T_cp, e_prev = _motion(sequence, pair, frame, odometry.at(frame), rng, e_prev)
            motions.append(T_cp)
    return np.asarray(odometry.chain(motions))


def _motion(
    sequence: Sequence,
    pair: StereoMatches,
    frame: int,
    stage: StudentOdometry,
    rng: np.random.Generator,
    e_prev: Array | None,
) -> tuple[Array, Array | None]:
    """The motion T_cp (4, 4) of a frame, and the essential vector (9,) of its winner."""
    camera = sequence.camera
    before = sequence.boxes(frame - 1)
    now = sequence.boxes(frame)
    pair = pair[stage.keep_outside(pair.prev_left, pair.cur_left, before.xyxy, now.xyxy)]
    pair = pair[stage.buckets(pair.cur_left, pair.age, pair.strength, 50, 3)]
    moved = np.linalg.norm(pair.cur_left - pair.prev_left, axis=1)
    if len(pair) < MIN_MATCHES or np.median(moved) < STILL_PX:
        return np.eye(4), e_prev
    x_p = camera.normalise(pair.prev_left)
    x_c = camera.normalise(pair.cur_left)
    X_p = camera.triangulate(pair.prev_left, pair.prev_right)
    fives = [rng.choice(len(pair), 5, replace=False) for _ in range(SETS)]
    E, set_index = solve_sets(stage, x_p[fives], x_c[fives])
    distances = np.array([stage.epipolar_distance(each, x_p, x_c) for each in E])
    errors = np.array([stage.truncated_error(each, 1 / camera.f) for each in distances])
    winner = np.argmin(errors) if e_prev is None else stage.select(E, set_index, errors, e_prev, NEAREST)
    good = (distances[winner] < 1 / camera.f) & (X_p[:, 2] < FARTHEST_M)
    R_cp = stage.choose_motion(stage.four_motions(E[winner]), x_p[good], x_c[good])[:, :3]
    T_cp = np.eye(4)
    T_cp[:3, :3] = R_cp
    T_cp[:3, 3] = _translation(camera, pair[good], X_p[good, 2], R_cp, stage)
    return T_cp, E[winner].ravel() / np.linalg.norm(E[winner])


def _translation(
    camera: StereoCamera, pair: StereoMatches, depth: Array, R_cp: Array, stage: StudentOdometry
) -> Array:
    """t_cp (3,), metres, by weighted least squares over the rows of all features."""
    views = (pair.prev_left, pair.prev_right, pair.cur_left, pair.cur_right)
    points = zip(*(camera.normalise(uv) for uv in views), strict=True)
    rows = [stage.rows_of_one(*four, R_cp, camera.baseline) for four in points]
    M = np.array([left for left, _ in rows])
    c = np.array([right for _, right in rows])
    by_depth = stage.depth_weights(depth)
    w = by_depth
    for _ in range(ROUNDS):
        t_cp = stage.translation_of_all(M[..., :3], M[..., 3:], c, w)
        in_pixels = camera.f * np.sqrt(by_depth) * residuals(M, c, t_cp)
        w = by_depth * stage.weights(in_pixels, SCALE_PX)
    return np.asarray(t_cp)


@dataclass(frozen=True)
class Call:
    """A call of a stage in a loop."""

    frame: int | None
    name: str
    inputs: tuple[Any, ...]
    result: Any


def first_difference(
    drive: Callable[..., Any], mine: StudentOdometry, sequence: Sequence, matches: list[TimedMatches]
) -> str:
    """A sentence on the first step at which `drive` differs from `library_loop` with the same stages; else "".

    drive : called as drive(sequence, matches, odometry=…) with odd numbers of frames; seed 0.
    """
    for frames in (min(FIRST_FRAMES, len(matches)), len(matches)):
        some = matches[:frames]
        own_calls, own_path = heard(drive, mine, sequence, some)
        calls, path = heard(library_loop, mine, sequence, some)
        words = _compared(own_calls, calls)
        if words:
            return words
        if not _equal(own_path, path):
            return "all stages get the same inputs, but the loop returns other poses than those of `chain`"
    return ""


def heard(
    drive: Callable[..., Any], mine: StudentOdometry, sequence: Sequence, matches: list[TimedMatches]
) -> tuple[list[Call], Any]:
    """The calls of the stages in a loop, in order, and the path that the loop returns."""
    calls: list[Call] = []

    def listen(frame: int | None, name: str, inputs: tuple[Any, ...], result: Any) -> None:
        calls.append(Call(frame, name, inputs, result))

    path = drive(sequence, matches, odometry=replace(mine, listener=listen))
    return calls, path


def _compared(own: list[Call], library: list[Call]) -> str:
    """The first difference between the calls of two loops, frame by frame, in the order of the stages."""
    own_frames = _by_frame(own)
    for frame, calls in _by_frame(library).items():
        own_calls = own_frames.get(frame, {})
        when = "after the last frame" if frame is None else f"frame {frame}"
        for name in STAGES:
            words = _of_stage(name, own_calls.get(name, []), calls.get(name, []))
            if words:
                return f"{when}: {words}"
    return ""


def _by_frame(calls: list[Call]) -> dict[int | None, dict[str, list[Call]]]:
    frames: dict[int | None, dict[str, list[Call]]] = {}
    for frame, group in groupby(calls, key=lambda call: call.frame):
        stages = frames.setdefault(frame, {})
        for call in group:
            stages.setdefault(call.name, []).append(call)
    return frames


def _of_stage(name: str, own: list[Call], library: list[Call]) -> str:
    """The difference between the calls of a stage in one frame; "" if there is none."""
    if library and not own:
        return f"your loop does not call `{name}`"
    if own and not library:
        return f"your loop calls `{name}`, the library's does not"
    for mine, theirs in zip(own, library, strict=False):
        given = named_inputs(name, mine.inputs)
        expected = named_inputs(name, theirs.inputs)
        for argument, value in expected.items():
            if argument not in given:
                return f"`{name}` gets no `{argument}`"
            if words := difference(given[argument], value):
                return f"`{name}` gets another `{argument}` than in the library's loop: {words}"
    if len(own) != len(library):
        return f"your loop calls `{name}` {len(own)} times, the library's {len(library)} times"
    return ""


# What can have happened to an input: words, and the function from the right input to the wrong one.
CHANGES: tuple[tuple[str, Callable[[Array], Any]], ...] = (
    ("it has the opposite sign", lambda right: -right),
    ("it is transposed", lambda right: np.swapaxes(right, -1, -2)),
    (
        "its rotation is transposed",
        lambda right: _with_rotation(right, np.swapaxes(right[..., :3, :3], -1, -2)),
    ),
    ("it is inverted", np.linalg.inv),
    ("its translation is missing", lambda right: _with_translation(right, 0.0 * right[..., :3, 3])),
    ("its translation has the opposite sign", lambda right: _with_translation(right, -right[..., :3, 3])),
    ("its rotation is missing", lambda right: _with_rotation(right, np.eye(3))),
)


def _with_rotation(T: Array, R: Array) -> Array:
    changed = T.copy()
    changed[..., :3, :3] = R
    return changed


def _with_translation(T: Array, t: Array) -> Array:
    if T.shape[-1] != 4:
        raise ValueError("no motion")
    changed = T.copy()
    changed[..., :3, 3] = t
    return changed


def difference(mine: Any, theirs: Any) -> str:
    """How an input differs from the one in the library's loop, in words; "" if it does not."""
    if _equal(mine, theirs):
        return ""
    own = np.asarray(mine, np.float64)
    right = np.asarray(theirs, np.float64)
    if own.ndim == right.ndim == 0:
        return f"it is {own:.6g}, not {right:.6g}"
    if own.shape != right.shape:
        if own.ndim and right.ndim and own.shape[1:] == right.shape[1:]:
            return f"{len(own)} rows instead of {len(right)}"
        return f"the shape {own.shape} instead of {right.shape}"
    for words, change in CHANGES:
        try:
            if _equal(own, change(right)):
                return words
        except (ValueError, IndexError, np.linalg.LinAlgError):
            continue
    factor = float(np.vdot(right, own) / max(float(np.vdot(right, right)), 1e-300))
    if _equal(own, factor * right):
        return f"it is {factor:.4g} times as large"
    return "the numbers differ"


def _equal(mine: Any, theirs: Any) -> bool:
    own = np.asarray(mine, np.float64)
    right = np.asarray(theirs, np.float64)
    if own.shape != right.shape:
        return False
    size = float(np.abs(right).max(initial=0.0))
    return bool(np.allclose(own, right, rtol=0.0, atol=CLOSE * size))
