"""Whether two paths have times of one clock, from the turns of both.

A vehicle turns at the same moments in both paths, whatever their axes, units and drift are: so the angle per
second from pose to pose is compared, for every lag between the two clocks.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ..geometry.motion import rotation_angle
from ..geometry.types import Array

MAX_SAMPLES = 2000  # of the longer path; more would cost seconds and tell nothing more
MIN_SAMPLES = 30  # in which both paths have poses
MIN_OVERLAP = 0.5  # of the samples of the shorter path
ABOUT_EQUAL = 0.02  # difference of correlations


class TurnAgreement(NamedTuple):
    """How well the turns of two paths agree, as correlations in [-1, 1].

    Attributes
    ----------
    now : with the times as they are. best : with the best lag, the smallest of those that are about as good.
    lag : seconds by which the clock of the first path is then ahead of that of the second one.
    """

    now: float
    best: float
    lag: float


def turn_agreement(times: Array, poses: Array, others: Array, other_poses: Array) -> TurnAgreement | None:
    """How well the turns of a path with times (N,), seconds, and poses (N, 4, 4) agree with another's.

    None if one of the paths hardly changes its turning, or both have too short a time in common.
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
    best = _nearest_peak(found, min(good, key=abs))
    return TurnAgreement(found[0], found[best], best * step)


def _nearest_peak(correlations: Mapping[int, float], lag: int) -> int:
    """The lag that is reached from `lag` by steps of one, as long as the correlation rises."""
    while True:
        beside = max((lag - 1, lag + 1), key=lambda near: correlations.get(near, -1.0))
        if correlations.get(beside, -1.0) <= correlations[lag]:
            return lag
        lag = beside


def _turn_rates(times: Array, poses: Array, start: float, step: float) -> tuple[int, Array]:
    """Angles per second (M,), rad/s, at the times start + (k + 0, 1, …) step of a path, and the number k."""
    angles = rotation_angle((np.linalg.inv(poses[:-1]) @ poses[1:])[:, :3, :3])
    at = ((times[:-1] + times[1:]) / 2 - start) / step
    first = int(np.ceil(at[0]))
    return first, np.interp(np.arange(first, at[-1] + 1e-9), at, angles / np.diff(times))


def _correlation(a: Array, b: Array) -> float | None:
    """Pearson's correlation of two series (M,); None if one of them is constant."""
    a = a - a.mean()
    b = b - b.mean()
    size = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / size if size > 0 else None
