"""Thresholds of the kit's own front end, beside those of the paper's."""

from __future__ import annotations

from dataclasses import dataclass

from ..core.settings import setting
from ..method import config as method


@dataclass(frozen=True)
class FeatureConfig(method.FeatureConfig):
    """Corners for Lucas-Kanade, beside the paper's blobs and corners (chapter 1)."""

    cell: int = setting(18, "at most one corner in each square of this size", unit="px", low=10, high=100)
    quality: float = setting(
        3.0, "weakest contrast of a corner; higher: fewer, safer corners", unit="grey levels", low=0, high=50
    )


@dataclass(frozen=True)
class MatchingConfig(method.MatchingConfig):
    """Matching by Lucas-Kanade with bent windows (chapter 1)."""

    window: int = setting(9, "side of the Lucas-Kanade window", unit="px", low=5, high=41)
    levels: int = setting(1, "pyramid levels above the image where a prediction exists", low=0, high=5)
    search_levels: int = setting(4, "pyramid levels where there is no prediction", low=0, high=6)
    surface_share: float = setting(
        0.6, "share of a feature's surroundings that must lie on its surface", low=0, high=1
    )
    surface_tolerance: float = setting(
        0.7, "largest distance of a feature's disparity from its surface", unit="px", low=0.05, high=10
    )
    max_difference: float = setting(
        20.0, "largest mean difference of matched windows", unit="grey levels", low=1, high=255
    )
