"""Intervals and tests of means over seeds, against a printed table, closed forms and simulation."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from course.intervals import (
    changes_needed,
    mean_half_width,
    mean_interval,
    means_without_each,
    paired_change,
    prediction_half_width,
    prediction_interval,
    sign_flip_share,
    t_quantile,
)

# Quantiles of Student's distribution at 90, 95, 97.5 and 99.5 %, as printed in statistical tables.
PRINTED = {
    1: (3.078, 6.314, 12.706, 63.657),
    2: (1.886, 2.920, 4.303, 9.925),
    3: (1.638, 2.353, 3.182, 5.841),
    4: (1.533, 2.132, 2.776, 4.604),
    5: (1.476, 2.015, 2.571, 4.032),
    9: (1.383, 1.833, 2.262, 3.250),
    10: (1.372, 1.812, 2.228, 3.169),
    29: (1.311, 1.699, 2.045, 2.756),
    30: (1.310, 1.697, 2.042, 2.750),
    120: (1.289, 1.658, 1.980, 2.617),
    math.inf: (1.282, 1.645, 1.960, 2.576),
}
PROBABILITIES = (0.9, 0.95, 0.975, 0.995)


@pytest.mark.parametrize("freedom", PRINTED)
def test_t_quantiles_are_those_of_the_printed_table(freedom: float) -> None:
    for probability, printed in zip(PROBABILITIES, PRINTED[freedom], strict=True):
        assert t_quantile(probability, freedom) == pytest.approx(printed, abs=5.1e-4)
        assert t_quantile(1.0 - probability, freedom) == pytest.approx(-printed, abs=5.1e-4)
    assert t_quantile(0.5, freedom) == 0.0


def test_t_quantiles_have_closed_forms_for_one_and_two_degrees_of_freedom() -> None:
    for probability in (0.01, 0.3, 0.6, 0.999, 0.999999):
        assert t_quantile(probability, 1) == pytest.approx(math.tan(math.pi * (probability - 0.5)), rel=1e-9)
        root = math.sqrt(2.0 * probability * (1.0 - probability))
        assert t_quantile(probability, 2) == pytest.approx((2.0 * probability - 1.0) / root, rel=1e-9)


def test_t_quantiles_approach_the_normal_distribution() -> None:
    quantiles = [t_quantile(0.975, n) for n in (5, 50, 500, 5000, math.inf)]
    assert quantiles == sorted(quantiles, reverse=True)
    # The first term of the difference is (z³ + z) / (4 n).
    z = quantiles[-1]
    assert quantiles[-2] - z == pytest.approx((z**3 + z) / 20000, rel=1e-3)


@pytest.mark.parametrize(("probability", "freedom"), [(0.0, 3), (1.0, 3), (0.9, 0), (0.9, 2.5), (0.9, -1)])
def test_invalid_quantiles_are_refused(probability: float, freedom: float) -> None:
    with pytest.raises(ValueError, match="expected"):
        t_quantile(probability, freedom)


def test_intervals_of_a_small_sample_are_those_computed_by_hand() -> None:
    # Mean 3, deviation √2.5, five values: t(4) = 2.776.
    values = [1.0, 2.0, 3.0, 4.0, 5.0]
    mean = mean_interval(values)
    assert (mean.mean, mean.deviation) == pytest.approx((3.0, math.sqrt(2.5)))
    assert mean.high - mean.mean == pytest.approx(2.776 * math.sqrt(2.5) / math.sqrt(5.0), abs=1e-3)
    one_more = prediction_interval(values)
    assert one_more.mean - one_more.low == pytest.approx(2.776 * math.sqrt(2.5) * math.sqrt(1.2), abs=1e-3)
    assert one_more.contains(7.8)
    assert not one_more.contains(7.9)
    assert one_more.excludes(7.9)
    assert not one_more.excludes(7.8)
    # A table has the deviation and the number of seeds, not the runs.
    assert prediction_half_width(math.sqrt(2.5), 5) == one_more.high - one_more.mean
    assert mean_half_width(math.sqrt(2.5), 5) == pytest.approx(mean.high - mean.mean)


@pytest.mark.parametrize("values", [[], [3.0]])
def test_a_single_run_proves_nothing(values: list[float]) -> None:
    for interval in (mean_interval(values), prediction_interval(values), paired_change(values, values)):
        assert not interval.contains(0.0)
        assert not interval.excludes(0.0)
        assert math.isnan(interval.low)


def test_a_drive_that_decides_the_mean_is_found() -> None:
    changes = [-0.1, 0.2, -0.2, -3.0]
    assert means_without_each(changes) == pytest.approx([-1.0, -1.1, -2.9 / 3, -0.1 / 3])
    assert np.isnan(means_without_each([1.0])).all()


def test_pairs_remove_what_both_have_in_common() -> None:
    common = np.array([10.0, 20.0, 30.0])
    change = paired_change(common, common + np.array([1.0, 2.0, 1.5]))
    assert change.mean == pytest.approx(1.5)
    assert change.deviation == pytest.approx(0.5)
    assert change.excludes(0.0)
    with pytest.raises(ValueError, match="same seeds"):
        paired_change([1.0, 2.0], [1.0])


@pytest.mark.parametrize("seeds", [2, 3, 5, 10])
def test_intervals_hold_as_often_as_they_say(seeds: int) -> None:
    random, repetitions = np.random.default_rng(5), 4000
    samples = random.normal(7.0, 2.0, (repetitions, seeds + 1))
    mean = np.mean([mean_interval(sample[:-1]).contains(7.0) for sample in samples])
    next_run = np.mean([prediction_interval(sample[:-1]).contains(sample[-1]) for sample in samples])
    # Four standard deviations of a share over so many repetitions.
    assert [mean, next_run] == pytest.approx([0.95, 0.95], abs=4 * math.sqrt(0.95 * 0.05 / repetitions))


@pytest.mark.parametrize("mean", [-0.47, 0.8, 0.3])
def test_with_the_needed_number_of_changes_four_of_five_t_tests_find_one(mean: float) -> None:
    count = changes_needed(mean, 1.0)
    assert count is not None
    rng = np.random.default_rng(0)
    for size, low, high in ((count, 0.79, 0.835), (2 * count, 0.95, 1.0), (count // 2, 0.3, 0.6)):
        changes = rng.normal(mean, 1.0, (20_000, size))
        t = changes.mean(axis=1) * math.sqrt(size) / changes.std(axis=1, ddof=1)
        assert low < np.mean(np.abs(t) > t_quantile(0.975, size - 1)) < high


def test_no_number_of_changes_shows_what_is_not_there() -> None:
    for mean, deviation in ((0.0, 1.0), (math.nan, 1.0), (1.0, math.nan), (1e-3, 1.0), (1e-320, 1.0)):
        assert changes_needed(mean, deviation) is None
    assert changes_needed(0.1, 0.0) == 2
    assert changes_needed(-0.074, 0.157) == changes_needed(74.0, 157.0) == 38


def test_sign_flips_are_counted() -> None:
    # All of one sign: only this choice and its opposite reach the sum.
    assert sign_flip_share([1.0, 2.0, 0.5, 3.0, 1.0]) == 2 / 32
    assert sign_flip_share([1.0, -1.0]) == 1.0
    assert sign_flip_share([0.0, 0.0, 0.0]) == 1.0
    # By hand: |± 3 ± 2 ± 1| >= 4 for 6, 4 and their opposites.
    assert sign_flip_share([3.0, 2.0, -1.0]) == 4 / 8
    assert math.isnan(sign_flip_share([]))
    # A drive that lost the path has no error: no share, least of all one of 0.
    assert math.isnan(sign_flip_share([0.5, math.nan, 0.2]))
    changes = [0.3, 0.1, 0.2, -0.1, 0.4]
    shares = {sign_flip_share(each) for each in itertools.permutations(changes)}
    assert len(shares) == 1


def test_many_changes_are_flipped_at_random_the_same_way_every_time() -> None:
    changes = np.random.default_rng(2).normal(0.4, 1.0, 30)
    share = sign_flip_share(changes)
    assert share == sign_flip_share(changes)
    # The normal distribution of the flipped sums, within the noise of the random choices.
    z = abs(changes.sum()) / math.sqrt(float(changes @ changes))
    assert share == pytest.approx(math.erfc(z / math.sqrt(2.0)), abs=0.01)
