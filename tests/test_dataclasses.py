"""Data classes with arrays equal only themselves: arrays have no hash, and `==` gives no truth value."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import pkgutil
import typing
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from vo_lib.geometry.result import FrameResult

ROOT = Path(__file__).resolve().parents[1]
PLACES = (ROOT / "vo_lib", ROOT / "data_scripts", ROOT / "notebooks" / "course")


def types_in(hint: Any) -> Iterator[Any]:
    """A type, and the types in its brackets, such as the types of a tuple's items."""
    origin = typing.get_origin(hint) or hint
    yield origin
    if origin is Callable:
        return  # functions are compared without a look at what they take and return
    for part in typing.get_args(hint):
        yield from types_in(part)


def has_arrays(kind: type) -> bool:
    # drive.py imports Calibration only for type checks.
    hints = typing.get_type_hints(kind, localns={"Calibration": object})
    types = [each for field in dataclasses.fields(kind) for each in types_in(hints[field.name])]
    return any(isinstance(each, type) and issubclass(each, np.ndarray) for each in types)


def modules() -> Iterator[ModuleType]:
    """All modules of the library, of the data scripts and of the course."""
    for place in PLACES:
        package = "" if place.name == "data_scripts" else f"{place.name}."
        for module in pkgutil.walk_packages([str(place)], package):
            if module.name != "vo_lib.__main__":
                yield importlib.import_module(module.name)


def classes_with_arrays() -> dict[str, type]:
    """The data classes with an array among their fields, by their full names."""
    found = {}
    for module in modules():
        for item in vars(module).values():
            if inspect.isclass(item) and dataclasses.is_dataclass(item) and has_arrays(item):
                found[f"{item.__module__}.{item.__qualname__}"] = item
    return found


CLASSES = classes_with_arrays()


def test_classes_with_arrays_are_found() -> None:
    expected = {"vo_lib.geometry.result.FrameResult", "vo_lib.runs.drive.Run", "course.frames.Points"}
    assert expected | {"vo_street.route.Route", "fetch.stereo_calibration.RectifiedRig"} < set(CLASSES)


@pytest.mark.parametrize("name", CLASSES)
def test_only_the_same_object_is_equal(name: str) -> None:
    for method in ("__eq__", "__hash__"):
        assert getattr(CLASSES[name], method) is getattr(object, method)


def test_results_are_compared_and_collected_without_an_error() -> None:
    one = FrameResult(np.eye(4))
    other = FrameResult(np.eye(4))
    assert one == one
    assert one != other
    assert len({one, other}) == 2
