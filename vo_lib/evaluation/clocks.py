"""Whether two paths have times of one clock, from the turns of both.

A vehicle turns at the same moments in both paths, whatever their axes, units and drift are. So the turn rates
of both, the angles per second from pose to pose, are series that agree at the right lag between the clocks.
Their correlation says how well they agree at a lag.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np

from ..geometry.motion import rotation_angle, rotation_from_vector, vector_from_rotation
from ..geometry.types import Array, Index

# Largest number of samples of the longer path in the coarse search, and of the intervals of the fine search.
MAX_SAMPLES = 2000
MIN_SAMPLES = 30  # smallest number of samples that both paths have at a lag
MIN_OVERLAP = 0.5  # and their smallest share of the samples of the shorter path
ROUNDING_S = 0.01  # by which an interval may reach beyond the other path
ABOUT_EQUAL = 0.02  # largest difference of correlations that count as equally good
# A lag between two clocks is clear if the turns agree well with it and much better than without it, and if
# this is no accident of few samples.
CLEAR_AGREEMENT = 0.8  # smallest correlation with the lag
CLEAR_RATIO = 1.5  # smallest ratio of the shares of variance that are unexplained without and with the lag
CLEAR_EVIDENCE = 30.0  # smallest n log(ratio) for n samples: twice the logarithm of the likelihood ratio
# Turns over a longer time, in which the noise of single frames hardly counts, tell whether two paths are of
# one drive at all (`slow_turn_agreement`).
SLOW_INTERVAL_S = 0.5  # about the time from one of the compared poses to the next
NO_AGREEMENT = 0.5  # a smaller correlation, with the times as they are, is no agreement
# Smallest standard deviation, rad/s, of the turn rates of a path with clear turns. If both are straighter,
# their errors decide on the correlation. With the interval above, KITTI's drives 00 to 10 have 0.08 to 0.17,
# but the straight 04 has 0.01. The errors of ORB-SLAM2's turn rates in 02, 06 and 08 have 0.002 to 0.005.
CLEAR_TURNS = 0.02


class TurnAgreement(NamedTuple):
    """How well the turns of two paths agree, as correlations in [-1, 1].

    Attributes
    ----------
    as_given : with the times as they are.
    with_lag : with the best lag. Of several peaks that are about as good, the coarse search takes the one
        nearest to lag 0; around it and around lag 0, the highest correlation counts, however small its
        advantage.
    lag : seconds by which the clock of the first path is then ahead of that of the second one, a multiple of
        the shorter of the median intervals of both.
    samples : number of intervals compared with the times as they are.
    turning : the larger of the standard deviations of both turn rates in these intervals, rad/s.
    """

    as_given: float
    with_lag: float
    lag: float
    samples: int
    turning: float

    @property
    def is_another_clock(self) -> bool:
        """Whether the turns agree well with the lag, and clearly better than without it, by no accident."""
        if self.lag == 0 or self.with_lag < CLEAR_AGREEMENT:
            return False
        ratio = _unexplained(self.as_given) / _unexplained(self.with_lag)
        return ratio >= CLEAR_RATIO and self.samples * float(np.log(ratio)) >= CLEAR_EVIDENCE

    @property
    def is_one_clock(self) -> bool:
        """Whether the turns agree best with the times as they are, by no accident.

        On a path with gentle turns, noise may make the lag of a frame slightly better. The result is then
        false, which does not mean that there are two clocks.
        """
        evidence = -self.samples * float(np.log(_unexplained(self.as_given)))
        return self.lag == 0 and evidence >= CLEAR_EVIDENCE

    @property
    def is_another_drive(self) -> bool:
        """Whether a path clearly turns, but the turns do not agree as they are, nor agree well with any lag.

        The noise of single frames alone can cause this, so it must also hold for `slow_turn_agreement`.
        """
        # With the best of many lags, the turns of two drives may agree fairly well by chance.
        is_without_agreement = self.as_given < NO_AGREEMENT and self.with_lag < CLEAR_AGREEMENT
        return is_without_agreement and self.turning >= CLEAR_TURNS


def turn_agreement(
    times: Array, poses: Array, other_times: Array, other_poses: Array
) -> TurnAgreement | None:
    """How well the turns of a path agree with another's, as they are and with the best lag.

    A coarse search over all lags, in steps that may be longer than a frame, is followed by a fine one around
    its result and around lag 0.

    Parameters
    ----------
    times, poses : of the first path, (N,) seconds and (N, 4, 4).
    other_times, other_poses : of the second path, (M,) seconds and (M, 4, 4).

    Returns
    -------
    TurnAgreement, or None if the turn rate of one of the paths is exactly constant, as without any rotation,
    or if both have too short a time in common.
    """
    interval = float(np.median(np.diff(times)))
    other_interval = float(np.median(np.diff(other_times)))
    longest = max(float(times[-1] - times[0]), float(other_times[-1] - other_times[0]))
    step = max(interval, other_interval, longest / MAX_SAMPLES)
    start = min(float(times[0]), float(other_times[0]))
    on_grid = _turn_rates(times, poses, start, step)
    other_on_grid = _turn_rates(other_times, other_poses, start, step)
    coarse_samples = _coarse_lag(on_grid, other_on_grid)
    if coarse_samples is None:
        return None
    if interval >= other_interval:
        compared = _AtFullRate(times, poses, other_times, other_poses, sign=1.0)
    else:
        compared = _AtFullRate(other_times, other_poses, times, poses, sign=-1.0)
    # From here, lags are in frames of the denser path: all of them within a coarse step of 0, and of the
    # coarse result.
    frame_s = min(interval, other_interval)
    reach = int(np.ceil(step / frame_s)) + 1
    centres = (0, round(coarse_samples * step / frame_s))
    lags = {centre + k for centre in centres for k in range(-reach, reach + 1)}
    fine = _correlations(compared, sorted(lags, key=abs), frame_s)
    if 0 not in fine:
        return None
    # In gentle turns, a lag of a frame lowers the correlation by less than `ABOUT_EQUAL`, so the highest one
    # counts here; of equal ones, that of the smallest lag, which comes first.
    best = max(fine, key=lambda lag: fine[lag])
    rates, dense_rates = compared.turn_rates(0.0)
    return TurnAgreement(
        as_given=fine[0],
        with_lag=fine[best],
        lag=best * frame_s,
        samples=len(rates),
        turning=float(max(rates.std(), dense_rates.std())),
    )


class _TurnRates(NamedTuple):
    """Turn rates (M,), rad/s, of a path at the samples first, first + 1, … of a common grid."""

    first: int
    rates: Array


def _turn_rates(times: Array, poses: Array, start: float, step: float) -> _TurnRates:
    """Turn rates of a path at all samples in it; sample k of the grid is at the time start + k step."""
    angles = _angles(poses[:-1, :3, :3], poses[1:, :3, :3])
    place = ((times[:-1] + times[1:]) / 2 - start) / step  # on the grid, of the middle between two poses
    first = int(np.ceil(place[0]))
    samples = np.arange(first, place[-1] + 1e-9)
    return _TurnRates(first, np.interp(samples, place, angles / np.diff(times)))


def _coarse_lag(path: _TurnRates, other: _TurnRates) -> int | None:
    """The lag of a path's clock, in samples, with which its turn rates agree best with those of another.

    None if they cannot be compared without a lag.
    """
    count = len(path.rates)
    other_count = len(other.rates)
    least = max(MIN_SAMPLES, int(MIN_OVERLAP * min(count, other_count)))
    apart = path.first - other.first
    found = dict[int, float]()
    for lag in range(apart - other_count + least, apart + count - least + 1):
        # Sample k of the first path is at the time of sample k + offset of the second one.
        offset = apart - lag
        begin = max(0, -offset)
        end = min(count, other_count - offset)
        correlation = _correlation(path.rates[begin:end], other.rates[begin + offset : end + offset])
        if correlation is not None:
            found[lag] = correlation
    if 0 not in found:
        return None
    # On a path that repeats itself, several lags are about equally good.
    highest = max(found.values())
    good = [lag for lag, correlation in found.items() if correlation >= highest - ABOUT_EQUAL]
    return _nearest_peak(found, min(good, key=abs))


def _nearest_peak(correlations: Mapping[int, float], lag: int) -> int:
    """The lag that is reached from `lag` by steps of one, as long as the correlation rises."""
    while True:
        beside = max((lag - 1, lag + 1), key=lambda near: correlations.get(near, -1.0))
        if correlations.get(beside, -1.0) <= correlations[lag]:
            return lag
        lag = beside


def _correlations(compared: _AtFullRate, lags: Iterable[int], frame_s: float) -> dict[int, float]:
    """The correlations of two paths for some lags, in frames of `frame_s` seconds; without undefined ones."""
    result = dict[int, float]()
    for lag in lags:
        correlation = compared.correlation(lag * frame_s)
        if correlation is not None:
            result[lag] = correlation
    return result


class _AtFullRate:
    """The turn rates of a path in its own intervals, beside those of a denser path in the same intervals.

    Parameters
    ----------
    times, poses : of the path with the longer intervals, (N,) seconds and (N, 4, 4).
    dense_times, dense_poses : of the denser path.
    sign : 1 if a lag is that of the clock of `times`, -1 if it is that of the clock of `dense_times`.
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

    def turn_rates(self, lag_s: float) -> tuple[Array, Array]:
        """Turn rates (M,), rad/s, of the path and of the denser one, with a lag in seconds.

        They are those of the intervals in which both have poses.
        """
        starts = self.starts - self.sign * lag_s
        ends = self.ends - self.sign * lag_s
        inside = (starts >= self.dense_times[0] - ROUNDING_S) & (ends <= self.dense_times[-1] + ROUNDING_S)
        dense_angles = _angles(self._dense_at(starts[inside]), self._dense_at(ends[inside]))
        return self.rates[inside], dense_angles / (self.ends - self.starts)[inside]

    def correlation(self, lag_s: float) -> float | None:
        """Correlation of the turns, with a lag in seconds; None for too few or constant ones."""
        rates, dense_rates = self.turn_rates(lag_s)
        if len(rates) < MIN_SAMPLES:
            return None
        return _correlation(rates, dense_rates)

    def _dense_at(self, times: Array) -> Array:
        """Rotations (M, 3, 3) of the denser path at times (M,), with a steady turn from pose to pose."""
        known = self.dense_times
        before = np.clip(np.searchsorted(known, times, side="right") - 1, 0, len(known) - 2)
        # The share of the time from the pose before to the pose after, and so of the turn between them.
        share = np.clip((times - known[before]) / (known[before + 1] - known[before]), 0.0, 1.0)
        rotations = self.dense_rotations[before]
        turn = np.swapaxes(rotations, 1, 2) @ self.dense_rotations[before + 1]
        part_of_turn = rotation_from_vector(share[:, None] * vector_from_rotation(turn))
        return np.asarray(rotations @ part_of_turn)


def slow_turn_agreement(
    times: Array, poses: Array, other_times: Array, other_poses: Array
) -> TurnAgreement | None:
    """`turn_agreement` of poses about `SLOW_INTERVAL_S` apart; parameters as there.

    None also if a path is not longer than one such interval.
    """
    rows = _rows_apart(times)
    other_rows = _rows_apart(other_times)
    if min(len(rows), len(other_rows)) < 2:
        return None
    return turn_agreement(times[rows], poses[rows], other_times[other_rows], other_poses[other_rows])


def _rows_apart(times: Array) -> Index:
    """Rows of times (N,) with about `SLOW_INTERVAL_S` from one to the next."""
    grid = np.arange(times[0], times[-1], SLOW_INTERVAL_S)
    return np.unique(np.searchsorted(times, grid))


def _unexplained(correlation: float) -> float:
    """Share of the variance that a correlation leaves unexplained; not 0, so that it can be a divisor."""
    return 1.0 - max(correlation, 0.0) ** 2 + 1e-12


def _angles(rotations: Array, others: Array) -> Array:
    """Angles (M,), rad, between rotations (M, 3, 3) and others (M, 3, 3)."""
    return rotation_angle(np.swapaxes(rotations, 1, 2) @ others)


def _correlation(a: Array, b: Array) -> float | None:
    """Pearson's correlation of two series (M,); None if one of them is constant."""
    a = a - a.mean()
    b = b - b.mean()
    size = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / size if size > 0 else None
