"""A page that shows a run's path and the points it was computed from in three dimensions, in any browser."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from ..core.files import write_result
from ..core.geometry import transform
from ..core.poses import from_first
from ..core.types import Array
from ..runs.runner import Run
from .film import Shown

FARTHEST = 50.0  # baselines; points farther away scatter too much to be looked at
MOST = 40_000  # points in a page


class View:
    """Points gathered from the frames of a run, each where it was seen last from near."""

    def __init__(self, run: Run, title: str):
        self.run, self.title = run, title
        self._points: dict[int, tuple[Array, int]] = {}

    def add(self, shown: Shown) -> None:
        """The features of a frame that boxes left."""
        camera, matches = self.run.sequence.camera, shown.matches[shown.keep]
        left, _ = self.run.sequence.stereo(shown.index)
        X_c = camera.triangulate(matches.cur_left, matches.cur_right)
        near = np.flatnonzero((X_c[:, 2] > 0) & (X_c[:, 2] < FARTHEST * camera.baseline))
        X_w = transform(self.run.poses[shown.index], X_c[near])
        u, v = np.rint(matches.cur_left[near]).astype(int).T
        grey = left[np.clip(v, 0, left.shape[0] - 1), np.clip(u, 0, left.shape[1] - 1)]
        found = zip(X_w, np.maximum(grey, 60).tolist(), strict=True)
        self._points |= dict(zip(matches.id[near].tolist(), found, strict=True))

    def write(self, path: Path) -> None:
        """The page: one file that needs nothing else."""
        chosen = list(self._points.values())[:: 1 + len(self._points) // MOST]
        truth = self.run.sequence.truth
        lines = [("#50bef0", self.run.poses)]
        if truth is not None:
            lines.insert(0, ("#f03c3c", from_first(truth)))
        place = self.run.poses[:, :3, 3]
        low, high = place.min(axis=0), place.max(axis=0)
        points = np.array([X for X, _ in chosen]).reshape(-1)
        page = Environment(
            loader=PackageLoader("vo_lib.tables"), autoescape=True, undefined=StrictUndefined
        ).get_template("view.html")
        text = page.render(
            title=self.title,
            truth=truth is not None,
            count=len(chosen),
            points=json.dumps(np.rint(10 * points).astype(int).tolist(), separators=(",", ":")),
            grey=json.dumps([grey for _, grey in chosen], separators=(",", ":")),
            lines=json.dumps([(colour, np.round(T[:, :3, 3], 2).tolist()) for colour, T in lines]),
            centre=np.round((low + high) / 2, 2).tolist(),
            size=float(np.ceil(1.3 * max((high - low).max(), 20.0))),
        )
        write_result(path, text)
