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
from vo_lib.beyond.rig import NAMES, SIZE, prior_covariance
from vo_lib.config import CalibrationConfig
from vo_lib.core.errors import DataError
from vo_lib.core.types import Array


@pytest.fixture
def learnt() -> Calibration:
    """Numbers that no short decimal fraction is."""
    rng = np.random.default_rng(4)
    root = rng.normal(size=(SIZE, SIZE))
    return Calibration(CAMERA, rng.normal(size=SIZE), root @ root.T)


def errors(**terms: float) -> Array:
    """Coefficients by name: d_ for disparities, r_ for rows."""
    short = {"d": "disparity", "r": "row"}
    named = {" ".join(short.get(part, part) for part in key.split("_")): v for key, v in terms.items()}
    return np.array([named.get(name, 0.0) for name in NAMES])


def test_a_file_gives_back_every_bit(learnt: Calibration, tmp_path: Path) -> None:
    path = tmp_path / "calibration.json"
    path.write_text(learnt.to_json(), encoding="utf-8")
    again = read_calibration(path)
    for name in ("estimate", "covariance"):
        np.testing.assert_array_equal(getattr(again, name), getattr(learnt, name))
    assert again.camera == learnt.camera
    assert again.to_json() == learnt.to_json()


DAMAGES: dict[str, Callable[[dict[str, Any]], object]] = {
    "a camera without focal length": lambda d: d["camera"].pop("f"),
    "a word for a number": lambda d: d["camera"].update(f="wide"),
    "yes for a number": lambda d: d["camera"].update(f=True),
    "a coefficient too few": lambda d: d["errors"].popitem(),
    "a covariance too small": lambda d: d["covariance"].pop(),
    "one that is not symmetric": lambda d: d["covariance"][0].__setitem__(1, 7.0),
    "one that is not positive": lambda d: d["covariance"].__setitem__(slice(None), [[0.0] * SIZE] * SIZE),
    "a number that is none": lambda d: d["errors"].update({"row 1": float("nan")}),
    "an infinite one": lambda d: d["errors"].update({"row 1": float("inf")}),
    "a list for a table": lambda d: d.update(errors=[1.0] * SIZE),
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
    far = dataclasses.replace(learnt, estimate=errors(d_1=size))
    bent = dataclasses.replace(learnt, estimate=errors(p2=-size))
    for wrong in (far, bent):
        path.write_text(wrong.to_json(), encoding="utf-8")
        with pytest.raises(DataError, match=r"mine\.json: an error of .* px: expected 30 px at most"):
            read_calibration(path)


def test_on_another_drive_the_shift_alone_is_less_certain(learnt: Calibration) -> None:
    more = learnt.covariance_on_another_drive() - learnt.covariance
    assert more[0, 0] > 1.0
    more[0, 0] = 0.0
    np.testing.assert_array_equal(more, np.zeros((SIZE, SIZE)))


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (errors(), "nothing that needs correction"),
        (errors(d_1=0.04, r_1=-0.04), "nothing that needs correction"),
        (errors(**{"d_x²": -1.0, "d_y²": 1.0}), "disparities are up to 0.5 px too small at the sides"),
        (errors(**{"d_y²": 6.0, "d_x²": -0.1}), "disparities are up to 0.3 px too large at the top"),
        (errors(r_xy=-5.0), "rows differ by up to 0.8 px in the corners"),
        (errors(p1=1.2, p2=-1.4), "the lens is decentered, p1 +1.2 px and p2 -1.4 px"),
        (errors(k1=10.0), "the lens has a pincushion, k1 +10.0 px"),
        (errors(k1=-12.0, k2=2.0), "the lens has a barrel, k1 -12.0 px and k2 +2.0 px"),
        (errors(**{"right camera down": 0.4}), "the right camera stands 0.4 % of the baseline lower"),
        (errors(**{"right camera back": -1.5}), "the right camera stands 1.5 % of the baseline ahead"),
    ],
)
def test_errors_in_words(wrong: Array, words: str) -> None:
    assert in_words(wrong, CAMERA) == words


def test_several_errors_are_said_one_after_the_other() -> None:
    said = in_words(errors(d_1=-0.6, r_xy=-5.0, p1=1.0, k1=1.0), CAMERA)
    assert [part.split()[:3][-1] for part in said.split("; ")] == ["up", "by", "is", "has"]


def test_what_is_too_uncertain_is_neither_said_nor_used(learnt: Calibration) -> None:
    vague = dataclasses.replace(learnt, estimate=errors(d_1=0.5, k1=5.0), covariance=prior_covariance())
    assert not vague.in_use(CalibrationConfig()).any()
    assert vague.in_words(CalibrationConfig()) == "nothing that needs correction"
