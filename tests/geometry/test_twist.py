"""Comparison of twists with their definition."""

from __future__ import annotations

import numpy as np
import pytest

from vo_lib.geometry.motion import inverse
from vo_lib.geometry.twist import adjoint, motion_from_twist, twist_from_motion


def test_twists_and_motions_are_each_others_inverse() -> None:
    size = np.repeat([1e-7, 1e-3, 0.3, 1.0], 50)[:, None]
    xi = size * np.random.default_rng(0).normal(0, 1.0, (200, 6))
    assert twist_from_motion(motion_from_twist(xi)) == pytest.approx(xi, abs=1e-12)
    T, near = motion_from_twist(xi[100:]), motion_from_twist(xi[:100])
    moved = motion_from_twist((adjoint(T) @ xi[:100, :, None])[..., 0])
    assert T @ near @ inverse(T) == pytest.approx(moved, abs=1e-12)
