"""A page that shows a run's path and the points it was computed from in three dimensions, in any browser."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from ..core.files import write_result
from ..core.geometry import transform
from ..core.poses import from_first
from ..core.types import Array
from ..runs.runner import Run
from .film import Shown
from .report import html_page

FARTHEST = 50.0  # baselines; points farther away scatter too much to be looked at
MOST = 40_000  # points in a page


class View:
    """Points gathered from the frames of a run, each where it was seen last from near."""

    def __init__(self, run: Run, title: str):
        self.run, self.title = run, title
        self._points: dict[int, tuple[Array, int, int]] = {}

    def add(self, shown: Shown) -> None:
        """The features of a frame that boxes left."""
        camera, matches = self.run.sequence.camera, shown.matches[shown.keep]
        left, _ = self.run.sequence.stereo(shown.index)
        X_c = camera.triangulate(matches.cur_left, matches.cur_right)
        near = np.flatnonzero((X_c[:, 2] > 0) & (X_c[:, 2] < FARTHEST * camera.baseline))
        X_w = transform(self.run.poses[shown.index], X_c[near])
        u, v = np.rint(matches.cur_left[near]).astype(int).T
        grey = left[np.clip(v, 0, left.shape[0] - 1), np.clip(u, 0, left.shape[1] - 1)]
        found = zip(X_w, np.maximum(grey, 60).tolist(), [shown.index] * len(near), strict=True)
        self._points |= dict(zip(matches.id[near].tolist(), found, strict=True))

    def write(self, path: Path) -> None:
        """The page: one file that needs nothing else. Points are in centimetres, lines in metres."""
        chosen = list(self._points.values())[:: 1 + len(self._points) // MOST]
        sequence = self.run.sequence
        lines = [("#50bef0", self.run.poses)]
        if sequence.truth is not None:
            lines.insert(0, ("#f03c3c", from_first(sequence.truth)))
        points = np.array([X for X, _, _ in chosen]).reshape(-1)
        data = {
            "points": np.rint(100 * points).astype(int).tolist(),
            "grey": [grey for _, grey, _ in chosen],
            "seen": [index for _, _, index in chosen],
            "times": np.round(sequence.times - sequence.times[0], 3).tolist(),
            "lines": [(colour, np.round(T[:, :3, 3], 3).tolist()) for colour, T in lines],
        }
        page = html_page(
            "view.html",
            title=self.title,
            truth=sequence.truth is not None,
            count=len(chosen),
            data=json.dumps(data, separators=(",", ":")),
        )
        write_result(path, page)
