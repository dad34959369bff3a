"""The unit of the RE in the paper's own columns of Table 1, and the way back to deg/100 m.

KITTI's devkit writes RE in rad/m with six decimals. In the columns that the paper computed itself, the RE
of every sequence is a whole multiple of 1/180, as if such a number had been multiplied by 10⁶ / 180 in place
of 100 · 180/π (chapter 6). So it is 3 % smaller than it should be. The column VISO2 has other numbers,
which need no conversion.
"""

from __future__ import annotations

import math

RE_KIND = "re_deg_per_100m"  # the name of RE in records, one of `table1.ERROR_KINDS`
PAPERS_OWN = ("mesvo_f", "solution_selection", "feature_selection")  # columns that the paper computed itself
PAPERS_FACTOR = 1e6 / 180.0  # 5555.6, by which the paper multiplied rad/m
RIGHT_FACTOR = 100.0 * 180.0 / math.pi  # 5729.6, from rad/m to deg/100 m
DEVKIT_STEP = 1e-6  # rad/m: the devkit writes six decimals


def in_paper_unit(method: str, kind: str) -> bool:
    """Whether the printed errors of this kind, of `table1.ERROR_KINDS`, are in the paper's own unit."""
    return kind == RE_KIND and method in PAPERS_OWN


def converted(printed: float, method: str, kind: str) -> float:
    """A printed number in the right unit: RE of the paper's own columns is 3 % larger than it reads."""
    if in_paper_unit(method, kind):
        return printed * RIGHT_FACTOR / PAPERS_FACTOR
    return printed
