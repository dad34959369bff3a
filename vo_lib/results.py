"""Run folders: everything a run leaves behind, each file whole or not there."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from . import settings
from .errors import DataError
from .evaluation import KITTI_LENGTHS, KITTI_STEP, SHORT_LENGTHS, Evaluation, evaluate, trajectory_distances
from .files import write_bytes_atomic, write_text_atomic
from .odometry import Motion
from .poses import format_kitti_poses, format_tum
from .runner import Run

STAGES = ("wait_images", "matching", "filter", "rotation", "translation", "calibration")


@contextmanager
def run_folder(folder: str | Path) -> Iterator[Path]:
    """A run folder that can be written to, seen before any work is done.

    When the work inside fails, folders made for it are taken away again if they are still empty.
    """
    path = Path(folder)
    made = [p for p in (path, *path.parents) if not p.exists()]
    try:
        try:
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise DataError(f"the folder cannot be made: {error.strerror}", path) from None
        probe = path / ".writable"
        write_bytes_atomic(probe, b"")
        probe.unlink()
        yield path
    except BaseException:
        with suppress(OSError):
            for new in made:
                new.rmdir()
        raise


def evaluate_run(result: Run) -> dict[str, Evaluation]:
    """Errors of a run with truth: "kitti" as the benchmark has it, "short" where the path is short."""
    truth = result.sequence.truth
    if truth is None:
        return {}
    pairs = [(result.sequence.name, truth, result.poses)]
    errors = {"kitti": evaluate(pairs, KITTI_LENGTHS, KITTI_STEP)}
    if trajectory_distances(truth)[-1] < KITTI_LENGTHS[-1]:
        errors["short"] = evaluate(pairs, SHORT_LENGTHS, 1)
    return errors


def write_run(folder: Path, result: Run, method: str) -> dict[str, Evaluation]:
    """Write poses, settings, per-frame log and errors of a run; returns the errors."""
    sequence = result.sequence
    errors = evaluate_run(result)
    config = {
        "method": method,
        "sequence": sequence.name,
        "frames": [sequence.frames[0], sequence.frames[-1]],
        "settings": settings.to_dict(result.config),
    }
    write_text_atomic(folder / "poses.txt", format_kitti_poses(result.poses))
    write_text_atomic(folder / "poses_tum.txt", format_tum(sequence.times, result.poses))
    write_text_atomic(folder / "config.json", _json(config))
    write_text_atomic(folder / "frames.csv", frames_csv(sequence.frames[1:], result.motions))
    if errors:
        write_text_atomic(folder / "metrics.json", _json({k: e.to_dict() for k, e in errors.items()}))
    else:
        # A folder used before may hold errors of another sequence.
        (folder / "metrics.json").unlink(missing_ok=True)
    return errors


def frames_csv(frames: tuple[str, ...], motions: list[Motion]) -> str:
    """The per-frame log as CSV: one row for the motion into each frame but the first."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    counts = ["frame", "matches", "removed_by_boxes", "used", "inliers", "prior_angle_deg"]
    counts += ["step_m", "disparity_offset_px", "flags"]
    writer.writerow(counts + [f"{stage}_ms" for stage in STAGES])
    for frame, motion in zip(frames, motions, strict=True):
        angle, offset = ("" if math.isnan(x) else f"{x:.4f}" for x in (motion.prior_angle, motion.offset))
        step = f"{np.linalg.norm(motion.T_cp[:3, 3]):.4f}"
        writer.writerow(
            [frame, motion.matches, motion.removed, motion.used, motion.inliers, angle, step]
            + [offset, " ".join(motion.flags)]
            + [f"{motion.ms[stage]:.2f}" if stage in motion.ms else "" for stage in STAGES]
        )
    return buffer.getvalue()


def _json(data: dict[str, Any]) -> str:
    return json.dumps(data, indent=2, allow_nan=False) + "\n"
