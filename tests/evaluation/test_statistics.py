"""Means over seeds, and whether a change counts."""

from __future__ import annotations

import math

import numpy as np
import pytest

from course.intervals import paired_change, t_quantile
from vo_lib.evaluation.statistics import (
    T_QUANTILES,
    change_limit,
    change_over_seeds,
    mean_and_deviation,
    one_run_shows,
    standard_deviation,
)


def test_standard_deviation_is_that_of_a_sample() -> None:
    values = np.array([[1.0, 5.0], [3.0, 5.0], [2.0, 8.0]])
    np.testing.assert_allclose(standard_deviation(values), [1.0, math.sqrt(3.0)])
    assert mean_and_deviation([1.0, 3.0]) == pytest.approx((2.0, math.sqrt(2.0)))
    one_seed = mean_and_deviation([4.0])
    assert one_seed[0] == 4.0
    assert math.isnan(one_seed[1])
    assert np.isnan(mean_and_deviation([])).all()
    assert np.isnan(standard_deviation(values[:1])).all()


def test_the_table_of_t_is_that_of_the_distribution() -> None:
    assert pytest.approx([t_quantile(0.975, freedom) for freedom in range(1, 31)], abs=5.1e-5) == T_QUANTILES


@pytest.mark.parametrize("seeds", [2, 5, 31, 40])
def test_a_change_has_the_interval_of_its_pairs(seeds: int) -> None:
    random = np.random.default_rng(seeds)
    before = random.normal(3.0, 0.2, seeds)
    after = before * 0.8 + random.normal(0.0, 0.1, seeds)
    change = change_over_seeds(before, after)
    interval = paired_change(before, after)
    mean = before.mean()
    assert change.mean == pytest.approx(interval.mean / mean)
    # Beyond 31 seeds, the interval is slightly too wide.
    assert [change.low, change.high] == pytest.approx([interval.low / mean, interval.high / mean], rel=2e-2)
    assert change.alike == np.sum(after < before)


@pytest.mark.parametrize(
    ("after", "counts", "words"),
    [
        ([0.66, 0.70, 0.62, 0.65, 0.67], True, "−34 % (95 %: −38 to −30), lower in 5 of 5 seeds"),
        ([1.9, 0.2, 1.8, 0.4, 1.2], False, "+10 % (95 %: −87 to +107), higher in 3 of 5 seeds"),
        ([1.01, 1.012, 1.011, 1.01, 1.012], False, "+1 % (95 %: +1 to +1), higher in 5 of 5 seeds"),
    ],
)
def test_a_change_counts_beyond_chance_and_two_per_cent(after: list[float], counts: bool, words: str) -> None:
    change = change_over_seeds([1.0] * 5, after)
    assert change.counts is counts
    assert change.words == words


def test_one_seed_gives_no_verdict() -> None:
    change = change_over_seeds([2.0], [1.0])
    assert not change.counts
    assert change.words == "−50 % with one seed"
    for before, after in (([], []), ([1.0, 2.0], [1.0])):
        with pytest.raises(ValueError, match="same seeds"):
            change_over_seeds(before, after)
    assert one_run_shows(2.0, math.nan, 1.0, 0.1) is None
    assert one_run_shows(2.0, 0.1, 1.0, math.nan) is None


def test_change_limit_is_two_deviations_and_two_per_cent() -> None:
    assert change_limit(1.0, 0.3, 0.4) == pytest.approx(1.0)
    assert change_limit(10.0, 0.03, 0.04) == pytest.approx(0.2)
    assert math.isnan(change_limit(1.0, math.nan, math.nan))


def test_one_run_shows_a_change_beyond_both_limits() -> None:
    assert one_run_shows(3.0, 0.1, 2.7, 0.1) is True  # 0.3 > 2 √0.02
    assert one_run_shows(3.0, 0.1, 2.8, 0.1) is False
    assert one_run_shows(3.0, 0.0, 2.95, 0.0) is False  # less than 2 %
    assert one_run_shows(3.0, 0.0, 3.07, 0.0) is True
