"""The Sampson distance, computed with matrix products."""

from __future__ import annotations

import numpy as np
import pytest

from course.simulation.problems import MOTIONS, Motion, random_problems
from vo_lib.geometry.types import Array
from vo_lib.paper.sampson import candidate_terms, match_terms, sampson_distance, squared_distances

FOCAL = 718.856


def by_definition(E: Array, x_p: Array, x_c: Array) -> Array:
    """Squared distances (M, N) to E (M, 3, 3): (cᵀ E p)² / (|(E p)₁,₂|² + |(Eᵀ c)₁,₂|²)."""
    p, c = (np.concatenate([x, np.ones((len(x), 1))], axis=1) for x in (x_p, x_c))
    line_c, line_p = p @ E.swapaxes(1, 2), c @ E
    length2 = np.sum(line_c[..., :2] ** 2, axis=-1) + np.sum(line_p[..., :2] ** 2, axis=-1)
    return np.asarray(np.sum(c * line_c, axis=-1) ** 2 / length2)


@pytest.mark.parametrize("motion", [m for m in MOTIONS if m != "pure_rotation"])
def test_sampson_products_equal_the_definition(motion: Motion) -> None:
    simulated = random_problems(np.random.default_rng(1), 6, 50, motion, noise_px=1.0)
    for x_p, x_c in zip(simulated.x_p, simulated.x_c, strict=True):
        expected = by_definition(simulated.E, x_p, x_c)
        result = squared_distances(candidate_terms(simulated.E), match_terms(x_p, x_c))
        np.testing.assert_allclose(result, expected, rtol=1e-6, atol=1e-12)
        np.testing.assert_allclose(
            sampson_distance(simulated.E, x_p, x_c) ** 2, expected, rtol=1e-6, atol=1e-12
        )
        single = squared_distances(
            candidate_terms(simulated.E, np.float32), match_terms(x_p, x_c, np.float32)
        )
        assert single.dtype == np.float32
        # For a ranking of candidates, an accuracy of a hundredth of a pixel is sufficient.
        np.testing.assert_allclose(np.sqrt(single), np.sqrt(expected), atol=0.01 / FOCAL, rtol=1e-3)
