"""From candidates to one rotation: consensus, solution selection, depth, refinement."""

from __future__ import annotations

import numpy as np

from vo_lib.beyond.refinement import refine
from vo_lib.beyond.selection import choose, sample_sets
from vo_lib.config import SelectionConfig
from vo_lib.core.geometry import (
    essential_vector,
    rotation_angle,
    rotation_from_vector,
)
from vo_lib.core.sampson import match_terms
from vo_lib.data.problems import random_problems
from vo_lib.method.five_point import five_point
from vo_lib.method.selection import truncated_errors

FOCAL = 718.856


def test_sets_hold_five_different_features_and_use_all_equally_often() -> None:
    sets = sample_sets(np.random.default_rng(0), 52, 200)
    assert sets.shape == (200, 5)
    assert all(len(set(row)) == 5 for row in sets.tolist())
    counts = np.bincount(sets.ravel(), minlength=52)
    assert counts.max() - counts.min() <= 4


def test_every_other_set_takes_one_feature_from_each_fifth() -> None:
    angle = np.random.default_rng(1).uniform(-np.pi, np.pi, 52)
    sets = sample_sets(np.random.default_rng(0), 52, 201, angle)
    free = sample_sets(np.random.default_rng(0), 52, 201)
    np.testing.assert_array_equal(sets[::2], free[::2])
    assert all(len(set(row)) == 5 for row in sets.tolist())
    # Two features of the 52 stay out, so a fifth may begin up to two places later.
    place = np.argsort(np.argsort(angle))[sets[1::2]]
    assert np.all((place >= [0, 10, 20, 30, 40]) & (place <= [11, 21, 31, 41, 51]))


def test_refinement_reaches_the_truth_on_exact_matches_and_shrugs_off_wrong_ones() -> None:
    problem = random_problems(np.random.default_rng(8), 1, 100, "forward")
    R, t = problem.R_cp[0], problem.t_cp[0]
    x_c = problem.x_c[0].copy()
    x_c[:20] += 0.05
    matches = match_terms(problem.x_p[0], x_c)
    start = rotation_from_vector(np.array([2e-3, -1e-3, 1e-3])) @ R
    found, direction = refine(start, np.array([0.03, 0.02, -1.0]), matches, 0.5 / FOCAL, 30)
    assert rotation_angle(found.T @ R) < 1e-4
    assert np.arccos(np.clip(direction @ t, -1, 1)) < 3e-3


def test_a_prior_that_allows_only_a_bad_candidate_is_dropped_and_said_so() -> None:
    problem = random_problems(np.random.default_rng(4), 1, 200, "sideways", noise_px=0.2)
    x_p, x_c = problem.x_p[0], problem.x_c[0]
    sets = sample_sets(np.random.default_rng(0), 200, 1)
    E, set_index = five_point(x_p[sets], x_c[sets])
    errors = truncated_errors(E, x_p, x_c, 1.0 / FOCAL)
    best, worst = int(np.argmin(errors)), int(np.argmax(errors))
    assert best != worst
    for ratio, expected in ((SelectionConfig().prior_rejection_ratio, (best, True)), (10.0, (worst, False))):
        config = SelectionConfig(keep=1, prior_rejection_ratio=ratio)
        assert choose(E, set_index, x_p, x_c, essential_vector(E[worst]), config, FOCAL) == expected


def test_the_same_point_many_times_has_no_candidate() -> None:
    same = np.tile([[0.1, 0.2]], (30, 1))
    sets = sample_sets(np.random.default_rng(0), 30, 200)
    assert len(five_point(same[sets], same[sets])[0]) == 0
