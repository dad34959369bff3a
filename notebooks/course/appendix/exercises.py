"""Exercises of the appendix: a depth and a step seen by a rig whose disparities are all too large."""

from __future__ import annotations

import numpy as np

from vo_lib.geometry.types import Array

from ..checker import Exercise

FB, E = 386.0, 0.5  # pixel metres, pixels


def depth_seen(Z: Array | float, e: float, fb: float = FB) -> Array:
    """How far points at Z (N,) metres seem to be where each disparity is too large by e pixels."""
    return np.asarray(fb / (fb / np.asarray(Z) + e))


def step_seen(Z: Array, e: float, fb: float) -> Array:
    """The length that a step of 1 m towards points at Z (N,) seems to have."""
    return depth_seen(Z, e, fb) - depth_seen(Z - 1.0, e, fb)


far_point = Exercise(
    float(depth_seen(40.0, E)),
    atol=0.05,
    task="How far a point at 40 m seems to be, f b = 386 px m, if each disparity is half a pixel too large.",
    praise="{right:.1f} m: far points are moved most.",
    hint="depth to disparity, add the error, and back.",
    line="386 / (386 / 40 + 0.5)",
    mistakes={
        "the sign: a point with too large a disparity seems nearer.": float(depth_seen(40.0, -E)),
        "this is the error, not the depth.": 40.0 - float(depth_seen(40.0, E)),
    },
)

step = Exercise(
    step_seen,
    lambda: [(np.array([10.0, 20.0, 40.0]), 0.5, FB), (np.array([15.0, 30.0]), -0.3, 386.0)],
    task="A function (Z (N,), e, fb) -> the length that a step of 1 m towards each point seems to have.",
    praise="{right[0]:.3f} m at 10 m, {right[2]:.3f} m at 40 m: the far points shorten the step most.",
    hint="the depth that is seen before the step, less the one seen after it.",
    line="fb / (fb / Z + e) - fb / (fb / (Z - 1) + e)",
    mistakes={
        "this step goes backwards: after it the points are at Z - 1.": lambda Z, *rig: step_seen(Z + 1, *rig),
        "this is the depth before the step alone.": depth_seen,
    },
    slips={"sign": "the sign: a step ahead makes depths smaller."},
)
