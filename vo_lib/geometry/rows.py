"""Data that passes between packages: arrays with corresponding rows."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Self, TypeVar

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

    def __getitem__(self, index: BoolArray | Index) -> Self:
        """The rows selected by a boolean mask or an index array, of every array."""
        selected = {name: array[index] for name, array in vars(self).items()}
        return type(self)(**selected)


def joined(parts: Iterable[AnyRows]) -> AnyRows:
    """The concatenated rows of one or more objects of one class."""
    parts = list(parts)
    names = vars(parts[0])
    arrays = {name: np.concatenate([vars(part)[name] for part in parts]) for name in names}
    return type(parts[0])(**arrays)
