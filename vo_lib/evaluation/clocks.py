"""Whether two paths have times of one clock, from the turns of both.

A vehicle turns at the same moments in both paths, whatever their axes, units and drift are: so the angle per
second from pose to pose is compared, for every lag between the two clocks.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ..geometry.motion import rotation_angle
from ..geometry.types import Array, Index

MAX_SAMPLES = 2000  # of the longer path, and of the intervals compared at full rate; more tell nothing more
MIN_SAMPLES = 30  # in which both paths have poses
MIN_OVERLAP = 0.5  # of the samples of the shorter path
ROUNDING_S = 0.01  # by which an interval may reach beyond the other path
ABOUT_EQUAL = 0.02  # difference of correlations
# A lag is clear if the turns agree well, if they leave this many times less unexplained than without it, and
# if that is no accident of few samples: n log(ratio) is twice the logarithm of the ratio of the likelihoods.
CLEAR_AGREEMENT = 0.8
CLEAR_RATIO = 1.5
CLEAR_EVIDENCE = 30.0
# Turns over a longer time, in which the noise of single frames hardly counts, tell whether two paths are of
# one drive at all.
NO_AGREEMENT = 0.5
SLOW_INTERVAL_S = 0.5


class TurnAgreement(NamedTuple):
    """How well the turns of two paths agree, as correlations in [-1, 1].

    Attributes
    ----------
    now : with the times as they are. best : with the best lag, the smallest of those that are about as good.
    lag : seconds by which the clock of the first path is then ahead of that of the second one, a multiple of
    the shorter of the median intervals of both.
    samples : number of intervals compared with the times as they are.
    """

    now: float
    best: float
    lag: float
    samples: int

    @property
    def is_another_clock(self) -> bool:
        """Whether the turns agree well with the lag, and clearly better than without it, by no accident."""
        if self.lag == 0 or self.best < CLEAR_AGREEMENT:
            return False
        ratio = _unexplained(self.now) / _unexplained(self.best)
        return ratio >= CLEAR_RATIO and self.samples * float(np.log(ratio)) >= CLEAR_EVIDENCE

    @property
    def is_one_clock(self) -> bool:
        """Whether the turns agree best with the times as they are, by no accident."""
        return self.lag == 0 and -self.samples * float(np.log(_unexplained(self.now))) >= CLEAR_EVIDENCE

    @property
    def is_another_drive(self) -> bool:
        """Whether the turns agree at no lag."""
        return self.now < NO_AGREEMENT and self.best < CLEAR_AGREEMENT


def turn_agreement(times: Array, poses: Array, others: Array, other_poses: Array) -> TurnAgreement | None:
    """How well the turns of a path with times (N,), seconds, and poses (N, 4, 4) agree with another's.

    A search over all lags, in steps that may be longer than a frame, is followed by one at full rate around
    its result and around no lag. None if one of the paths hardly changes its turning, or both have too short
    a time in common.
    """
    intervals = [float(np.median(np.diff(each))) for each in (times, others)]
    longest = max(float(each[-1] - each[0]) for each in (times, others))
    step = max(*intervals, longest / MAX_SAMPLES)
    start = min(float(times[0]), float(others[0]))
    first, rates = _turn_rates(times, poses, start, step)
    other_first, other_rates = _turn_rates(others, other_poses, start, step)
    least = max(MIN_SAMPLES, int(MIN_OVERLAP * min(len(rates), len(other_rates))))
    apart = first - other_first
    found = dict[int, float]()
    for lag in range(apart - len(other_rates) + least, apart + len(rates) - least + 1):
        # Sample k of the first path is at the time of sample k + offset of the second one.
        offset = apart - lag
        begin = max(0, -offset)
        end = min(len(rates), len(other_rates) - offset)
        correlation = _correlation(rates[begin:end], other_rates[begin + offset : end + offset])
        if correlation is not None:
            found[lag] = correlation
    if 0 not in found:
        return None
    # On a path that repeats itself, several lags are about equally good.
    good = [lag for lag, correlation in found.items() if correlation >= max(found.values()) - ABOUT_EQUAL]
    coarse = _nearest_peak(found, min(good, key=abs)) * step
    frame = min(intervals)
    if intervals[0] >= intervals[1]:
        compared = _AtFullRate(times, poses, others, other_poses, sign=1.0)
    else:
        compared = _AtFullRate(others, other_poses, times, poses, sign=-1.0)
    reach = int(np.ceil(step / frame)) + 1
    around = {lag + k for lag in (0, round(coarse / frame)) for k in range(-reach, reach + 1)}
    fine = dict[int, float]()
    for lag in sorted(around, key=abs):
        correlation = compared.correlation(lag * frame)
        if correlation is not None:
            fine[lag] = correlation
    if 0 not in fine:
        return None
    best = max(fine, key=lambda lag: fine[lag])
    return TurnAgreement(fine[0], fine[best], best * frame, compared.samples(0.0))


class _AtFullRate:
    """Turns of a path in its own intervals, and those of a denser path in the same intervals.

    sign : of the lag of the first path's clock; -1 if the denser path is the first one.
    """

    def __init__(
        self, times: Array, poses: Array, dense_times: Array, dense_poses: Array, sign: float
    ) -> None:
        count = len(times) - 1
        rows = np.unique(np.linspace(0, count - 1, min(count, MAX_SAMPLES)).astype(int))
        self.starts = times[rows]
        self.ends = times[rows + 1]
        self.rates = _angles(poses[rows, :3, :3], poses[rows + 1, :3, :3]) / (self.ends - self.starts)
        self.dense_times = dense_times
        self.dense_rotations = dense_poses[:, :3, :3]
        self.sign = sign

    def _inside(self, lag: float) -> Array:
        """Whether the denser path has times for each interval (M,), with a lag in seconds."""
        after = self.starts - self.sign * lag >= self.dense_times[0] - ROUNDING_S
        before = self.ends - self.sign * lag <= self.dense_times[-1] + ROUNDING_S
        return np.asarray(after & before)

    def samples(self, lag: float) -> int:
        """Number of intervals in which both paths have poses, with a lag in seconds."""
        return int(self._inside(lag).sum())

    def correlation(self, lag: float) -> float | None:
        """Correlation of the turns, with a lag in seconds; None for too few or constant ones."""
        inside = self._inside(lag)
        if inside.sum() < MIN_SAMPLES:
            return None
        begins = self._dense_at(self.starts[inside] - self.sign * lag)
        ends = self._dense_at(self.ends[inside] - self.sign * lag)
        turns = _angles(begins, ends)
        return _correlation(self.rates[inside], turns / (self.ends - self.starts)[inside])

    def _dense_at(self, times: Array) -> Array:
        """Rotations (M, 3, 3) of the denser path at times (M,), with a steady turn from pose to pose."""
        known = self.dense_times
        before = np.clip(np.searchsorted(known, times, side="right") - 1, 0, len(known) - 2)
        share = np.clip((times - known[before]) / (known[before + 1] - known[before]), 0.0, 1.0)
        rotations = self.dense_rotations[before]
        turn = np.swapaxes(rotations, 1, 2) @ self.dense_rotations[before + 1]
        angle = rotation_angle(turn)
        # The antisymmetric part of a rotation is sin(angle) times the matrix K of the cross product with its
        # axis; Rodrigues' formula gives the rotation by a share of the angle.
        sine = np.maximum(np.sin(angle), 1e-12)[:, None, None]
        K = (turn - np.swapaxes(turn, 1, 2)) / (2 * sine)
        part = (share * angle)[:, None, None]
        return np.asarray(rotations @ (np.eye(3) + np.sin(part) * K + (1 - np.cos(part)) * (K @ K)))


def slow_turn_agreement(
    times: Array, poses: Array, others: Array, other_poses: Array
) -> TurnAgreement | None:
    """`turn_agreement` of poses about `SLOW_INTERVAL_S` apart."""
    rows = _rows_apart(times)
    other_rows = _rows_apart(others)
    if min(len(rows), len(other_rows)) < 2:
        return None
    return turn_agreement(times[rows], poses[rows], others[other_rows], other_poses[other_rows])


def _rows_apart(times: Array) -> Index:
    """Rows of times (N,) with about `SLOW_INTERVAL_S` from one to the next."""
    grid = np.arange(times[0], times[-1], SLOW_INTERVAL_S)
    return np.unique(np.searchsorted(times, grid))


def _unexplained(correlation: float) -> float:
    """Share of the variance that a correlation leaves unexplained; not 0, so that it can be a divisor."""
    return 1.0 - max(correlation, 0.0) ** 2 + 1e-12


def _nearest_peak(correlations: Mapping[int, float], lag: int) -> int:
    """The lag that is reached from `lag` by steps of one, as long as the correlation rises."""
    while True:
        beside = max((lag - 1, lag + 1), key=lambda near: correlations.get(near, -1.0))
        if correlations.get(beside, -1.0) <= correlations[lag]:
            return lag
        lag = beside


def _turn_rates(times: Array, poses: Array, start: float, step: float) -> tuple[int, Array]:
    """Angles per second (M,), rad/s, at the times start + (k + 0, 1, …) step of a path, and the number k."""
    angles = _angles(poses[:-1, :3, :3], poses[1:, :3, :3])
    at = ((times[:-1] + times[1:]) / 2 - start) / step
    first = int(np.ceil(at[0]))
    return first, np.interp(np.arange(first, at[-1] + 1e-9), at, angles / np.diff(times))


def _angles(rotations: Array, others: Array) -> Array:
    """Angles (M,), rad, between rotations (M, 3, 3) and others."""
    return rotation_angle(np.swapaxes(rotations, 1, 2) @ others)


def _correlation(a: Array, b: Array) -> float | None:
    """Pearson's correlation of two series (M,); None if one of them is constant."""
    a = a - a.mean()
    b = b - b.mean()
    size = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / size if size > 0 else None
