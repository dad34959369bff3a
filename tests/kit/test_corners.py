"""Corners: position, strength, border and cells."""

from __future__ import annotations

import numpy as np

from vo_lib.geometry.types import Array
from vo_lib.kit.corners import corner_strength, detect_corners, in_empty_cells
from vo_lib.kit.settings import KitFeatureConfig


def test_corners_of_a_square_are_found_and_its_edges_are_not() -> None:
    image = np.zeros((120, 160), np.uint8)
    image[40:80, 50:110] = 200
    uv, strength = detect_corners(corner_strength(image), KitFeatureConfig())
    expected = np.array([[50, 40], [109, 40], [50, 79], [109, 79]])
    assert len(uv) == 4
    assert max(np.linalg.norm(expected - p, axis=1).min() for p in uv) <= 2
    assert (strength > KitFeatureConfig().quality).all()


def test_corner_strength_is_the_smaller_eigenvalue() -> None:
    """Comparison with NumPy's eigenvalues at one pixel of the half-size image, grey levels."""
    half = np.random.default_rng(3).integers(0, 255, (30, 40)).astype(np.uint8)
    image = np.pad(np.repeat(np.repeat(half, 2, axis=0), 2, axis=1), ((0, 0), (0, 1)))
    strength = corner_strength(image)
    assert strength.shape == (30, 40)
    row, column = 12, 17
    # The 3×3 pixels around the pixel, and one more pixel on each side for Sobel's gradients.
    grey = half[row - 2 : row + 3, column - 2 : column + 3].astype(float)
    along_u = np.outer([1.0, 2.0, 1.0], [-1.0, 0.0, 1.0]) / 4.0
    windows = np.lib.stride_tricks.sliding_window_view(grey, (3, 3))
    g = np.stack([(windows * kernel).sum(axis=(2, 3)).ravel() for kernel in (along_u, along_u.T)])
    expected = np.sqrt(np.linalg.eigvalsh(g @ g.T / 9.0)[0])
    np.testing.assert_allclose(strength[row, column], expected, rtol=1e-4)


def test_corners_respect_the_border() -> None:
    image = np.random.default_rng(4).integers(0, 255, (90, 120)).astype(np.uint8)
    uv, _ = detect_corners(corner_strength(image), KitFeatureConfig(border=20))
    assert len(uv) > 5
    assert uv.min() >= 20
    assert (uv <= np.array([120, 90]) - 1 - 20).all()
    assert len(detect_corners(corner_strength(np.full_like(image, 128)), KitFeatureConfig())[0]) == 0


def cells_of(uv: Array) -> set[tuple[int, ...]]:
    """The cells, 18 px wide, that contain the pixels (N, 2)."""
    return {tuple(cell) for cell in (uv // 18).astype(int).tolist()}


def test_cells_have_one_corner_each() -> None:
    image = np.random.default_rng(0).integers(0, 255, (108, 180)).astype(np.uint8)
    uv, _ = detect_corners(corner_strength(image), KitFeatureConfig(cell=18))
    assert len(cells_of(uv)) == len(uv) > 30
    again = uv[in_empty_cells(uv, uv[:10] + 0.3, 18)]
    assert cells_of(again) == cells_of(uv) - cells_of(uv[:10])
