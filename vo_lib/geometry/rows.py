"""Data that passes between packages: arrays with corresponding rows."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from .types import BoolArray, Index

AnyRows = TypeVar("AnyRows", bound="Rows")


@dataclass(frozen=True, eq=False)
class Rows:
    """Base of frozen dataclasses with arrays of N rows: row i of every array describes item i.

    Comparison and hash are by identity; subclasses need `eq=False` too.
    """

    def __len__(self) -> int:
        first: Any = next(iter(vars(self).values()))
        return len(first)

    def __getitem__(self: AnyRows, index: BoolArray | Index) -> AnyRows:
        """The rows selected by a boolean mask or an index array."""
        return type(self)(*(array[index] for array in vars(self).values()))


def joined(parts: Iterable[AnyRows]) -> AnyRows:
    """The concatenated rows of one or more objects."""
    parts = list(parts)
    columns = zip(*(vars(part).values() for part in parts), strict=True)
    return type(parts[0])(*map(np.concatenate, columns))
