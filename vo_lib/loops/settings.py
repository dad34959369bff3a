"""Thresholds of loops and of the pose graph, each declared once."""

from __future__ import annotations

from dataclasses import dataclass

from ..settings import Checked, setting


@dataclass(frozen=True)
class LoopConfig(Checked):
    """Everything that decides the loops of a sequence, with its images, and how they close a path."""

    every: int = setting(5, "each n-th frame is a place", low=1, high=1000)
    places: int = setting(500, "places at most; a longer sequence has them farther apart", low=10, high=2000)
    gap: int = setting(100, "frames between two visits of a place", low=1, high=100_000)
    words: int = setting(64, "visual words of each of the four kinds of features", low=4, high=1000)
    columns: int = setting(3, "parts of the image whose words are counted apart", low=1, high=20)
    similarity: float = setting(0.25, "smallest similarity of two places to compare", low=-1, high=1)
    candidates: int = setting(2, "most similar earlier places, compared with a place", low=1, high=50)
    radius: int = setting(400, "how far a feature is looked for", unit="px", low=5, high=5000)
    inliers: int = setting(60, "fewest inliers of a loop's motion", low=6, high=10_000)
    share: float = setting(0.65, "smallest share of inliers among the matches of a loop", low=0, high=1)
    frame_turn: float = setting(
        0.02, "standard deviation of a frame's rotation", unit="deg", low=1e-4, high=9
    )
    frame_step: float = setting(
        0.01, "standard deviation of a frame's translation", unit="m", low=1e-4, high=9
    )
    loop_turn: float = setting(0.05, "standard deviation of a loop's rotation", unit="deg", low=1e-4, high=9)
    loop_step: float = setting(0.05, "standard deviation of a loop's translation", unit="m", low=1e-4, high=9)
    scale: float = setting(
        3.0, "residual in standard deviations that halves the weight of a loop", low=0.01, high=1e6
    )
