"""Types of arrays and of progress functions."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Index = NDArray[np.intp]
IntArray = NDArray[np.int64]
Image = NDArray[np.uint8]  # (H, W) grey, or (H, W, 3) BGR

# Called with (steps done, total steps).
Progress = Callable[[int, int], None]
