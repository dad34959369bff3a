"""Paths that are long enough for KITTI's sub-sequences, and estimates with known errors."""

from __future__ import annotations

from itertools import accumulate

import numpy as np

from vo_lib.geometry.motion import rigid, rotation_from_vector
from vo_lib.geometry.types import Array

SIDE = 200  # metres, of the block
CORNER = 20  # metres, the arc that rounds a corner


def block_tour(rounds: int = 2) -> Array:
    """Poses (N, 4, 4) round a square block of 800 m, one metre per frame; the last pose equals the first."""
    straight = rigid(np.eye(3), np.array([0.0, 0.0, 1.0]))
    bend = rigid(rotation_from_vector(np.array([0.0, 0.5 * np.pi / CORNER, 0.0])), np.array([0.0, 0.0, 1.0]))
    side = [straight] * (SIDE - CORNER) + [bend] * CORNER
    steps = side * 4 * rounds
    return np.array([*accumulate(steps, np.matmul, initial=np.eye(4))])


def straight_road(frames: int = 1600) -> Array:
    """Poses (N, 4, 4) along a straight road, at 4 to 24 m/s and ten frames per second."""
    step = 1.4 - np.cos(2.0 * np.pi * np.arange(frames) / 400.0)
    poses = np.tile(np.eye(4), (frames + 1, 1, 1))
    poses[1:, 2, 3] = np.cumsum(step)
    return poses


def perturbed_path(
    truth: Array, scale: float = 0.0, yaw: float = 0.0, noise: float = 0.0, jitter: float = 0.0, seed: int = 0
) -> Array:
    """An estimate (N, 4, 4) with known errors.

    Parameters
    ----------
    truth : (N, 4, 4) poses.
    scale : excess length of every step, %.
    yaw : excess turn to the right, deg/100 m.
    noise : standard deviation of each coordinate of a step, millimetres.
    jitter : standard deviation of the yaw of a step, degrees.
    """
    rng = np.random.default_rng(seed)
    # A general inverse: rotations of pose files are orthonormal to 1e-7 only, and the steps must add up.
    T = np.linalg.inv(truth[:-1]) @ truth[1:]
    length = np.linalg.norm(T[:, :3, 3], axis=1)
    turn = np.zeros((len(T), 3))
    turn[:, 1] = np.radians(yaw) * length / 100.0 + np.radians(jitter) * rng.normal(size=len(T))
    T[:, :3, 3] = (1.0 + scale / 100.0) * T[:, :3, 3] + 1e-3 * noise * rng.normal(size=(len(T), 3))
    T[:, :3, :3] = T[:, :3, :3] @ rotation_from_vector(turn)
    return np.array([*accumulate(T, np.matmul, initial=truth[0])])
