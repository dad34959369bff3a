"""The whole method on drawn streets of full size: accuracy against exact truth, and what boxes do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from vo_lib import Sequence, open_sequence, preset
from vo_lib.evaluation.kitti import kitti_errors
from vo_lib.runs.runner import run_methods
from vo_lib.synthetic import ensure_scene, scene_config


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("scenes")


def scene(name: str, length: float, cache: Path) -> Sequence:
    return open_sequence(ensure_scene(scene_config(name, length=length), cache, jobs=1))


@pytest.mark.parametrize("name", ["empty", "parked"])
def test_where_nothing_moves_the_path_is_right(name: str, cache: Path) -> None:
    sequence = scene(name, 60.0, cache)
    runs = run_methods(sequence, {str(seed): preset("solution_selection", seed=seed) for seed in range(5)})
    assert sequence.truth is not None
    for result in runs.values():
        errors = kitti_errors(sequence.truth, result.poses, [50.0], 1)
        assert errors.te is not None
        assert errors.re is not None
        assert errors.te <= 0.5
        assert errors.re <= 0.25


def test_where_vehicles_fill_the_view_removing_them_helps(cache: Path) -> None:
    sequence = scene("jam", 40.0, cache)
    runs = run_methods(sequence, {name: preset(name) for name in ("solution_selection", "feature_selection")})
    assert sequence.truth is not None
    kept, removed = (kitti_errors(sequence.truth, r.poses, [20.0], 1) for r in runs.values())
    assert kept.te is not None
    assert removed.te is not None
    assert removed.te < 0.7 * kept.te
    assert np.mean([len(sequence.boxes(i)) for i in range(len(sequence))]) > 3
