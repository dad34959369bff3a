"""How hard one feature pulls the translation: by the inverse of its depth, and less the more it is off."""

from __future__ import annotations

import numpy as np
import pytest

from vo_lib.beyond.translation import solve_translation
from vo_lib.config import TranslationConfig
from vo_lib.core.camera import StereoCamera
from vo_lib.core.matches import StereoMatches
from vo_lib.core.types import Array

CAMERA = StereoCamera(f=700.0, cx=600.0, cy=180.0, baseline=0.5, width=1200, height=360)
WIDE = 20.0  # pixels: no feature here is anything like so far off


def exact(X: Array) -> list[Array]:
    """The four views (N, 2) of points (N, 3) from a camera that stands, which keeps every depth."""
    return [*CAMERA.project(X), *CAMERA.project(X)]


def matches_of(views: list[Array]) -> StereoMatches:
    n = len(views[0])
    left, right, now_left, now_right = views
    return StereoMatches(left, right, now_left, now_right, np.ones(n, int), np.ones(n), np.arange(n))


def crowd() -> Array:
    """800 points, mirrored about the line midway between the cameras: no axis couples with another."""
    x, y, z = np.random.default_rng(0).uniform([0.5, -2, 6], [6, 2, 30], (200, 3)).T
    return np.concatenate(
        [np.stack([a * x + CAMERA.baseline / 2, b * y, z], 1) for a in (1, -1) for b in (1, -1)]
    )


def pull(depth: float, error: Array, scale: float = WIDE) -> Array:
    """How far t (3,) moves, metres, when the views of one feature straight ahead are off by (4, 2) pixels."""
    # Half way between both cameras, so that its ray is the axis.
    X = np.concatenate([crowd(), [[CAMERA.baseline / 2, 0.0, depth]]])
    views = exact(X)
    for view, off in zip(views, error, strict=True):
        view[-1] += off
    config = TranslationConfig(scale=scale, iterations=50)
    solved = solve_translation(CAMERA, matches_of(views), np.eye(3), config)
    assert solved is not None
    return solved[0]


def sinking(pixels: float) -> Array:
    """The feature is lower by so much in both current images."""
    return np.array([[0.0, 0.0], [0.0, 0.0], [0.0, pixels], [0.0, pixels]])


def nearing(pixels: float) -> Array:
    """The feature's current disparity is larger by so much, half of it in each image."""
    return np.array([[0.0, 0.0], [0.0, 0.0], [pixels / 2, 0.0], [-pixels / 2, 0.0]])


@pytest.mark.parametrize("times", [2.0, 4.0])
def test_a_pixel_across_the_ray_pulls_by_the_inverse_of_the_depth(times: float) -> None:
    # It says Z e / f, and counts by 1 / Z².
    near, far = (pull(z, sinking(0.1))[1] for z in (7.0, 7.0 * times))
    assert near > 0
    assert near / far == pytest.approx(times, rel=0.02)


@pytest.mark.parametrize("times", [2.0, 4.0])
def test_a_pixel_of_disparity_pulls_by_the_inverse_square_of_the_depth(times: float) -> None:
    # It says Z² e / f b, and counts by 1 / Z⁴.
    near, far = (pull(z, nearing(0.1))[2] for z in (7.0, 7.0 * times))
    assert near < 0
    assert near / far == pytest.approx(times**2, rel=0.1)


@pytest.mark.parametrize("scale", [0.5, 2.0])
@pytest.mark.parametrize(("residual", "weight"), [(1.0, 1 / 2), (3**0.5, 1 / 4), (2.0, 1 / 5)])
def test_the_weight_is_halved_at_the_scale(scale: float, residual: float, weight: float) -> None:
    # A feature lower by e in both current images leaves e / 2 in each of its four rows along v: e in all.
    little = 0.02 * scale
    by_little = pull(10.0, sinking(little), scale=scale)[1] / little
    by_much = pull(10.0, sinking(residual * scale), scale=scale)[1] / (residual * scale)
    assert by_much / by_little == pytest.approx(weight, rel=0.02)
