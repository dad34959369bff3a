"""Means over seeds, and whether a change counts (chapters 6 and 7).

Every standard deviation is that of a sample, over n - 1.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..geometry.types import Array

# One run would show a change of an error that exceeds this number of standard deviations of the difference
# between two runs, and this share of the error. `NO_CHANGE` and `COUNTED` say so in reports.
SPREADS = 2.0
SHARE = 0.02
NO_CHANGE = f"within two standard deviations of the difference between two runs, or {100 * SHARE:.0f} %"
COUNTED = (
    f"A change counts if one run would show it: if it exceeds {100 * SHARE:.0f} %, and two standard "
    "deviations of the difference between two runs, one before and one after the change."
)
# Quantiles t(0.975) of Student's distribution with 1, 2, … 30 degrees of freedom. For more of them, the last
# one is used, which makes an interval up to 4 % too wide.
T_QUANTILES = np.ravel(
    [
        [12.7062, 4.3027, 3.1824, 2.7764, 2.5706, 2.4469, 2.3646, 2.3060, 2.2622, 2.2281],
        [2.2010, 2.1788, 2.1604, 2.1448, 2.1314, 2.1199, 2.1098, 2.1009, 2.0930, 2.0860],
        [2.0796, 2.0739, 2.0687, 2.0639, 2.0595, 2.0555, 2.0518, 2.0484, 2.0452, 2.0423],
    ]
)


def standard_deviation(values: ArrayLike) -> Array:
    """Standard deviation of a sample over the first axis, over n - 1; NaN for fewer than two values."""
    sample = np.asarray(values, np.float64)
    if len(sample) < 2:
        return np.full(sample.shape[1:], np.nan)
    return np.asarray(sample.std(axis=0, ddof=1))


def mean_and_deviation(values: ArrayLike) -> tuple[float, float]:
    """Mean and standard deviation of values (S,) over seeds.

    Both are NaN without seeds; with one seed, the standard deviation is NaN.
    """
    sample = np.asarray(values, np.float64)
    mean = float(sample.mean()) if len(sample) else math.nan
    return mean, float(standard_deviation(sample))


class Change(NamedTuple):
    """Mean of the changes of an error over n seeds, with its 95 % interval, as shares of the mean before.

    alike : number of the seeds whose change has the sign of the mean.
    """

    mean: float
    low: float
    high: float
    alike: int
    seeds: int

    @property
    def counts(self) -> bool:
        """Whether the interval excludes 0, and the change is `SHARE` or more; False with one seed."""
        return abs(self.mean) >= SHARE and (self.low > 0 or self.high < 0)

    @property
    def words(self) -> str:
        """The change as text: "−34 % (95 %: −49 to −18), lower in 5 of 5 seeds"; one seed has no interval."""
        mean, low, high = (f"{100 * share:+.0f}".replace("-", "−") for share in self[:3])
        if self.seeds == 1:
            return f"{mean} % with one seed"
        direction = "lower" if self.mean < 0 else "higher"
        return f"{mean} % (95 %: {low} to {high}), {direction} in {self.alike} of {self.seeds} seeds"


def change_over_seeds(before: ArrayLike, after: ArrayLike) -> Change:
    """The change from errors `before` to errors `after`, both (n,) of the same seeds: mean ± t s / √n.

    The interval is that of the mean of the paired changes; with one seed it is NaN. Raises ValueError if
    `before` and `after` have no seeds, or different numbers of them.
    """
    old = np.asarray(before, np.float64)
    new = np.asarray(after, np.float64)
    if old.shape != new.shape or len(old) == 0:
        raise ValueError(f"{old.size} errors before and {new.size} after: expected pairs with the same seeds")
    changes = (new - old) / old.mean()
    mean, deviation = mean_and_deviation(changes)
    t = T_QUANTILES[min(max(len(changes) - 1, 1), len(T_QUANTILES)) - 1]
    half = float(t) * deviation / math.sqrt(len(changes))
    return Change(mean, mean - half, mean + half, int(np.sum(changes * mean > 0)), len(changes))


def change_limit(error: float, *deviations: float) -> float:
    """Limit above which one run would show a change of an error: max(2 √(s² + s'²), 2 % of the error).

    deviations : standard deviations over the seeds, s of the error before and s' after the change. With one
        seed they are NaN, and so is the limit.
    """
    if any(math.isnan(deviation) for deviation in deviations):
        return math.nan
    return max(SPREADS * math.hypot(*deviations), SHARE * error)


def one_run_shows(before: float, deviation: float, after: float, new_deviation: float) -> bool | None:
    """Whether one run would show the change from a mean `before` to a mean `after`, by `change_limit`.

    Each mean comes with its standard deviation over the seeds. None if a deviation is NaN: a single seed does
    not tell how much another run would differ.
    """
    limit = change_limit(before, deviation, new_deviation)
    if math.isnan(limit):
        return None
    return bool(abs(after - before) > limit)
