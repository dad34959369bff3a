"""Estimated calibrations: round trip of the file, description in words, and errors for damaged files."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import write_bands
from faulty_camera import CAMERA

from vo_lib import open_sequence, preset, run
from vo_lib.errors import DataError
from vo_lib.geometry.types import Array
from vo_lib.kit.calibration import Calibration, describe_errors, read_learnt_calibration
from vo_lib.kit.rig import ERROR_COUNT, ERROR_NAMES, prior_covariance
from vo_lib.kit.settings import CalibrationConfig
from vo_lib.runs.folder import read_run, write_run
from vo_lib.runs.identity import run_identity


@pytest.fixture
def learnt() -> Calibration:
    """A calibration of random numbers, which have no short decimal form."""
    rng = np.random.default_rng(4)
    root = rng.normal(size=(ERROR_COUNT, ERROR_COUNT))
    return Calibration(CAMERA, rng.normal(size=ERROR_COUNT), root @ root.T)


def errors(**terms: float) -> Array:
    """The errors (19,) with the given terms; a name has the prefix d_ (disparities) or r_ (rows)."""
    short = {"d": "disparity", "r": "row"}
    named = {" ".join(short.get(part, part) for part in key.split("_")): v for key, v in terms.items()}
    return np.array([named.get(name, 0.0) for name in ERROR_NAMES])


def test_calibration_survives_a_round_trip_through_its_file(learnt: Calibration, tmp_path: Path) -> None:
    path = tmp_path / "calibration.json"
    path.write_text(learnt.to_json(), encoding="utf-8")
    again = read_learnt_calibration(path)
    for name in ("estimate", "covariance"):
        np.testing.assert_array_equal(getattr(again, name), getattr(learnt, name))
    assert again.camera == learnt.camera
    assert again.to_json() == learnt.to_json()


def test_rounded_covariance_is_symmetric(learnt: Calibration, tmp_path: Path) -> None:
    """After a long drive, small entries of the covariance are symmetric only up to rounding."""
    learnt.covariance[0, 1], learnt.covariance[1, 0] = 1e-15, -1e-15
    path = tmp_path / "calibration.json"
    path.write_text(learnt.to_json(), encoding="utf-8")
    assert read_learnt_calibration(path).to_json() == learnt.to_json()


def test_a_run_with_a_large_estimate_is_read_again(learnt: Calibration, tmp_path: Path) -> None:
    """A run may estimate what no real rig has; its folder is a finished run all the same."""
    large = dataclasses.replace(learnt, estimate=errors(d_1=31.0))
    sequence = open_sequence(write_bands(tmp_path / "bands", 2))
    config = preset("solution_selection", variant="kit")
    still = dataclasses.replace(run(sequence, config), calibration=large)
    folder = tmp_path / "run"
    folder.mkdir()
    write_run(folder, still, run_identity(sequence, config, "solution_selection"))
    again = read_run(folder, sequence).calibration
    assert again is not None
    np.testing.assert_array_equal(again.estimate, large.estimate)
    # As the start of another run, it is refused.
    with pytest.raises(DataError, match="an error of 31 px: expected at most 30 px"):
        read_learnt_calibration(folder / "calibration.json")


DAMAGES: dict[str, Callable[[dict[str, Any]], object]] = {
    "a coefficient too few": lambda d: d["errors"].popitem(),
    "one that is not symmetric": lambda d: d["covariance"][0].__setitem__(1, 7.0),
    "one that is infinite": lambda d: d["covariance"][0].__setitem__(0, float("inf")),
    "one that is not positive": lambda d: d["covariance"].__setitem__(
        slice(None), [[0.0] * ERROR_COUNT] * ERROR_COUNT
    ),
    "a number that is none": lambda d: d["errors"].update({"row 1": float("nan")}),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_damaged_calibration_files_are_refused(learnt: Calibration, tmp_path: Path, damage: str) -> None:
    data = json.loads(learnt.to_json())
    DAMAGES[damage](data)
    path = tmp_path / "mine.json"
    path.write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(DataError, match=r"mine\.json.*expected a calibration\.json"):
        read_learnt_calibration(path)


def test_calibration_belongs_to_one_camera(learnt: Calibration) -> None:
    learnt.check(dataclasses.replace(CAMERA, f=1.005 * CAMERA.f, cx=CAMERA.cx + 5.0))
    for name, words in (("f", "focal length"), ("baseline", "baseline")):
        other = dataclasses.replace(CAMERA, **{name: 1.02 * getattr(CAMERA, name)})
        with pytest.raises(DataError, match=f"another camera: {words} "):
            learnt.check(other)
    others = {"image size": {"width": 2 * CAMERA.size[0]}, "principal point": {"cy": 0.4 * CAMERA.cy}}
    for name, change in others.items():
        with pytest.raises(DataError, match=f"another camera: {name} "):
            learnt.check(dataclasses.replace(CAMERA, **change))  # type: ignore[arg-type]


def test_other_drives_have_a_less_certain_shift(learnt: Calibration) -> None:
    more = learnt.covariance_on_another_drive() - learnt.covariance
    assert more[0, 0] > 1.0
    more[0, 0] = 0.0
    np.testing.assert_array_equal(more, np.zeros((ERROR_COUNT, ERROR_COUNT)))


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (errors(d_1=0.04, r_1=-0.04), "none beyond two standard deviations"),
        (errors(**{"d_x²": -1.0, "d_y²": 1.0}), "disparities are off by -0.5 to +0.0 ±0.03 px"),
        (errors(r_xy=-5.0), "rows are off by -0.8 to +0.8 ±0.03 px"),
        (errors(p1=1.2, k1=-12.0), "lens: p1 +1.2 ±0.0 px; lens: k1 -12.0 ±0.0 px"),
    ],
)
def test_errors_are_described_in_words(wrong: Array, words: str) -> None:
    assert describe_errors(wrong, 1e-4 * np.eye(ERROR_COUNT), CAMERA) == words


def test_small_errors_are_not_described() -> None:
    assert "p1" in describe_errors(errors(p1=2.4), 0.3 * np.eye(ERROR_COUNT), CAMERA)
    assert "p1" not in describe_errors(errors(p1=2.0), 0.3 * np.eye(ERROR_COUNT), CAMERA)


def test_uncertain_errors_are_neither_described_nor_used(learnt: Calibration) -> None:
    vague = dataclasses.replace(learnt, estimate=errors(d_1=0.5, k1=5.0), covariance=prior_covariance())
    assert not vague.in_use(CalibrationConfig()).any()
    assert vague.describe(CalibrationConfig()) == "none beyond two standard deviations"
