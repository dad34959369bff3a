"""Thresholds of loops and of the pose graph, each declared once."""

from __future__ import annotations

from dataclasses import dataclass

from ..settings import Checked, setting


@dataclass(frozen=True)
class LoopConfig(Checked):
    """Places, accepted loops, and the weights of edges in the pose graph."""

    every: int = setting(5, "number of frames from one place to the next", low=1, high=1000)
    # The pose graph solves a dense system with six unknowns per place, 100 MB for 600 places.
    places: int = setting(500, "largest number of places in a sequence", low=10, high=600)
    gap: int = setting(100, "smallest number of frames between two visits of a place", low=1, high=100_000)
    words: int = setting(64, "visual words for each of the four kinds of features", low=4, high=1000)
    columns: int = setting(3, "image columns, each with its own histogram of visual words", low=1, high=20)
    similarity: float = setting(0.25, "smallest similarity of two places for a comparison", low=-1, high=1)
    candidates: int = setting(2, "number of similar earlier places compared with a place", low=1, high=50)
    radius: int = setting(400, "radius of the search for a feature's match", unit="px", low=5, high=5000)
    inliers: int = setting(60, "smallest number of inliers of a loop", low=6, high=10_000)
    share: float = setting(0.65, "smallest share of inliers among the matches of a loop", low=0, high=1)
    frame_turn: float = setting(0.02, "standard error of a frame's rotation", unit="deg", low=1e-4, high=9)
    frame_step: float = setting(0.006, "standard error of a frame's translation", unit="m", low=1e-4, high=9)
    loop_turn: float = setting(0.05, "standard error of a loop's rotation", unit="deg", low=1e-4, high=9)
    loop_step: float = setting(0.05, "standard error of a loop's translation", unit="m", low=1e-4, high=9)
    scale: float = setting(3.0, "residual with the weight ½, in standard deviations", low=0.01, high=1e6)
