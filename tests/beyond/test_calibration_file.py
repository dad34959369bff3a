"""What was learnt of a rig is kept to the last bit, said in words, and refused where it is damaged."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from faulty_camera import CAMERA

from vo_lib.beyond.calibration import Calibration, in_words, read_calibration
from vo_lib.beyond.stereo_field import COLUMNS, ROWS, prior_covariance
from vo_lib.config import CalibrationConfig
from vo_lib.core.errors import DataError
from vo_lib.core.types import Array

LENS = np.zeros(2)


@pytest.fixture
def learnt() -> Calibration:
    """Numbers that no short decimal fraction is."""
    rng = np.random.default_rng(4)
    root = rng.normal(size=(15, 15))
    lens = rng.normal(size=(3, 3))
    return Calibration(
        CAMERA, rng.normal(size=15), root @ root.T, 1e5 * lens @ lens.T, rng.normal(size=3) * 1e-7
    )


def field(**terms: float) -> Array:
    """Coefficients by name: d_ for disparities, r_ for rows."""
    columns = [terms.get(f"d_{term}", 0.0) for term in COLUMNS]
    return np.array(columns + [terms.get(f"r_{term}", 0.0) for term in ROWS])


def test_a_file_gives_back_every_bit(learnt: Calibration, tmp_path: Path) -> None:
    path = tmp_path / "calibration.json"
    path.write_text(learnt.to_json(), encoding="utf-8")
    again = read_calibration(path)
    for name in ("estimate", "covariance", "lens_information", "lens_vector"):
        np.testing.assert_array_equal(getattr(again, name), getattr(learnt, name))
    assert again.camera == learnt.camera
    assert again.to_json() == learnt.to_json()


DAMAGES: dict[str, Callable[[dict[str, Any]], object]] = {
    "a camera without focal length": lambda d: d["camera"].pop("f"),
    "a word for a number": lambda d: d["camera"].update(f="wide"),
    "yes for a number": lambda d: d["camera"].update(f=True),
    "a coefficient too few": lambda d: d["field"].popitem(),
    "a covariance too small": lambda d: d["field_covariance"].pop(),
    "one that is not symmetric": lambda d: d["field_covariance"][0].__setitem__(1, 7.0),
    "one that is not positive": lambda d: d["lens_information"].__setitem__(slice(None), [[0.0] * 3] * 3),
    "a number that is none": lambda d: d["lens_vector"].__setitem__(0, float("nan")),
    "an infinite one": lambda d: d["field"].update({"row 1": float("inf")}),
    "a list for a table": lambda d: d.update(field=[1.0] * 15),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_file_is_refused_by_name(learnt: Calibration, tmp_path: Path, damage: str) -> None:
    data = json.loads(learnt.to_json())
    DAMAGES[damage](data)
    path = tmp_path / "mine.json"
    path.write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(DataError, match=r"mine\.json.*expected a calibration\.json"):
        read_calibration(path)


@pytest.mark.parametrize("text", ["", "[]", "7", "{", "null", "[" * 100_000])
def test_other_files_are_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "mine.json").write_text(text, encoding="utf-8")
    with pytest.raises(DataError, match=r"expected a calibration\.json"):
        read_calibration(tmp_path / "mine.json")


def test_it_belongs_to_one_camera(learnt: Calibration) -> None:
    learnt.check(dataclasses.replace(CAMERA, f=1.005 * CAMERA.f, cx=CAMERA.cx + 5.0))
    for name in ("f", "baseline"):
        other = dataclasses.replace(CAMERA, **{name: 1.02 * getattr(CAMERA, name)})
        with pytest.raises(DataError, match=f"another camera: {name} is"):
            learnt.check(other)
    others = {"image": {"width": 2 * CAMERA.size[0]}, "principal point": {"cy": 0.4 * CAMERA.cy}}
    for name, change in others.items():
        with pytest.raises(DataError, match=f"another camera: {name} is"):
            learnt.check(dataclasses.replace(CAMERA, **change))  # type: ignore[arg-type]


@pytest.mark.parametrize("size", [1e2, 1e6, 1e300])
def test_an_error_that_no_rig_has_is_refused(learnt: Calibration, tmp_path: Path, size: float) -> None:
    path = tmp_path / "mine.json"
    far = dataclasses.replace(learnt, estimate=field(d_1=size))
    bent = dataclasses.replace(learnt, lens_vector=learnt.lens_information @ np.full(3, size / CAMERA.f))
    for wrong in (far, bent):
        path.write_text(wrong.to_json(), encoding="utf-8")
        with pytest.raises(DataError, match=r"mine\.json: an error of .* px: expected 30 px at most"):
            read_calibration(path)


def test_on_another_drive_the_shift_alone_is_less_certain(learnt: Calibration) -> None:
    more = learnt.covariance_on_another_drive() - learnt.covariance
    assert more[0, 0] > 1.0
    more[0, 0] = 0.0
    np.testing.assert_array_equal(more, np.zeros((15, 15)))


@pytest.mark.parametrize(
    ("coefficients", "lens", "words"),
    [
        (field(), LENS, "nothing that needs correction"),
        (field(d_1=0.04, r_1=-0.04), LENS, "nothing that needs correction"),
        (field(**{"d_x²": -1.0, "d_y²": 1.0}), LENS, "disparities are up to 0.5 px too small at the sides"),
        (field(**{"d_y²": 6.0, "d_x²": -0.1}), LENS, "disparities are up to 0.3 px too large at the top"),
        (field(**{"r_xy": -5.0}), LENS, "rows differ by up to 0.8 px in the corners"),
        # Learnt is what corrects: a lens's own decentering is the opposite.
        (field(), np.array([-1.2, 1.4]), "the lens is decentered, p1 +1.2 px and p2 -1.4 px"),
    ],
)
def test_errors_in_words(coefficients: Array, lens: Array, words: str) -> None:
    assert in_words(coefficients, lens, CAMERA) == words


def test_several_errors_are_said_one_after_the_other() -> None:
    said = in_words(field(d_1=-0.6, **{"r_xy": -5.0}), np.array([-1.0, 0.0]), CAMERA)
    assert [part.split()[0] for part in said.split("; ")] == ["disparities", "rows", "the"]


def test_what_is_too_uncertain_is_neither_said_nor_used(learnt: Calibration) -> None:
    vague = dataclasses.replace(
        learnt,
        estimate=field(d_1=0.5),
        covariance=prior_covariance(),
        lens_information=1e-6 * np.eye(3),
        lens_vector=np.zeros(3),
    )
    coefficients, lens = vague.in_use(CalibrationConfig())
    assert not coefficients.any()
    assert not lens.any()
    assert vague.in_words(CalibrationConfig()) == "nothing that needs correction"
