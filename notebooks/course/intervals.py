"""Intervals and tests of means over seeds (chapters 6 and 7).

Is a mean change chance? The mean over n seeds is more certain than one run, by √n. The change is paired over
the seeds, and its mean has a confidence interval: `paired_change`. `sign_flip_share` answers the same
question for changes that need not be normal, only symmetric about 0 if they are chance.

Could a single number, such as one that the paper prints, be one more run of ours? `prediction_interval`.
"""

from __future__ import annotations

import functools
import itertools
import math
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import ArrayLike

from vo_lib.evaluation.statistics import mean_and_deviation
from vo_lib.geometry.types import Array

CONFIDENCE = 0.95  # of the intervals
POWER = 0.8  # probability with which a test should find a change that is there
MOST_NEEDED = 1000  # largest number that `changes_needed` gives
MAX_EXACT_FLIPS = 16  # number of changes up to which all 2ⁿ choices of signs are tried
RANDOM_FLIPS = 100_000  # number of random choices of signs for more changes


@functools.cache  # bisection takes 0.1 ms, and few pairs of arguments occur
def t_quantile(probability: float, freedom: float) -> float:
    """Quantile of Student's distribution for `freedom` degrees of freedom, a whole number or infinity.

    Raises ValueError for a probability outside (0, 1) or another number of degrees of freedom.
    """
    if not 0.0 < probability < 1.0:
        raise ValueError(f"probability {probability}: expected a number between 0 and 1")
    if freedom == math.inf:
        return NormalDist().inv_cdf(probability)
    if freedom < 1 or freedom != int(freedom):
        raise ValueError(f"degrees of freedom {freedom}: expected a whole number from 1, or infinity")
    # The angle atan(t / √ν) is bounded, and the probability that |T| is less than t grows with it from 0 to
    # 1: bisection finds the angle with the wanted probability.
    central = abs(2.0 * probability - 1.0)
    low = 0.0
    high = 0.5 * math.pi
    for _ in range(100):
        middle = 0.5 * (low + high)
        if _central_probability(middle, int(freedom)) < central:
            low = middle
        else:
            high = middle
    return math.copysign(math.sqrt(freedom) * math.tan(low), probability - 0.5)


def _central_probability(angle: float, freedom: int) -> float:
    """Probability that |T| ≤ √ν tan(angle) for Student's T (Abramowitz and Stegun 1964, 26.7.3 f.)."""
    sine = math.sin(angle)
    cosine = math.cos(angle)
    odd = freedom % 2 == 1
    term = cosine if odd else 1.0
    total = 0.0
    for power in range(1 if odd else 0, freedom - 1, 2):
        total += term
        term *= cosine**2 * (power + 1) / (power + 2)
    if odd:
        return 2.0 / math.pi * (angle + sine * total)
    return sine * total


def mean_half_width(deviation: float, count: int, probability: float = CONFIDENCE) -> float:
    """Half the width of the confidence interval of a mean of n = `count` values: t(n - 1) s / √n.

    deviation : standard deviation s of the values, over n - 1. NaN for fewer than two values.
    """
    return _half_width(deviation, count, probability, further_runs=0)


def prediction_half_width(deviation: float, count: int, probability: float = CONFIDENCE) -> float:
    """How far one more run may lie from the mean of n = `count` runs: t(n - 1) s √(1 + 1/n).

    deviation : standard deviation s of the runs, over n - 1. NaN for fewer than two runs.
    """
    return _half_width(deviation, count, probability, further_runs=1)


def _half_width(deviation: float, count: int, probability: float, further_runs: int) -> float:
    """The quantile times the deviation of the difference: a mean has the variance s²/n, a further run s²."""
    if count < 2:
        return math.nan
    t = t_quantile(0.5 + 0.5 * probability, count - 1)
    return t * deviation * math.sqrt(further_runs + 1.0 / count)


@dataclass(frozen=True)
class Interval:
    """A mean with its standard deviation over n - 1, and an interval [low, high] around the mean.

    The bounds of fewer than two values are NaN; such an interval neither contains nor excludes a number.
    """

    mean: float
    deviation: float
    low: float
    high: float

    def contains(self, value: float) -> bool:
        """Whether the value is in the interval."""
        return self.low <= value <= self.high

    def excludes(self, value: float) -> bool:
        """Whether the value is outside the interval."""
        return value < self.low or value > self.high


def mean_interval(values: ArrayLike, probability: float = CONFIDENCE) -> Interval:
    """Confidence interval of the mean of values (S,): mean ± `mean_half_width`."""
    mean, deviation = mean_and_deviation(values)
    half = mean_half_width(deviation, np.size(values), probability)
    return Interval(mean, deviation, mean - half, mean + half)


def paired_change(before: ArrayLike, after: ArrayLike, probability: float = CONFIDENCE) -> Interval:
    """Mean of the changes of the same seeds, `after` minus `before`, both (S,), with its confidence interval.

    The mean change is more than chance if the interval excludes 0. The deviation is that of the changes, not
    of the errors. Raises ValueError if `before` and `after` have different numbers of seeds.
    """
    old = np.asarray(before, np.float64)
    new = np.asarray(after, np.float64)
    if old.shape != new.shape:
        raise ValueError(f"{old.size} errors before and {new.size} after: expected pairs with the same seeds")
    return mean_interval(new - old, probability)


def prediction_interval(values: ArrayLike, probability: float = CONFIDENCE) -> Interval:
    """Interval in which one more run would lie, from runs (S,): mean ± `prediction_half_width`."""
    mean, deviation = mean_and_deviation(values)
    half = prediction_half_width(deviation, np.size(values), probability)
    return Interval(mean, deviation, mean - half, mean + half)


def changes_needed(mean: float, deviation: float, power: float = POWER) -> int | None:
    """The number of changes with which a paired t test would find their mean with probability `power`.

    mean, deviation : of the changes, deviation over n - 1. The number is the least n with |mean| √n / s at
    least t(97.5 %) + t(power), both with n - 1 degrees of freedom; from about eight changes on, this is as
    good as the exact number. None without a change, if a number is not finite, or above `MOST_NEEDED`.
    """
    if not (math.isfinite(mean) and math.isfinite(deviation)) or mean == 0.0:
        return None
    level = 0.5 + 0.5 * CONFIDENCE
    # The quantiles of the normal distribution do not depend on the count, and Student's are larger. So they
    # give a count to start from, which is not too large.
    normal = t_quantile(level, math.inf) + t_quantile(power, math.inf)
    root_of_count = normal * deviation / abs(mean)
    if root_of_count > math.sqrt(MOST_NEEDED):
        return None
    count = max(2, math.ceil(root_of_count**2))
    while count <= MOST_NEEDED:
        t = t_quantile(level, count - 1) + t_quantile(power, count - 1)
        if abs(mean) * math.sqrt(count) >= t * deviation:
            return count
        count += 1
    return None


def means_without_each(values: ArrayLike) -> Array:
    """For each of n values, the mean of the others, (n,); NaN for a single value.

    If the values are the changes on n drives, and one of these means has another sign than the mean of all,
    then a single drive decides the result.
    """
    sample = np.asarray(values, np.float64)
    if len(sample) < 2:
        return np.full(len(sample), np.nan)
    return np.array([np.delete(sample, place).mean() for place in range(len(sample))])


def sign_flip_share(changes: ArrayLike) -> float:
    """Share of the choices of signs that give a mean change at least as far from 0 (two-sided).

    If the changes were chance, and as likely up as down by the same amount (distributed symmetrically about
    0; not necessarily normal), each could as well have the other sign. All 2ⁿ choices are tried for up to
    `MAX_EXACT_FLIPS` changes, else random choices, the same in every call. A small share speaks against
    chance; with n changes it is 2 / 2ⁿ or more. NaN without changes, and if a change is not a number.
    """
    sample = np.asarray(changes, np.float64)
    if len(sample) == 0 or not np.isfinite(sample).all():
        return math.nan
    if len(sample) <= MAX_EXACT_FLIPS:
        signs = np.array([*itertools.product((1.0, -1.0), repeat=len(sample))])
    else:
        random = np.random.default_rng(0)
        signs = random.choice((1.0, -1.0), (RANDOM_FLIPS, len(sample)))
        signs[0] = 1.0
    # The first choice in both cases is that of the changes as they are.
    sums = np.abs(signs @ sample)
    rounding = 1e-9 * np.abs(sample).sum()  # by which sums of the same numbers in another order may differ
    return float(np.mean(sums >= sums[0] - rounding))
