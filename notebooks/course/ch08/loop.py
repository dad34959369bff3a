"""Chapter 8: the loop as the library composes it, and the first step at which another loop differs from it.

Both loops call the same stages, the student's where they pass: only the lines between the stages may differ.
"""

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

from .own import BUCKET, INLIER_PX, STAGES, StudentOdometry, residuals, solve_sets
from .stages import named_inputs

# The numbers of the loop in the notebook, which must be equal to them. Two more are in `own`, for its film.
SETS = 30
NEAREST = 2  # solutions of a set that are near the previous essential vector
SCALE_PX = 0.5
ROUNDS = 4
MIN_MATCHES = 12
STILL_PX = 0.5
FARTHEST_M = 100.0

FIRST_FRAMES = 4  # most differences show in these; only without one, all frames are compared
CLOSE = 1e-6  # relative difference of equal numbers

# What can have happened to an input: words, and the function from the right input to the wrong one.
CHANGES: tuple[tuple[str, Callable[[Array], Any]], ...] = (
    ("it has the opposite sign", lambda right: -right),
    ("it is transposed", lambda right: np.swapaxes(right, -1, -2)),
    ("it is in the opposite order", lambda right: right[::-1]),
    ("its columns are in the opposite order", lambda right: right[..., ::-1]),
    ("its first entry is missing", lambda right: right[1:]),
    ("its last entry is missing", lambda right: right[:-1]),
    (
        "its rotation is transposed",
        lambda right: _with_rotation(right, np.swapaxes(right[..., :3, :3], -1, -2)),
    ),
    ("it is inverted", lambda right: np.linalg.inv(right)),
    (
        "its rotation is transposed and its translation has the opposite sign, which is not the inverse",
        lambda right: _with_translation(
            _with_rotation(right, np.swapaxes(right[..., :3, :3], -1, -2)), -right[..., :3, 3]
        ),
    ),
    ("its translation is missing", lambda right: _with_translation(right, 0.0 * right[..., :3, 3])),
    ("its translation has the opposite sign", lambda right: _with_translation(right, -right[..., :3, 3])),
    ("its rotation is missing", lambda right: _with_rotation(right, np.eye(3))),
)
KNOWN = tuple(words for words, _ in CHANGES)
FACTOR = "it is multiplied by "  # and the factor
UNKNOWN = "the numbers differ"  # if none of these explains it


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
    pair = pair[stage.buckets(pair.cur_left, pair.age, pair.strength, *BUCKET)]
    moved = np.linalg.norm(pair.cur_left - pair.prev_left, axis=1)
    if len(pair) < MIN_MATCHES or np.median(moved) < STILL_PX:
        return np.eye(4), e_prev
    x_p = camera.normalise(pair.prev_left)
    x_c = camera.normalise(pair.cur_left)
    X_p = camera.triangulate(pair.prev_left, pair.prev_right)
    fives = [rng.choice(len(pair), 5, replace=False) for _ in range(SETS)]
    E, set_index = solve_sets(stage, x_p[fives], x_c[fives])
    distances = np.array([stage.epipolar_distance(each, x_p, x_c) for each in E])
    limit = INLIER_PX / camera.f
    errors = np.array([stage.truncated_error(each, limit) for each in distances])
    winner = np.argmin(errors) if e_prev is None else stage.select(E, set_index, errors, e_prev, NEAREST)
    good = (distances[winner] < limit) & (X_p[:, 2] < FARTHEST_M)
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
    drive: Callable[..., Any], odometry: StudentOdometry, sequence: Sequence, matches: list[TimedMatches]
) -> str:
    """A sentence on the first step at which `drive` differs from `library_loop` with the same stages; else "".

    The inputs of the stages are compared first, then the poses with those of `chain`, which a loop may do without.

    drive : called as drive(sequence, matches, odometry=…), with the first `FIRST_FRAMES` frames, then with all;
        its seed must be 0 if none is given, as that of `library_loop`.
    """
    for frames in (min(FIRST_FRAMES, len(matches)), len(matches)):
        some = matches[:frames]
        own_calls, own_path = recorded(drive, odometry, sequence, some)
        right_calls, right_path = recorded(library_loop, odometry, sequence, some)
        words = _first_difference_of_calls(own_calls, right_calls, _Views(sequence, some))
        if words:
            return words
        if not _equal(own_path, right_path):
            same = "all stages get the same inputs, but the loop returns other poses than those of"
            return f"{same} `chain`: {_other_path(own_path, right_path)}"
    return ""


def _other_path(own_path: Any, right_path: Array) -> str:
    """How the poses of a loop, or else the motions between them, differ from those of `chain`, in words."""
    words = difference(own_path, right_path)
    if words == UNKNOWN:
        own_motions = _motions(np.asarray(own_path, np.float64))
        words = f"of the motions between them, {difference(own_motions, _motions(right_path))}"
    return words


def _motions(poses: Array) -> Array:
    """The motions T_cp (N - 1, 4, 4) between successive poses."""
    return np.asarray(np.linalg.pinv(poses[1:]) @ poses[:-1])


def recorded(
    drive: Callable[..., Any], odometry: StudentOdometry, sequence: Sequence, matches: list[TimedMatches]
) -> tuple[list[Call], Any]:
    """The calls of the stages in a loop, in order, and the path that the loop returns."""
    calls: list[Call] = []

    def listen(frame: int | None, name: str, inputs: tuple[Any, ...], result: Any) -> None:
        calls.append(Call(frame, name, inputs, result))

    path = drive(sequence, matches, odometry=replace(odometry, listener=listen))
    return calls, path


def _first_difference_of_calls(own_calls: list[Call], right_calls: list[Call], views: _Views) -> str:
    """The first difference between the calls of two loops, frame by frame, in the order of the stages.

    views : the points and depths of all frames, to name where a wrong input comes from.
    """
    own_frames = _by_frame(own_calls)
    right_frames = _by_frame(right_calls)
    for frame, right_stages in right_frames.items():
        own_stages = own_frames.get(frame, {})
        when = "after the last frame" if frame is None else f"frame {frame}"
        for name in STAGES:
            own_of_stage = own_stages.get(name, [])
            right_of_stage = right_stages.get(name, [])
            if name == "chain" and not own_of_stage:
                continue  # lines of the loop may compute the poses
            others = {other: stages.get(name, []) for other, stages in right_frames.items() if other != frame}
            words = _difference_of_stage(name, own_of_stage, right_of_stage, others, views)
            if words:
                return f"{when}: {words}"
    return ""


def _by_frame(calls: list[Call]) -> dict[int | None, dict[str, list[Call]]]:
    """The calls by frame (None: after the last one) and name of the stage."""
    frames: dict[int | None, dict[str, list[Call]]] = {}
    for frame, group in groupby(calls, key=lambda call: call.frame):
        stages = frames.setdefault(frame, {})
        for call in group:
            stages.setdefault(call.name, []).append(call)
    return frames


def _difference_of_stage(
    name: str,
    own_calls: list[Call],
    right_calls: list[Call],
    others: dict[int | None, list[Call]],
    views: _Views,
) -> str:
    """The difference between the calls of a stage in one frame; "" if there is none.

    others : the library's calls of the stage in other frames.
    """
    if right_calls and not own_calls:
        return f"your loop does not call `{name}`"
    if own_calls and not right_calls:
        return f"your loop calls `{name}`, the library's does not"
    for number, (own_call, right_call) in enumerate(zip(own_calls, right_calls, strict=False)):
        given = named_inputs(name, own_call.inputs)
        expected = named_inputs(name, right_call.inputs)
        same_call = {
            frame: named_inputs(name, calls[number].inputs)
            for frame, calls in others.items()
            if number < len(calls)
        }
        words = _difference_of_call(name, given, expected, same_call, views)
        if words:
            return words
    if len(own_calls) != len(right_calls):
        return f"your loop calls `{name}` {len(own_calls)} times, the library's {len(right_calls)} times"
    return ""


def _difference_of_call(
    name: str,
    given: dict[str, Any],
    expected: dict[str, Any],
    others: dict[int | None, dict[str, Any]],
    views: _Views,
) -> str:
    """The difference between the inputs of two calls of a stage, by name; "" if there is none.

    others : the inputs of the same call in the library's other frames.
    """
    for argument, value in expected.items():
        if argument not in given:
            return f"`{name}` gets no `{argument}`"
        words = difference(given[argument], value)
        if not words:
            continue
        for other in expected:
            exchanged = _equal(given[argument], expected[other]) and _equal(given.get(other), value)
            if other != argument and exchanged:
                return f"`{name}` gets `{argument}` and `{other}` in exchanged places"
        # A change that explains all numbers is the best explanation; otherwise look where the numbers come from.
        if words not in KNOWN and not words.startswith(FACTOR):
            words = (
                _of_other_frame(given[argument], argument, others)
                or views.described(given[argument], value)
                or _of_other_input(given[argument], expected)
                or words
            )
        return f"`{name}` gets another `{argument}` than in the library's loop: {words}"
    return ""


def _of_other_frame(given: Any, argument: str, others: dict[int | None, dict[str, Any]]) -> str:
    """In which other frame the library's loop has this input, in words; "" if in none."""
    for frame, inputs in others.items():
        if _equal(given, inputs.get(argument)):
            return f"it is that of frame {frame}"
    return ""


def _of_other_input(given: Any, expected: dict[str, Any]) -> str:
    """Which other input of the library's call an input is, in words; "" if none."""
    for other, value in expected.items():
        if _equal(given, value):
            return f"it is the `{other}`"
    return ""


class _Views:
    """The points of the four images and the depths of a loop's frames, to tell which of them an input holds."""

    def __init__(self, sequence: Sequence, matches: list[TimedMatches]) -> None:
        self.tables = []
        camera = sequence.camera
        for pair, _ in matches[1:]:
            pixels = {
                "the previous left image": pair.prev_left,
                "the previous right image": pair.prev_right,
                "the current left image": pair.cur_left,
                "the current right image": pair.cur_right,
            }
            self.tables.append(pixels)
            self.tables.append({place: camera.normalise(uv) for place, uv in pixels.items()})
            with np.errstate(all="ignore"):
                depth = {
                    "the previous frame": camera.triangulate(pair.prev_left, pair.prev_right)[:, 2:],
                    "the current frame": camera.triangulate(pair.cur_left, pair.cur_right)[:, 2:],
                }
            self.tables.append(depth)

    def described(self, given: Any, expected: Any) -> str:
        """From which image or frame an input is, in place of the right one, in words; "" if it is unknown."""
        own = np.asarray(given, np.float64)
        right = np.asarray(expected, np.float64)
        if own.shape != right.shape or own.ndim == 0:
            return ""
        for table in self.tables:
            for place, values in table.items():
                rows = _rows_in(right, values)
                if rows is None:
                    continue
                for other, other_values in table.items():
                    if other != place and _equal(own.reshape(-1, values.shape[1]), other_values[rows]):
                        return f"it is of {other}, not of {place}"
        return ""


def _rows_in(wanted: Array, table: Array) -> Array | None:
    """The rows of a table (N, C) that an array holds, in its order; None if some are not in the table."""
    width = table.shape[1]
    if wanted.size == 0 or wanted.size % width or (width > 1 and wanted.shape[-1] != width):
        return None
    places = {row.tobytes(): index for index, row in enumerate(table)}
    rows = [places.get(row.tobytes()) for row in np.ascontiguousarray(wanted.reshape(-1, width))]
    return None if None in rows else np.array(rows, np.intp)


def _with_rotation(T: Array, R: Array) -> Array:
    """Motions (…, 3 or 4, 4) with other rotations."""
    changed = T.copy()
    changed[..., :3, :3] = R
    return changed


def _with_translation(T: Array, t: Array) -> Array:
    """Motions (…, 3 or 4, 4) with other translations; ValueError for other arrays."""
    if T.shape[-1] != 4:
        raise ValueError("no motion")
    changed = T.copy()
    changed[..., :3, 3] = t
    return changed


def difference(given: Any, expected: Any) -> str:
    """How an input differs from the one in the library's loop, in words; "" if it does not."""
    if _equal(given, expected):
        return ""
    own = np.asarray(given, np.float64)
    right = np.asarray(expected, np.float64)
    if own.ndim == right.ndim == 0:
        return f"it is {own:.6g}, not {right:.6g}"
    for words, change in CHANGES:
        try:
            if _equal(own, change(right)):
                return words
        except (ValueError, IndexError, np.linalg.LinAlgError):
            continue
    if own.shape != right.shape:
        if own.ndim and right.ndim and own.shape[1:] == right.shape[1:]:
            return f"{len(own)} rows instead of {len(right)}"
        return f"the shape {own.shape} instead of {right.shape}"
    factor = float(np.vdot(right, own) / max(float(np.vdot(right, right)), 1e-300))
    if _equal(own, factor * right):
        return f"{FACTOR}{factor:.4g}"
    return UNKNOWN


def _equal(given: Any, expected: Any) -> bool:
    """Whether two inputs or paths are arrays of the same shape with nearly the same numbers."""
    try:
        own = np.asarray(given, np.float64)
        right = np.asarray(expected, np.float64)
    except (TypeError, ValueError):
        return False
    if own.shape != right.shape:
        return False
    size = float(np.abs(right).max(initial=0.0))
    return bool(np.allclose(own, right, rtol=0.0, atol=CLOSE * size))
