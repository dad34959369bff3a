"""From candidates to one rotation: consensus, solution selection, depth, refinement."""

from __future__ import annotations

import numpy as np
import pytest

from vo_lib.beyond.refinement import refine
from vo_lib.beyond.selection import choose, sample_sets
from vo_lib.config import SelectionConfig
from vo_lib.core.geometry import (
    essential_angle,
    essential_from_motion,
    essential_vector,
    rotation_angle,
    rotation_from_vector,
)
from vo_lib.core.sampson import match_terms, sampson_distance
from vo_lib.data.problems import random_problems
from vo_lib.method.five_point import five_point
from vo_lib.method.selection import nearest_to_prior, resolve_by_depth, truncated_errors

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


def test_the_matrix_product_form_of_the_error_equals_the_sampson_distance() -> None:
    problem = random_problems(np.random.default_rng(3), 4, 80, "forward", noise_px=1.0)
    threshold = 1.5 / FOCAL
    d = sampson_distance(problem.E, problem.x_p[0], problem.x_c[0])
    expected = np.minimum((d / threshold) ** 2, 1.0).mean(axis=1)
    found = truncated_errors(problem.E, problem.x_p[0], problem.x_c[0], threshold)
    np.testing.assert_allclose(found, expected, rtol=2e-3, atol=1e-4)


def test_exact_matches_leave_a_candidate() -> None:
    # All errors are rounding errors of single precision.
    for seed in range(20):
        rng = np.random.default_rng(seed)
        problem = random_problems(rng, 1, 200, "forward")
        x_p, x_c = problem.x_p[0], problem.x_c[0]
        sets = sample_sets(rng, 200, 60)
        E, _ = five_point(x_p[sets], x_c[sets])
        found = truncated_errors(E, x_p, x_c, 1.0 / FOCAL)
        best = E[np.argmin(found)]
        assert np.isfinite(found).any()
        assert np.abs(sampson_distance(best, x_p, x_c)).max() < 1e-3 / FOCAL


def test_of_each_set_the_nearest_to_the_prior_stay() -> None:
    rng = np.random.default_rng(5)
    E = rng.normal(size=(12, 3, 3))
    set_index = np.repeat([0, 2, 7], [1, 4, 7])
    e_prev = essential_vector(rng.normal(size=(3, 3)))
    kept = nearest_to_prior(E, set_index, e_prev, keep=2)
    angle = essential_angle(essential_vector(E), e_prev)
    for s in (0, 2, 7):
        mine = np.flatnonzero(set_index == s)
        assert set(mine[np.argsort(angle[mine])[:2]]) == set(mine[kept[mine]])


@pytest.mark.parametrize("motion", ["general", "forward", "sideways", "planar"])
def test_known_depth_tells_the_four_motions_of_an_essential_matrix_apart(motion: str) -> None:
    problems = random_problems(np.random.default_rng(6), 40, 30, motion)  # type: ignore[arg-type]
    for i in range(40):
        for sign in (1.0, -1.0):
            R, t = resolve_by_depth(sign * problems.E[i], problems.x_p[i], problems.x_c[i], problems.X_p[i])
            assert rotation_angle(R.T @ problems.R_cp[i]) < 1e-6
            np.testing.assert_allclose(t, problems.t_cp[i] / np.linalg.norm(problems.t_cp[i]), atol=1e-6)


def test_near_points_outweigh_far_ones_where_the_depth_chooses_the_motion() -> None:
    rng, R_cp, t_cp = (
        np.random.default_rng(5),
        rotation_from_vector(np.array([0.01, -0.05, 0.02])),
        np.array([0, 0, -1.0]),
    )
    z = np.concatenate([rng.uniform(4, 10, 40), rng.uniform(400, 800, 40)])
    X_p = np.stack([rng.uniform(-0.6, 0.6, 80) * z, rng.uniform(-0.2, 0.2, 80) * z, z], axis=1)
    # A far point says little of a step: these seem to have made thirty of them, the other way.
    X_c = X_p @ R_cp.T + np.where(z > 100, -30.0, 1.0)[:, None] * t_cp
    x_p, x_c = (X[:, :2] / X[:, 2:] for X in (X_p, X_c))
    R, direction = resolve_by_depth(essential_from_motion(R_cp, t_cp), x_p, x_c, X_p)
    np.testing.assert_allclose(R, R_cp, atol=1e-9)
    np.testing.assert_allclose(direction, t_cp, atol=1e-9)


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
