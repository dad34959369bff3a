"""Artificial runs for tables: straight drives whose steps are too long by a given percentage."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np

from vo_lib.config import preset
from vo_lib.data.sequence import Sequence
from vo_lib.evaluation.kitti_errors import SubsequenceProtocol
from vo_lib.geometry.camera import StereoCamera
from vo_lib.geometry.result import FrameResult
from vo_lib.geometry.types import Array
from vo_lib.report.table1 import PAPER_METHODS, PAPER_ROWS, Entry, PaperTable, measure_runs
from vo_lib.runs.drive import Run


def straight(n: int, step: float = 1.0) -> Array:
    """Poses (n, 4, 4) straight ahead, `step` metres apart."""
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, 2, 3] = step * np.arange(n)
    return poses


def sequence_of(name: str, n: int) -> Sequence:
    """A sequence of n frames a metre apart, without images."""
    frames = tuple(f"{i:06d}" for i in range(n))
    camera = StereoCamera(700.0, 600.0, 180.0, 0.5, 1200, 370)
    return Sequence(name, Path("nowhere"), frames, camera, np.arange(0.0, n) / 10.0, straight(n), None)


def entry_of(
    name: str,
    n: int,
    percent: list[float],
    method: str = "viso2",
    variant: str = "kit",
    protocol: SubsequenceProtocol | None = None,
) -> Entry:
    """Runs whose steps are too long by `percent`, one run per seed."""
    return _entry_of(name, n, tuple(percent), method, variant, protocol)


@functools.cache  # the tests ask for the same runs again and again
def _entry_of(
    name: str,
    n: int,
    percent: tuple[float, ...],
    method: str,
    variant: str,
    protocol: SubsequenceProtocol | None,
) -> Entry:
    ms = {"matching": 30.0, "wait_images": 9.0, "cached_matches": 2.0, "rotation": 4.0, "filter": 1.0}
    motion = FrameResult(np.eye(4), matches=100, removed=25, ms=ms)
    sequence = sequence_of(name, n)
    runs = [
        Run(
            sequence, preset(method, variant=variant, seed=seed), straight(n, 1 + p / 100), [motion] * (n - 1)
        )
        for seed, p in enumerate(percent)
    ]
    return measure_runs(method, runs, protocol)


def table_of_twos() -> PaperTable:
    """An artificial table in which every printed number is 2."""
    return PaperTable({(row, method): (2.0, 2.0) for row in PAPER_ROWS for method in PAPER_METHODS})
