"""Data that passes between rooms: arrays whose rows belong together."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from .types import Index, Mask

AnyRows = TypeVar("AnyRows", bound="Rows")


@dataclass(frozen=True)
class Rows:
    """Base of frozen dataclasses whose fields are arrays of N rows each: row i of all is one thing."""

    def __len__(self) -> int:
        first: Any = next(iter(vars(self).values()))
        return len(first)

    def __getitem__(self: AnyRows, index: Mask | Index) -> AnyRows:
        """The rows that a boolean mask or an index array chooses."""
        return type(self)(*(array[index] for array in vars(self).values()))


def joined(parts: Iterable[AnyRows]) -> AnyRows:
    """The rows of several, one behind the other; at least one is needed."""
    parts = list(parts)
    columns = zip(*(vars(part).values() for part in parts), strict=True)
    return type(parts[0])(*map(np.concatenate, columns))
