"""The number of threads changes the time of a run, not one bit of it."""

from __future__ import annotations

from pathlib import Path

import cv2
from threadpoolctl import threadpool_limits

from vo_lib import Sequence, open_sequence, preset, run
from vo_lib.core import settings
from vo_lib.core.poses import format_kitti_poses


def poses_with(threads: int, sequence: Sequence, cell: int) -> str:
    """The pose file of a run in which OpenCV and the linear algebra were given so many threads."""
    config = settings.replace(preset("solution_selection"), "features.cell", cell)
    before = cv2.getNumThreads()
    cv2.setNumThreads(threads)
    try:
        with threadpool_limits(limits=threads):
            return format_kitti_poses(run(sequence, config).poses)
    finally:
        cv2.setNumThreads(before)


def test_any_number_of_threads_gives_the_same_bytes(bands: Path) -> None:
    sequence = open_sequence(bands)
    assert poses_with(4, sequence, 10) == poses_with(1, sequence, 10)


def test_on_real_images_too(clips: Path) -> None:
    sequence = open_sequence(clips / "sequences" / "00").part(0, 8)
    assert poses_with(2, sequence, 18) == poses_with(1, sequence, 18)
