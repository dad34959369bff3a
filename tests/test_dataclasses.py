"""Data classes with arrays equal only themselves: arrays have no hash, and `==` gives no truth value."""

from __future__ import annotations

import dataclasses
import importlib
import pkgutil
import typing
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import vo_lib
from vo_lib.geometry.result import FrameResult


def types_in(hint: Any) -> Iterator[Any]:
    """A type, and the types in its brackets, such as the types of a tuple's items."""
    yield typing.get_origin(hint) or hint
    for part in typing.get_args(hint):
        yield from types_in(part)


def has_arrays(kind: type) -> bool:
    # drive.py imports Calibration only for type checks.
    hints = typing.get_type_hints(kind, localns={"Calibration": object})
    types = [each for field in dataclasses.fields(kind) for each in types_in(hints[field.name])]
    return any(isinstance(each, type) and issubclass(each, np.ndarray) for each in types)


def classes_with_arrays() -> dict[str, type]:
    """The library's data classes with an array among their fields, by their full names."""
    found = {}
    for module in pkgutil.walk_packages(vo_lib.__path__, "vo_lib."):
        if module.name == "vo_lib.__main__":
            continue
        for item in vars(importlib.import_module(module.name)).values():
            if isinstance(item, type) and dataclasses.is_dataclass(item) and has_arrays(item):
                found[f"{item.__module__}.{item.__name__}"] = item
    return found


CLASSES = classes_with_arrays()


def test_classes_with_arrays_are_found() -> None:
    assert {"vo_lib.geometry.result.FrameResult", "vo_lib.runs.drive.Run"} < set(CLASSES)


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
