"""Exercises of the appendix: depths and steps from too large disparities, roll, two terms, shrinkage."""

from __future__ import annotations

from functools import partial

import numpy as np

from vo_lib.geometry.types import Array

from ..checker import Case, Exercise

FB = 386.0  # pixel metres
E = 0.5  # pixels, error of a disparity


def depth_seen(Z: Array | float, e: float, fb: float = FB) -> Array:
    """Measured depths of points at Z (N,) metres if each disparity is too large by e pixels."""
    return np.asarray(fb / (fb / np.asarray(Z) + e))


def step_seen(Z: Array, e: float, fb: float) -> Array:
    """Measured length, metres, of a step of 1 m towards points at Z (N,) metres."""
    return depth_seen(Z, e, fb) - depth_seen(Z - 1.0, e, fb)


def fitted_roll(x: Array, y: Array, rows: Array, terms: tuple[int, ...] = (0, 1, 2)) -> float:
    """Roll in pixels, from a least-squares fit of roll, offset and focal length to row differences (N,).

    terms : what is fitted (0: roll, 1: offset, 2: focal length); the result is the coefficient of the first one.
    """
    A = np.column_stack([-x, np.ones_like(x), y])
    coefficients = np.linalg.lstsq(A[:, terms], rows, rcond=None)[0]
    return float(coefficients[0])


def rolled() -> list[Case]:
    """60 matches, mostly in the right half: row differences due to a roll, then also due to other errors."""
    rng = np.random.default_rng(3)
    x = rng.uniform(-0.5, 0.9, 60)
    y = rng.uniform(-0.2, 0.3, 60) + 0.4 * x
    cases: list[Case] = []
    for roll, offset, focal, noise in (
        (0.8, 0.0, 0.0, 0.0),
        (-0.3, 0.5, 0.0, 0.0),
        (0.4, -0.2, 0.7, 0.0),
        (0.4, -0.2, 0.7, 0.1),
    ):
        rows = offset + focal * y - roll * x + noise * rng.normal(size=60)
        cases.append((x, y, rows))
    return cases


def fitted_terms(k: Array, d_p: Array, d_c: Array, q_p: Array, q_c: Array) -> Array:
    """Errors a and b, pixels, of the disparity error a + b q, from the depth ratios k and disparities (N,)."""
    A = np.column_stack([k - 1.0, k * q_p - q_c])
    return np.asarray(np.linalg.lstsq(A, k * d_p - d_c, rcond=None)[0])


def one_term(k: Array, d_p: Array, d_c: Array, q_p: Array, q_c: Array) -> Array:
    """Wrong answer: the mean of the shifts that the single features give, and no second term."""
    return np.array([np.mean((k * d_p - d_c) / (k - 1.0)), 0.0])


def measured_ratios() -> list[Case]:
    """40 features on a drive: ratios of depths, disparities and shapes at both places; also with noise."""
    rng = np.random.default_rng(5)
    Z = rng.uniform(8.0, 40.0, 40)
    y = rng.uniform(-0.2, 0.3, 40)
    cases: list[Case] = []
    for step, a, b, noise in ((4.0, 0.5, 0.0, 0.0), (2.0, -0.6, 6.3, 0.0), (3.0, 0.2, -4.0, 0.1)):
        k = Z / (Z - step)
        q_p = y**2
        q_c = (k * y) ** 2
        d_p = FB / Z + a + b * q_p + noise * rng.normal(size=40)
        d_c = k * FB / Z + a + b * q_c + noise * rng.normal(size=40)
        cases.append((k, d_p, d_c, q_p, q_c))
    return cases


def shrunk(estimate: Array, covariance: Array, spare: float = 0.0) -> Array:
    """An estimate (k,) times the share of its squared norm that noise does not explain.

    covariance : (k, k) of its noise. spare : noise is expected to explain k - `spare`.
    """
    squared = squared_norm(estimate, covariance)
    return np.asarray(estimate * max(0.0, 1.0 - (len(estimate) - spare) / squared))


def squared_norm(estimate: Array, covariance: Array) -> float:
    """The square s of an estimate (k,) in standard deviations."""
    return float(estimate @ np.linalg.solve(covariance, estimate))


def estimates() -> list[Case]:
    """Two or four estimated errors in pixels, above, near or below the noise; one case has correlated noise."""
    alike = 0.04 * np.eye(4)
    different = np.diag([0.01, 0.04, 0.09, 0.25])
    clear = np.array([1.0, -0.5, 0.3, 0.2])
    doubtful = np.array([0.2, -0.5, 0.3, 0.2])
    correlated = 0.02 + different
    return [
        (clear, alike),
        (doubtful, different),
        (doubtful, correlated),
        (0.3 * doubtful, alike),
        (clear[:2], alike[:2, :2]),
    ]


SEEN = float(depth_seen(40.0, E))
far_point = Exercise(
    SEEN,
    atol=0.05,
    praise="{right:.1f} m: the error of the depth grows with the square of the depth.",
    hint="convert the depth to a disparity, add the error, and convert the sum to a depth.",
    line="386 / (386 / 40 + 0.5)",
    mistakes={
        "the sign is wrong: with a larger disparity, the measured depth is smaller.": float(
            depth_seen(40.0, -E)
        ),
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
        "this step is backwards: after a step ahead, the points are at Z - 1.": lambda Z, e, fb: step_seen(
            Z + 1, e, fb
        ),
        "this is only the depth before the step.": depth_seen,
        "this is the error of the length: return the measured length.": lambda Z, e, fb: (
            step_seen(Z, e, fb) - 1.0
        ),
        "these disparities are too small by e: add e to the true disparity.": lambda Z, e, fb: step_seen(
            Z, -e, fb
        ),
        "this is right for one rig only: use the argument `fb`.": lambda Z, e, fb: step_seen(Z, e, FB),
    },
    slips={"sign": "the sign is wrong: a step ahead makes the depths smaller."},
)

roll = Exercise(
    fitted_roll,
    rolled,
    praise="{right:.1f} px from rows alone; no motion is needed.",
    hint="make a matrix with a column for each of the three unknowns, and fit all unknowns at once.",
    line="np.linalg.lstsq(np.column_stack([-x, np.ones_like(x), y]), rows, rcond=None)[0][0]",
    mistakes={
        "the offset is not fitted: the roll contains a part of the offset.": (
            partial(fitted_roll, terms=(0,)),
            partial(fitted_roll, terms=(0, 2)),
        ),
        "the focal length is not fitted: the roll contains a part of its error.": partial(
            fitted_roll, terms=(0, 1)
        ),
        "this is the offset or the focal length: return the coefficient of the column -x.": (
            partial(fitted_roll, terms=(1, 0, 2)),
            partial(fitted_roll, terms=(2, 0, 1)),
        ),
    },
    slips={
        "sign": "the sign is wrong: with a roll above 0, the row differences decrease with x.",
        "degrees": "the task asks for the coefficient of the fit in pixels: no conversion of angles is needed.",
        "radians": "the task asks for the coefficient of the fit in pixels: no conversion of angles is needed.",
    },
)

two_terms = Exercise(
    fitted_terms,
    measured_ratios,
    parts=("a", "b"),
    praise="a = {got[0]:.2f} px and b = {got[1]:.2f} px, without the length of the step.",
    hint="one row for each feature: the factors of a and b. The right side is k d_p - d_c.",
    line="np.linalg.lstsq(np.column_stack([k - 1, k * q_p - q_c]), k * d_p - d_c, rcond=None)[0]",
    mistakes={
        "this has the shape at one place only; both places have their own q.": (
            lambda k, d_p, d_c, q_p, q_c: fitted_terms(k, d_p, d_c, q_p, q_p),
            lambda k, d_p, d_c, q_p, q_c: fitted_terms(k, d_p, d_c, q_c, q_c),
        ),
        "the places have changed: k belongs to the previous frame, k d_p - d_c.": lambda k, d_p, d_c, q_p, q_c: (
            fitted_terms(k, d_c, d_p, q_c, q_p)
        ),
        "this is the mean of what each feature says: features with k near 1 say nothing, and count as much.": (
            one_term
        ),
        "the factor of a is k - 1: the error is in both disparities.": lambda k, d_p, d_c, q_p, q_c: (
            np.linalg.lstsq(np.column_stack([k, k * q_p - q_c]), k * d_p - d_c, rcond=None)[0]
        ),
    },
    slips={"sign": "the sign is wrong: measured minus true disparity is the error."},
)

shrink = Exercise(
    shrunk,
    estimates,
    praise="a clear estimate hardly changes; an estimate within its noise becomes 0.",
    hint="compute s. Noise explains the share k / s of the square; multiply the estimate by the remaining share.",
    line="max(0, 1 - k / (estimate @ np.linalg.inv(covariance) @ estimate)) * estimate",
    also=(partial(shrunk, spare=2.0),),  # the factor of James and Stein
    mistakes={
        "the factor of an estimate within its noise is negative: a factor below 0 counts as 0.": lambda e, C: (
            e * (1.0 - len(e) / squared_norm(e, C))
        ),
        "measure the square in standard deviations: use the inverse of the covariance.": (
            lambda e, C: shrunk(e, np.eye(len(e))),
            lambda e, C: shrunk(e, np.linalg.inv(C)),
        ),
        "each error has its own factor: all errors have the same factor.": lambda e, C: (
            e * np.maximum(0.0, 1.0 - np.diag(C) / e**2)
        ),
        "the errors are correlated: use the inverse of the whole covariance, not of its diagonal.": lambda e, C: (
            shrunk(e, np.diag(np.diag(C)))
        ),
        "this is the share that noise explains: return the rest of the estimate.": lambda e, C: (
            e * len(e) / squared_norm(e, C)
        ),
        "the share of the noise is 1 / s here: noise in k errors has s = k on average.": lambda e, C: (
            e * max(0.0, 1.0 - 1.0 / squared_norm(e, C))
        ),
    },
)
