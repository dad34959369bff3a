"""Wrong positions of matches, for the panels that disturb the matches of a frame."""

from __future__ import annotations

import numpy as np

from vo_lib.geometry.types import Array


def shifts(rng: np.random.Generator, count: int) -> Array:
    """Shifts (count, 2) of mismatches, 4 to 40 px in any direction."""
    angle = rng.uniform(0, 2 * np.pi, count)
    length = rng.uniform(4.0, 40.0, count)
    return np.asarray(length[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1))
