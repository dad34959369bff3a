"""Chapter 4, beyond the paper: what the rectification left between the two cameras, learnt from the images.

In a rectified pair both images of a point lie on one row, and the columns differ by f b / Z. In a real pair
both are off by a smooth field over the image, of some tenths of a pixel: far points seem too far, or near,
and steps come out too long, on the KITTI highway by 5 %. The field is a polynomial for the disparities and
one for the rows, in the normalised left position x, y.

They belong together, for each fault of a rig has a shape in both (`FAULTS`). Stereo matches show the rows at
once, and with them roll and focal length, which a moving camera cannot tell from a longer step. The rest is
learnt from the motion: disparities must agree with parallax. One frame knows little of that; a Kalman filter
carries the coefficients along. Too few terms are worse than none: the rest of the field ends up in the
constant, which decides the length of the steps.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from ..core.camera import StereoCamera
from ..core.geometry import NORMAL
from ..core.matches import StereoMatches
from ..core.types import Array
from .config import CalibrationConfig

Shape = dict[str, float]

COLUMNS = ("1", "x", "y", "x²", "xy", "y²", "x³", "x²y", "x⁴")
ROWS = COLUMNS[:6]
EXPONENTS = np.array([(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (4, 0)]).T
N = len(COLUMNS)
# What may be wrong with one camera against the other: its shape in the columns, in the rows, and how large it
# may be, pixels (standard deviation before the first frame). To first order a yaw is a shift along the rows
# and a tilt about the vertical; decentering is a tilt of three times its size and what is left here.
FAULTS: dict[str, tuple[Shape, Shape, float]] = {
    "shift along the rows": ({"1": 1}, {}, 1.5),
    "shift across the rows": ({}, {"1": 1}, 3.0),
    "roll": ({"y": 1}, {"x": -1}, 1.0),
    "focal length": ({"x": 1}, {"y": 1}, 1.0),
    "tilt about the vertical": ({"x²": 1}, {"xy": 1}, 5.0),
    "tilt about the horizontal": ({"xy": 1}, {"y²": 1}, 1.0),
    "decentering along the rows": ({"y²": 1}, {"xy": -1}, 5.0),
    "decentering across the rows": ({"xy": -1}, {"x²": 1}, 1.0),
}
# What an undistortion by other polynomials leaves has no shape of its own.
LEFT = {"x²": 1.0, "xy": 0.2, "y²": 1.5, "x³": 0.5, "x²y": 1.0, "x⁴": 4.0}
FAULTS |= {f"columns, {term}": ({term: 1}, {}, deviation) for term, deviation in LEFT.items()}
FAULTS |= {f"rows, {term}": ({}, {term: 1}, 0.5) for term in ("x²", "xy", "y²")}
STIFF = 0.01  # pixels; what no fault explains, in each coefficient

STEPS = 4  # Gauss-Newton steps; from the solved motion and the measured disparities two nearly do
FAINTEST = 0.3  # pixels; features of smaller disparity are left out
NEAREST = 0.05  # smallest depth in the current frame, as a share of that in the previous one
FEWEST = 10  # features; fewer say nothing
FINEST = 0.1  # pixels; no frame's noise is taken to be smaller
FARTHEST = 3.0  # standard deviations; a frame that asks for a larger change is cut to it


class StereoField:
    """The field of disparity and row errors, left less right, from frame to frame.

    Attributes
    ----------
    estimate : (15,) coefficients, pixels, of `COLUMNS` for the disparities, then of `ROWS`.
    covariance : (15, 15) of the estimate.
    coefficients : (15,) those in use, the estimate shrunk as a whole: the part of its squared size that its
        covariance explains is taken for noise (James and Stein 1961, positive part).
    """

    def __init__(self, camera: StereoCamera, config: CalibrationConfig):
        self.camera = camera
        self.config = config
        self.covariance = self._prior = prior_covariance()
        self.know(np.zeros(N + len(ROWS)), self.covariance)

    def correct(self, matches: StereoMatches, coefficients: Array | None = None) -> StereoMatches:
        """Matches without these errors: the right positions move. Which image is at fault cannot be told."""
        c = self.coefficients if coefficients is None else coefficients
        points = (self.camera.normalise(left).T for left in (matches.prev_left, matches.cur_left))
        before, now = (field_at(c, *point).T for point in points)
        return dataclasses.replace(
            matches, prev_right=matches.prev_right + before, cur_right=matches.cur_right + now
        )

    def learn_rows(self, matches: StereoMatches) -> None:
        """Learn from the rows of a frame's stereo matches, as they were measured; Cauchy weights."""
        if len(matches) == 0:
            return
        A = np.zeros((len(self.estimate), len(matches)))
        A[N:] = powers(*self.camera.normalise(matches.cur_left).T)[: len(ROWS)]
        difference = matches.cur_left[:, 1] - matches.cur_right[:, 1]
        known = np.linalg.inv(self.covariance + self.config.drift**2 * self._prior)
        start, estimate = known @ self.estimate, self.estimate
        for _ in range(STEPS):
            residual = difference - estimate @ A
            noise = max(NORMAL**2 * float(np.median(residual**2)), FINEST**2)
            weighted = A / (1.0 + (residual / self.config.row_scale) ** 2)
            weighted /= noise * self.config.noise_inflation**2
            information = known + weighted @ A.T
            estimate = np.asarray(np.linalg.solve(information, start + weighted @ difference))
        self.know(estimate, np.asarray(np.linalg.inv(information)))

    def update(self, matches: StereoMatches, R_cp: Array, t_cp: Array) -> Array | None:
        """Learn from a frame's corrected matches and motion; the change (15,), None if it is little."""
        found = parallax_information(self.camera, matches, R_cp, t_cp, self.config.scale)
        if found is None:
            return None
        in_use, known = self.coefficients, np.linalg.inv(self.covariance)
        information, vector = known.copy(), np.zeros(len(known))
        information[:N, :N] += found[0] / self.config.noise_inflation**2
        # What corrected the matches is what is in use, not the estimate.
        vector[:N] = (found[1] - found[0] @ (self.estimate - in_use)[:N]) / self.config.noise_inflation**2
        change = np.linalg.solve(information, vector)
        change *= min(1.0, FARTHEST / max(float(np.sqrt(change @ known @ change)), 1e-12))
        self.know(self.estimate + change, np.linalg.inv(information))
        more = self.coefficients - in_use
        more[N:] = 0.0  # of the rows only their own measurements count in this frame
        size = np.sqrt(np.mean(field_at(more, *self.camera.normalise(matches.cur_left).T) ** 2))
        return None if size < self.config.least_change else more

    def know(self, estimate: Array, covariance: Array) -> None:
        """From now on this is known: an estimate (15,) and its covariance (15, 15)."""
        self.estimate, self.covariance = estimate, covariance
        squared = float(estimate @ np.linalg.solve(covariance, estimate))
        self.coefficients = estimate * max(0.0, 1.0 - len(estimate) / max(squared, 1e-12))


def field_at(coefficients: Array, x: Array, y: Array) -> Array:
    """Errors (2, N) of disparity and row, pixels, at normalised left positions x, y (N,)."""
    terms = powers(x, y)
    return np.stack([coefficients[:N] @ terms, coefficients[N:] @ terms[: len(ROWS)]])


def powers(x: Array, y: Array) -> Array:
    """The terms of `COLUMNS` at normalised positions x, y (N,), (9, N); the first six are those of `ROWS`."""
    xs, ys = (np.stack([np.ones_like(a), a, a * a, a**3, (a * a) ** 2]) for a in (x, y))
    return np.asarray(xs[EXPONENTS[0]] * ys[EXPONENTS[1]])


def prior_covariance() -> Array:
    """Covariance (15, 15) of the coefficients before the first frame: all `FAULTS`, each of random size."""
    covariance = np.eye(N + len(ROWS)) * STIFF**2
    for columns, rows, deviation in FAULTS.values():
        shape = np.array([columns.get(k, 0.0) for k in COLUMNS] + [rows.get(k, 0.0) for k in ROWS])
        covariance += deviation**2 * np.outer(shape, shape)
    return covariance


def parallax_information(
    camera: StereoCamera, matches: StereoMatches, R_cp: Array, t_cp: Array, scale: float
) -> tuple[Array, Array] | None:
    """What a frame says of the disparities' coefficients: information (9, 9), and it times them (9,).

    A feature is where the previous left image shows it. With D = f b / Z, the disparity it should have there,
    (X, Y, Z) = R_cp (x, y, 1) + D / (f b) t_cp is its place in the current frame, in units of its depth, and

        d_p = D + e(x_p),   u_c = f X / Z,   v_c = f Y / Z,   d_c = D / Z + e(x_c),

    e the error. Gauss-Newton over every D and t_cp, the rotation held; at the end both are eliminated. Cauchy
    weights, `scale` in pixels. None where too few features are left or t_cp has no unique answer.
    """
    matches = matches[matches.prev_left[:, 0] - matches.prev_right[:, 0] > FAINTEST]
    if len(matches) < FEWEST:
        return None
    f, fb, t = camera.f, camera.f * camera.baseline, t_cp
    x_p, x_c = camera.normalise(matches.prev_left).T, camera.normalise(matches.cur_left).T
    D, d_c = (matches.prev_left - matches.prev_right)[:, 0], (matches.cur_left - matches.cur_right)[:, 0]
    measured = np.stack([D, f * x_c[0], f * x_c[1], d_c])
    one, ray = np.ones_like(D), R_cp @ np.vstack([x_p, np.ones_like(D)])
    by_all = np.zeros((3 + N, 4, len(D)))
    by_all[3:, 0], by_all[3:, 3] = powers(*x_p), powers(*x_c)
    try:
        for step in range(STEPS):
            X, Y, Z = ray + D / fb * t[:, None]
            Z = np.maximum(Z, NEAREST)
            x, y, s = X / Z, Y / Z, D / (fb * Z)
            residual = measured - np.stack([D, f * x, f * y, D / Z])
            toward = (t[:2, None] - t[2] * np.stack([x, y])) * f / (fb * Z)
            by_D = np.stack([one, *toward, (1.0 - t[2] * s) / Z])
            by_all[0, 1] = by_all[1, 2] = f * s
            by_all[2, 1:] = -f * s * x, -f * s * y, -s * D / Z
            by = by_all if step == STEPS - 1 else by_all[:3]
            # Without the part along by_D, D is eliminated: the projector I - J Jᵀ / JᵀJ of each feature.
            norm = np.sum(by_D**2, axis=0)
            own, own_by = np.sum(by_D * residual, axis=0) / norm, np.sum(by_D * by, axis=1) / norm
            residual, by = residual - by_D * own, by - by_D * own_by[:, None]
            squared = np.sum(residual**2, axis=0)
            weighted = (by / (1.0 + squared / scale**2)).reshape(len(by), -1)
            H, g = weighted @ by.reshape(len(by), -1).T, weighted @ residual.ravel()
            if step < STEPS - 1:
                change = np.linalg.solve(H, g)
                t, D = t + change, np.maximum(D + own - change @ own_by, FAINTEST)
        by_t = np.linalg.solve(H[:3, :3], np.column_stack([H[:3, 3:], g[:3]]))
    except np.linalg.LinAlgError:
        return None
    noise = max(float(np.median(squared)) / 3.0, FINEST**2)  # four rows, less one for D
    return (H[3:, 3:] - H[3:, :3] @ by_t[:, :-1]) / noise, (g[3:] - H[3:, :3] @ by_t[:, -1]) / noise
