"""Preselection by the prior, and selection of one of four motions by depth."""

from __future__ import annotations

import numpy as np
import pytest

from course.simulation.problems import random_problems
from vo_lib.geometry.motion import (
    essential_angle,
    essential_from_motion,
    essential_vector,
    rotation_angle,
    rotation_from_vector,
)
from vo_lib.paper.selection import nearest_to_prior, resolve_by_depth

FOCAL = 718.856


def test_nearest_candidates_of_each_set_stay() -> None:
    rng = np.random.default_rng(5)
    E = rng.normal(size=(12, 3, 3))
    set_index = np.repeat([0, 2, 7], [1, 4, 7])
    e_prev = essential_vector(rng.normal(size=(3, 3)))
    kept = nearest_to_prior(E, set_index, e_prev, top_k=2)
    angle = essential_angle(essential_vector(E), e_prev)
    for s in (0, 2, 7):
        mine = np.flatnonzero(set_index == s)
        assert set(mine[np.argsort(angle[mine])[:2]]) == set(mine[kept[mine]])


@pytest.mark.parametrize("motion", ["general", "forward", "sideways", "planar"])
def test_depth_selects_one_of_four_motions(motion: str) -> None:
    problems = random_problems(np.random.default_rng(6), 40, 30, motion)  # type: ignore[arg-type]
    for i in range(40):
        for sign in (1.0, -1.0):
            R, t = resolve_by_depth(sign * problems.E[i], problems.x_c[i], problems.X_p[i])
            assert rotation_angle(R.T @ problems.R_cp[i]) < 1e-6
            np.testing.assert_allclose(t, problems.t_cp[i] / np.linalg.norm(problems.t_cp[i]), atol=1e-6)


def test_near_points_outweigh_far_points() -> None:
    rng, t_cp = np.random.default_rng(5), np.array([0.0, 0.0, -1.0])
    R_cp = rotation_from_vector(np.array([0.01, -0.05, 0.02]))
    z = np.concatenate([rng.uniform(4, 10, 40), rng.uniform(400, 800, 40)])
    X_p = np.stack([rng.uniform(-0.6, 0.6, 80) * z, rng.uniform(-0.2, 0.2, 80) * z, z], axis=1)
    # A far point has little information on a step: the far points have the opposite motion, 30 times as long.
    X_c = X_p @ R_cp.T + np.where(z > 100, -30.0, 1.0)[:, None] * t_cp
    x_c = X_c[:, :2] / X_c[:, 2:]
    R, direction = resolve_by_depth(essential_from_motion(R_cp, t_cp), x_c, X_p)
    np.testing.assert_allclose(R, R_cp, atol=1e-9)
    np.testing.assert_allclose(direction, t_cp, atol=1e-9)


@pytest.mark.parametrize("missing", [[0], [3, 17], list(range(25))])
def test_points_without_depth_do_not_decide_on_the_motion(missing: list[int]) -> None:
    problems = random_problems(np.random.default_rng(8), 40, 30, "general")
    for i in range(40):
        X_p = problems.X_p[i].copy()
        X_p[missing] = np.nan
        R, t = resolve_by_depth(problems.E[i], problems.x_c[i], X_p)
        assert rotation_angle(R.T @ problems.R_cp[i]) < 1e-6
        np.testing.assert_allclose(t, problems.t_cp[i] / np.linalg.norm(problems.t_cp[i]), atol=1e-6)


def test_without_any_depth_the_choice_stays_open() -> None:
    problems = random_problems(np.random.default_rng(9), 1, 30, "general")
    X_p = np.full((30, 3), np.nan)
    R, t = resolve_by_depth(problems.E[0], problems.x_c[0], X_p)
    assert np.isfinite(R).all()
    assert np.isfinite(t).all()
