"""Chapter 6's checks: right answers pass, each foreseen mistake gets its own words."""

from __future__ import annotations

from typing import Any

import numpy as np

from vo_lib.course.exercises import Verdict, ch06
from vo_lib.course.made_up import block_tour, made_up
from vo_lib.evaluation.kitti import kitti_errors, trajectory_distances


def wrong(verdict: Verdict, words: str) -> None:
    """The verdict is "not yet" and says why."""
    assert not verdict.passed
    assert words in f"{verdict.message} {verdict.hint}"


def end(path: Any, first: int, length: float) -> Any:
    beyond = np.flatnonzero(path > path[first] + length)
    return beyond[0] if len(beyond) else None


def test_the_end_of_a_sub_sequence() -> None:
    assert ch06.end_frame(end).passed
    reached = lambda path, first, length: int(np.argmax(path >= path[first] + length))  # noqa: E731
    wrong(ch06.end_frame(reached), "not exceeded")
    wrong(ch06.end_frame(lambda path, first, length: int(np.argmax(path > length))), "from frame 0")
    always = lambda path, first, length: int(np.argmax(path > path[first] + length))  # noqa: E731
    wrong(ch06.end_frame(always), "the path ends after 7 m")
    stops = lambda path, first, length: np.flatnonzero(path > path[first] + length)[0]  # noqa: E731
    wrong(ch06.end_frame(stops), "IndexError")
    wrong(ch06.end_frame(lambda path, first, length: None), "None for first = 0")
    wrong(ch06.end_frame(lambda path, first, length: 6), "expected 3")


def error_of(truth: Any, estimate: Any, first: int, last: int) -> Any:
    true_motion = np.linalg.inv(truth[first]) @ truth[last]
    return np.linalg.inv(np.linalg.inv(estimate[first]) @ estimate[last]) @ true_motion


def measures(error: Any, length: float) -> tuple[float, float]:
    angle = np.degrees(np.arccos(np.clip((np.trace(error[:3, :3]) - 1) / 2, -1, 1)))
    return 100 * float(np.linalg.norm(error[:3, 3])) / length, 100 * float(angle) / length


def scaled(te: float = 1.0, re: float = 1.0) -> Any:
    """The right answer with its two numbers times a factor; a negative one stands for times the length."""

    def errors(truth: Any, estimate: Any, first: int, last: int, length: float) -> Any:
        found = measures(error_of(truth, estimate, first, last), length)
        return tuple(v * (-f * length if f < 0 else f) for v, f in zip(found, (te, re), strict=True))

    return errors


def test_the_errors_of_a_sub_sequence() -> None:
    assert ch06.part_errors(scaled()).passed
    wrong(ch06.part_errors(scaled(te=0.01)), "fraction")
    wrong(ch06.part_errors(scaled(te=-0.01)), "in metres")
    wrong(ch06.part_errors(scaled(te=1.1)), "expected")
    wrong(ch06.part_errors(scaled(re=np.pi / 180)), "radians")
    wrong(ch06.part_errors(scaled(re=0.01)), "per metre")
    wrong(ch06.part_errors(scaled(re=-0.01)), "in degrees")
    wrong(ch06.part_errors(scaled(re=1.1)), "(trace - 1) / 2")
    moved = lambda t, e, first, last, length: measures(np.linalg.inv(e[last]) @ t[last], length)  # noqa: E731
    wrong(ch06.part_errors(moved), "making the starts equal")
    wrong(ch06.part_errors(lambda *given: 1.0), "two numbers")


def test_numbers() -> None:
    assert ch06.yaw_on_a_straight(3.49).passed
    for answer, words in ((6.98, "all the way"), (14.0, "at the end"), (0.87, "100 m"), (1.0, "not it")):
        wrong(ch06.yaw_on_a_straight(answer), words)
    round_te = kitti_errors(block_tour(), made_up(block_tour(), scale=1.0), lengths=(800,)).te
    assert ch06.once_round(round_te).passed
    wrong(ch06.once_round(1.0), "straight road")
    wrong(ch06.once_round(0.5), "not it")


def test_all_sub_sequences() -> None:
    def found(truth: Any, estimate: Any, lengths: Any, step: int) -> Any:
        path, rows = trajectory_distances(truth), []
        for first in range(0, len(truth), step):
            for length in lengths:
                last = end(path, first, length)
                if last is not None:
                    rows.append((length, *scaled()(truth, estimate, first, last, length)))
        return np.array(rows)

    def root(*given: Any) -> Any:
        return np.sqrt(np.mean(found(*given)[:, 1:] ** 2, axis=0))

    def by_length(*given: Any) -> Any:
        rows = found(*given)
        return np.mean(
            [rows[rows[:, 0] == length, 1:].mean(axis=0) for length in np.unique(rows[:, 0])], axis=0
        )

    assert ch06.all_errors(lambda *given: found(*given)[:, 1:].mean(axis=0)).passed
    wrong(ch06.all_errors(root), "mean square")
    wrong(ch06.all_errors(by_length), "means of each length")
    wrong(
        ch06.all_errors(lambda t, e, lengths, step: found(t, e, lengths, 1)[:, 1:].mean(axis=0)),
        "every frame",
    )
    wrong(ch06.all_errors(lambda *given: (1.0, 2.0)), "sub-sequences")


def test_averages() -> None:
    def pooled(errors: Any) -> float:
        return float(np.concatenate(errors).mean())

    def plain(errors: Any) -> float:
        return float(np.mean([each.mean() for each in errors if len(each)]))

    assert ch06.averages(lambda errors: (pooled(errors), plain(errors))).passed
    wrong(ch06.averages(lambda errors: (plain(errors), pooled(errors))), "changed places")
    wrong(ch06.averages(lambda errors: (pooled(errors), float("nan"))), "NaN")
    zeros = lambda errors: (pooled(errors), np.mean([each.sum() / max(len(each), 1) for each in errors]))  # noqa: E731
    wrong(ch06.averages(zeros), "counts as zero")
    wrong(ch06.averages(lambda errors: (1.0, plain(errors))), "pooled is 1")
    wrong(ch06.averages(lambda errors: (pooled(errors), 1.7)), "the plain mean is 1.7")


def test_blind_rpe() -> None:
    assert ch06.blind_rpe({"RPE": 0.1, "TE": 3.0}).passed
    wrong(ch06.blind_rpe({"RPE": 0.1, "TE": 1.0}), "TE is only")
    wrong(ch06.blind_rpe({"RPE": 20.0, "TE": 3.0}), "RPE is 20.0 mm")
