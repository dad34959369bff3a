"""The files of a path with closed loops: the corrected poses, and a table of the loops."""

from __future__ import annotations

from pathlib import Path

from ..data.poses import write_kitti_poses
from ..data.tables import csv_text
from ..files import write_atomic
from .graph import LoopClosure

COLUMNS = ["first", "second", "similarity", "matches", "inliers", "residual_px", "weight", "gap_m"]


def write_closure(poses_file: Path, loops_file: Path, frames: tuple[str, ...], closure: LoopClosure) -> None:
    """Write the corrected path in KITTI's format, and a CSV row for each closed loop.

    frames : (N) names of the frames, which the rows use. Raises `DataError` if a file cannot be written.
    """
    write_kitti_poses(poses_file, closure.poses)
    loops = closure.loops
    rows: list[list[object]] = [list(COLUMNS)]
    for k in range(len(loops)):
        rows.append(
            [
                frames[loops.first_frame[k]],
                frames[loops.second_frame[k]],
                f"{loops.similarity[k]:.3f}",
                int(loops.matches[k]),
                int(loops.inliers[k]),
                f"{loops.residual[k]:.3f}",
                f"{closure.weight[k]:.3f}",
                f"{closure.gap_m[k]:.3f}",
            ]
        )
    write_atomic(loops_file, csv_text(rows))
