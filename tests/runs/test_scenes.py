"""The whole method on drawn streets of full size: errors against exact truth, and the effect of boxes.

The scenes are drawn once into the user's cache folder; `parked` and `jam` are also used in chapter 5.
"""

from __future__ import annotations

import numpy as np
import pytest

from course.frames import load_part
from vo_lib import preset
from vo_lib.evaluation.kitti_errors import kitti_errors
from vo_lib.runs.drive import run_methods


@pytest.fixture(autouse=True)
def _one_process_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    """For a few frames, a second process would build the whole street once more."""
    monkeypatch.setattr("course.frames.DRAWING_PROCESSES", 1)


@pytest.mark.parametrize(("name", "first"), [("empty", 0), ("parked", 90)])
def test_errors_without_traffic_are_small(name: str, first: int) -> None:
    sequence = load_part(f"synthetic/{name}", first, first + 29)
    runs = run_methods(
        sequence, {str(seed): preset("solution_selection", seed=seed, variant="kit") for seed in range(5)}
    )
    assert sequence.truth is not None
    for result in runs.values():
        errors = kitti_errors(sequence.truth, result.poses, [20.0], 1)
        assert (np.array([errors.te, errors.re], float) <= (0.1, 0.25)).all()


def test_box_removal_lowers_the_error_in_a_jam() -> None:
    sequence = load_part("synthetic/jam", 60, 89)
    runs = run_methods(
        sequence, {name: preset(name, variant="kit") for name in ("solution_selection", "feature_selection")}
    )
    assert sequence.truth is not None
    kept, removed = (kitti_errors(sequence.truth, r.poses, [5.0], 1) for r in runs.values())
    assert kept.te is not None
    assert removed.te is not None
    assert removed.te < 0.1 * kept.te
    assert np.mean([len(sequence.boxes(i)) for i in range(len(sequence))]) > 3
