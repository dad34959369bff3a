"""Comparison of the pose graph with its definition and with GTSAM."""

from __future__ import annotations

from itertools import accumulate
from typing import Any

import numpy as np
import pytest

from vo_lib.geometry.motion import inverse
from vo_lib.geometry.twist import motion_from_twist
from vo_lib.geometry.types import Array
from vo_lib.loops.graph import Edges, linearised, optimise

COUNT = 12
SIGMA = np.array([0.02, 0.1])  # radians, metres


def random_graph(seed: int) -> tuple[Array, Edges]:
    """12 poses of two rounds, integrated from odometry, and the edges with noise of `SIGMA`."""
    rng = np.random.default_rng(seed)
    step = np.array([0.0, 2 * np.pi / 6, 0.0, 0.0, 0.0, 3.0])
    steps = motion_from_twist(step + rng.normal(0, 0.05, (COUNT - 1, 6)))
    poses = np.array(list(accumulate(steps, np.matmul, initial=np.eye(4))))
    loops = [(i, i + 6) for i in range(6)] + [tuple(sorted(rng.choice(COUNT, 2, False))) for _ in range(3)]
    first, second = np.array([(i, i + 1) for i in range(COUNT - 1)] + loops).T
    noise = rng.normal(0, 1, (len(first), 6)) * np.repeat(SIGMA, 3)
    motion = inverse(poses[first]) @ poses[second] @ motion_from_twist(noise)
    start = np.array(list(accumulate(motion[: COUNT - 1], np.matmul, initial=np.eye(4))))
    is_loop = np.arange(len(first)) >= COUNT - 1
    return start, Edges(first, second, motion, np.tile(SIGMA, (len(first), 1)), is_loop)


def test_pose_graph_derivatives_equal_finite_differences() -> None:
    poses, edges = random_graph(3)
    r, first, second = linearised(poses, edges)
    h = 1e-6
    for k in range(6):
        small = motion_from_twist(h * np.eye(6)[k])
        for derivative, side in ((first, edges.first_place), (second, edges.second_place)):
            for edge in range(len(edges)):
                moved = poses.copy()
                moved[side[edge]] = moved[side[edge]] @ small
                difference = (linearised(moved, edges)[0][edge] - r[edge]) / h
                assert derivative[edge, :, k] == pytest.approx(difference, abs=1e-4)


@pytest.mark.parametrize("scale", [np.inf, 3.0])
def test_pose_graph_has_the_same_optimum_as_gtsam(scale: float) -> None:
    gtsam: Any = pytest.importorskip("gtsam", exc_type=ImportError)
    for seed in range(100):
        start, edges = random_graph(seed)
        actual = optimise(start, edges, scale, tolerance=1e-10)[0]
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        for i, T in enumerate(start):
            values.insert(i, gtsam.Pose3(T))
        graph.add(gtsam.PriorFactorPose3(0, gtsam.Pose3(start[0]), gtsam.noiseModel.Constrained.All(6)))
        plain = gtsam.noiseModel.Diagonal.Sigmas(np.repeat(SIGMA, 3))
        cauchy = gtsam.noiseModel.mEstimator.Cauchy.Create(min(scale, 1e9))
        robust = gtsam.noiseModel.Robust.Create(cauchy, plain)
        for i, j, T, _, is_loop in zip(*vars(edges).values(), strict=True):
            noise = robust if is_loop and np.isfinite(scale) else plain
            graph.add(gtsam.BetweenFactorPose3(int(i), int(j), gtsam.Pose3(T), noise))
        settings = gtsam.LevenbergMarquardtParams()
        settings.setMaxIterations(500)
        settings.setRelativeErrorTol(0.0)
        settings.setAbsoluteErrorTol(0.0)
        solver = gtsam.LevenbergMarquardtOptimizer(graph, values, settings)
        result = solver.optimize()
        theirs = np.array([result.atPose3(i).matrix() for i in range(len(start))])
        assert actual == pytest.approx(theirs, abs=1e-6), seed
