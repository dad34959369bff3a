"""Exercises of the appendix: depths and steps from too large disparities, roll from rows, shrinkage."""

from __future__ import annotations

from functools import partial

import numpy as np

from vo_lib.geometry.types import Array

from ..checker import Case, Exercise

FB, E = 386.0, 0.5  # pixel metres, pixels


def depth_seen(Z: Array | float, e: float, fb: float = FB) -> Array:
    """Measured depths of points at Z (N,) metres if each disparity is too large by e pixels."""
    return np.asarray(fb / (fb / np.asarray(Z) + e))


def step_seen(Z: Array, e: float, fb: float) -> Array:
    """Measured length, metres, of a step of 1 m towards points at Z (N,) metres."""
    return depth_seen(Z, e, fb) - depth_seen(Z - 1.0, e, fb)


def fitted_roll(x: Array, y: Array, rows: Array, terms: tuple[int, ...] = (0, 1, 2)) -> float:
    """Roll, pixels: least-squares fit of roll, offset and focal length to row differences (N,)."""
    A = np.column_stack([-x, np.ones_like(x), y])
    return float(np.linalg.lstsq(A[:, terms], rows, rcond=None)[0][0])


def rolled() -> list[Case]:
    """Cases of 60 matches, most in the right half: row errors of a roll, then also of other faults and noise."""
    rng = np.random.default_rng(3)
    x = rng.uniform(-0.5, 0.9, 60)
    y = rng.uniform(-0.2, 0.3, 60) + 0.4 * x
    sizes = (0.8, 0.0, 0.0, 0.0), (-0.3, 0.5, 0.0, 0.0), (0.4, -0.2, 0.7, 0.0), (0.4, -0.2, 0.7, 0.1)
    return [(x, y, a + c * y - roll * x + noise * rng.normal(size=60)) for roll, a, c, noise in sizes]


def shrunk(estimate: Array, covariance: Array, spare: float = 0.0) -> Array:
    """An estimate (k,) times the share of its squared norm, in deviations, that noise does not explain."""
    squared = float(estimate @ np.linalg.solve(covariance, estimate))
    return np.asarray(estimate * max(0.0, 1.0 - (len(estimate) - spare) / squared))


def estimates() -> list[Case]:
    """Estimates of two or four errors, pixels: above, near or below the noise; independent or correlated."""
    alike, different = 0.04 * np.eye(4), np.diag([0.01, 0.04, 0.09, 0.25])
    clear, doubtful = np.array([1.0, -0.5, 0.3, 0.2]), np.array([0.2, -0.5, 0.3, 0.2])
    two = clear[:2], alike[:2, :2]
    return [(clear, alike), (doubtful, different), (doubtful, 0.02 + different), (0.3 * doubtful, alike), two]


SEEN = float(depth_seen(40.0, E))
far_point = Exercise(
    SEEN,
    atol=0.05,
    praise="{right:.1f} m: far points are moved most.",
    hint="depth to disparity, add the error, and back.",
    line="386 / (386 / 40 + 0.5)",
    mistakes={
        "the sign: a point with too large a disparity seems nearer.": float(depth_seen(40.0, -E)),
        "this is the error, not the depth.": (40.0 - SEEN, SEEN - 40.0),
        "this is the disparity in pixels, not yet the depth.": FB / 40.0 + E,
    },
)

step = Exercise(
    step_seen,
    lambda: [(np.array([10.0, 20.0, 40.0]), 0.5, FB), (np.array([15.0, 30.0]), -0.3, 240.0)],
    praise="{right[0]:.3f} m at 10 m, {right[2]:.3f} m at 40 m: the far points shorten the step most.",
    hint="the measured depth before the step minus the measured depth after the step.",
    line="fb / (fb / Z + e) - fb / (fb / (Z - 1) + e)",
    mistakes={
        "this step goes backwards: after it the points are at Z - 1.": lambda Z, *rig: step_seen(Z + 1, *rig),
        "this is the depth before the step alone.": depth_seen,
        "the disparities are too small by e here; add e to the true disparity.": lambda Z, e, fb: step_seen(
            Z, -e, fb
        ),
        "this is right for one rig only: use the argument `fb`.": lambda Z, e, fb: step_seen(Z, e, FB),
    },
    slips={"sign": "the sign: a step ahead makes depths smaller."},
)

roll = Exercise(
    fitted_roll,
    rolled,
    praise="{right:.1f} px from rows alone; no motion is needed.",
    hint="a column of the matrix for each unknown, all three in one fit.",
    line="np.linalg.lstsq(np.column_stack([-x, np.ones_like(x), y]), rows, rcond=None)[0][0]",
    mistakes={
        "the offset is not fitted: its error leaks into the roll.": (
            partial(fitted_roll, terms=(0,)),
            partial(fitted_roll, terms=(0, 2)),
        ),
        "the focal length is not fitted: its error leaks into the roll.": partial(fitted_roll, terms=(0, 1)),
    },
    slips={"sign": "the sign: with a roll above 0 the rows fall with x."},
)

shrink = Exercise(
    shrunk,
    estimates,
    praise="a clear estimate stays nearly whole, one within its noise becomes 0.",
    hint="noise alone gives a squared length of k, in deviations: which share of the square is more than that?",
    line="max(0, 1 - k / (estimate @ np.linalg.inv(covariance) @ estimate)) * estimate",
    also=(partial(shrunk, spare=2.0),),  # as James and Stein have it
    mistakes={
        "an estimate within its noise has changed its sign: a factor below 0 counts as 0.": lambda e, C: (
            e * (1.0 - len(e) / (e @ np.linalg.solve(C, e)))
        ),
        "each error is shrunk by its own deviation; shrink the estimate as a whole.": lambda e, C: (
            e * np.maximum(0.0, 1.0 - np.diag(C) / e**2)
        ),
        "the errors are correlated: the inverse of the whole covariance, not of its diagonal.": lambda e, C: (
            shrunk(e, np.diag(np.diag(C)))
        ),
        "this is the share that noise explains; the rest of the estimate is kept.": lambda e, C: (
            e * len(e) / (e @ np.linalg.solve(C, e))
        ),
        "this is the factor for a square of 1; noise in k errors has a square of k.": lambda e, C: (
            e * max(0.0, 1.0 - 1.0 / (e @ np.linalg.solve(C, e)))
        ),
    },
)
