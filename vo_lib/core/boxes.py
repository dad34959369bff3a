"""Vehicle boxes of one image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .types import Array


@dataclass(frozen=True)
class Boxes:
    """K boxes in one image.

    Attributes
    ----------
    xyxy : (K, 4) left, top, right, bottom, pixels (pixel centres at integers).
    class_id : (K,) int; COCO numbers unless the labels say otherwise.
    score : (K,) in [0, 1]; 1 for labels without a score.
    """

    xyxy: Array
    class_id: NDArray[np.int64]
    score: Array

    def __len__(self) -> int:
        return len(self.class_id)


def no_boxes() -> Boxes:
    """The boxes of an image without any."""
    return Boxes(np.zeros((0, 4)), np.zeros(0, np.int64), np.zeros(0))
