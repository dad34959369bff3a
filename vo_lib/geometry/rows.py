"""Data that passes between rooms: arrays whose rows belong together."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from .types import BoolArray, Index

AnyRows = TypeVar("AnyRows", bound="Rows")


@dataclass(frozen=True, eq=False)
class Rows:
    """Base of frozen dataclasses whose fields are arrays of N rows each: row i of all is one thing.

    They compare and hash by identity, so subclasses are declared with `eq=False` too.
    """

    def __len__(self) -> int:
        first: Any = next(iter(vars(self).values()))
        return len(first)

    def __getitem__(self: AnyRows, index: BoolArray | Index) -> AnyRows:
        """The rows that a boolean mask or an index array chooses."""
        return type(self)(*(array[index] for array in vars(self).values()))


def joined(parts: Iterable[AnyRows]) -> AnyRows:
    """The rows of several, one behind the other; at least one is needed."""
    parts = list(parts)
    columns = zip(*(vars(part).values() for part in parts), strict=True)
    return type(parts[0])(*map(np.concatenate, columns))
