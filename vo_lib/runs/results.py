"""Run folders: everything a run leaves behind, each file whole or not there."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from ..beyond.calibration import read_calibration
from ..config import config_class
from ..core import settings
from ..core.errors import DataError
from ..core.files import (
    NUMBER,
    csv_text,
    file_sha256,
    fits,
    read_csv,
    read_json,
    require_own,
    write_bytes_atomic,
    write_text_atomic,
)
from ..core.frame import LOST, TIME_JUMP, FrameResult
from ..core.geometry import inverse
from ..core.poses import format_kitti_poses, format_tum, read_kitti_poses
from ..core.types import Array
from ..data.sequence import Sequence
from ..evaluation.evaluate import Evaluation, evaluate
from ..evaluation.kitti import KITTI_LENGTHS, KITTI_STEP, SHORT_LENGTHS, trajectory_distances
from .identity import run_identity, surroundings
from .runner import Run

CONFIG = "config.json"
LOG = "frames.csv"
METRICS = "metrics.json"
POSES = "poses.txt"
CALIBRATION = "calibration.json"
RESULTS = (POSES, LOG, CALIBRATION, METRICS)
POSES_TUM = "poses_tum.txt"
RUN_FILES = (CONFIG, *RESULTS, POSES_TUM)  # a run's own where config.json says that it is one
UNFINISHED = "unfinished"
FILES = "files"
NUMBER_OR_NONE = (*NUMBER, type(None))
# What is read of metrics.json again; whole runs are measured anew where it is missing.
_ERRORS = {"subsequences": int, "te_percent": NUMBER_OR_NONE, "re_deg_per_100m": NUMBER_OR_NONE}
METRICS_SHAPE = {
    "sequences": [
        _ERRORS
        | {
            "by_length": [{"length_m": NUMBER} | _ERRORS],
            "by_speed": [{"speed_m_s": NUMBER} | _ERRORS],
            "ate": {"alignment": str, "rmse_m": NUMBER_OR_NONE},
            "rpe": {"translation": {"rmse_m": NUMBER_OR_NONE}, "rotation": {"rmse_deg": NUMBER_OR_NONE}},
        }
    ]
}
DOUBTS = "doubts"  # in metrics.json and config.json
PATH = "path"  # in metrics.json, beside the errors: whether the path can be believed
STAGES = ("wait_images", "matching", "cached_matches", "filter", "rotation", "translation", "calibration")


@contextmanager
def run_folder(folder: str | Path, *names: str) -> Iterator[Path]:
    """A folder for results that can be written to, seen before any work is done.

    names : files that the work writes there; what the kit did not write is refused.

    When the work inside fails, folders made for it are taken away again if they are still empty. A sequence's
    own folder is refused: a run's poses.txt would take the place of the truth.
    """
    if not str(folder):
        raise DataError("the folder's name is empty: expected where results are written")
    path = Path(folder)
    made: list[Path] = []
    try:
        try:
            if (path / "image_0").is_dir():
                raise DataError("holds a sequence's images: name another folder for results", path)
            made += [p for p in (path, *path.parents) if not p.exists()]
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise DataError(f"the folder cannot be made: {error.strerror}", path) from None
        require_own(*(path / name for name in names))
        probe = path / f".{os.getpid()}.writable"
        write_bytes_atomic(probe, b"")
        probe.unlink()
        yield path
    except BaseException:
        with suppress(OSError):
            for new in made:
                new.rmdir()
        raise


def evaluate_run(result: Run) -> dict[str, Evaluation]:
    """Errors of a run with truth, as `evaluate_path` has them; none without."""
    return {} if result.sequence.truth is None else evaluate_path(result.sequence, result.poses)


def evaluate_path(sequence: Sequence, poses: Array) -> dict[str, Evaluation]:
    """Errors of poses (N, 4, 4) of a sequence with truth, by kind.

    "kitti" as the benchmark has it, "short" where the path is short; speeds by the sequence's own times.
    """
    truth = sequence.truth
    assert truth is not None
    pairs, times = [(sequence.name, truth, poses)], {sequence.name: sequence.times}
    errors = {"kitti": evaluate(pairs, KITTI_LENGTHS, KITTI_STEP, times=times)}
    if trajectory_distances(truth)[-1] < KITTI_LENGTHS[-1]:
        errors["short"] = evaluate(pairs, SHORT_LENGTHS, 1, times=times)
    return errors


def write_run(folder: Path, result: Run, method: str, identity: dict[str, Any] | None = None) -> None:
    """Write poses, per-frame log, errors, and what the run was.

    config.json comes first, marked as unfinished, and last without the mark: killed in between, the folder
    is nobody's finished run. `identity` is that of `identity.run_identity`, where it is known already.
    """
    sequence = result.sequence
    config = identity or run_identity(sequence, result.config, method)
    metrics: dict[str, Any] = {kind: errors.to_dict() for kind, errors in evaluate_run(result).items()}
    metrics[PATH] = {
        "frames_in_doubt": sum(m.in_doubt for m in result.motions),
        "time_jumps": sum(TIME_JUMP in m.flags for m in result.motions),
        "lost": path_lost(result),
        DOUBTS: list(result.doubts),
    }
    write_text_atomic(folder / CONFIG, _json(config | {UNFINISHED: True}))
    write_text_atomic(folder / POSES, format_kitti_poses(result.poses))
    write_text_atomic(folder / POSES_TUM, format_tum(sequence.times, result.poses))
    write_text_atomic(folder / LOG, frames_csv(sequence.frames[1:], result.motions))
    if result.calibration is not None:
        write_text_atomic(folder / CALIBRATION, result.calibration.to_json())
    else:
        (folder / CALIBRATION).unlink(missing_ok=True)
    write_text_atomic(folder / METRICS, _json(metrics))
    config = config | {"timing": timing(result), "surroundings": surroundings(), DOUBTS: list(result.doubts)}
    config[FILES] = {n: file_sha256(folder / n) for n in RESULTS if (folder / n).exists()}
    write_text_atomic(folder / CONFIG, _json(config))


def path_lost(result: Run) -> bool:
    """Whether more frames in a row were in doubt than the last good motion can stand for."""
    return any(LOST in motion.flags for motion in result.motions)


def read_metrics(folder: Path) -> dict[str, Any]:
    """The errors in metrics.json, none where the run has no truth; `DataError` where it is damaged."""
    path = folder / METRICS
    if not path.exists():
        return {}
    expected = "the errors of a run, as `vo run` writes them"
    data: dict[str, Any] = read_json(path, {}, expected)
    data.pop(PATH, None)
    if not fits(data, {str: METRICS_SHAPE}) or not all(kind["sequences"] for kind in data.values()):
        raise DataError(f"expected {expected}", path)
    return data


def timing(result: Run) -> dict[str, Any]:
    """Mean milliseconds a frame, of each stage and in all."""
    stages = [stage for stage in STAGES if any(stage in motion.ms for motion in result.motions)]
    mean = {s: float(np.mean([motion.ms.get(s, 0.0) for motion in result.motions])) for s in stages}
    return {"ms_per_frame": result.ms_per_frame, "ms_per_frame_of": mean}


def read_config(folder: Path, unfinished: bool = False) -> dict[str, Any]:
    """What config.json of a finished run says; `DataError` where it is no such file.

    unfinished : take that of a run that was stopped while its files were written, too.
    """
    path = folder / CONFIG
    expected = "the settings of a run, as `vo run` writes them"
    data: dict[str, Any] = read_json(path, {"settings": {}}, expected)
    if not fits(data.get(FILES, {}), {str: str}) or not fits(data.get(DOUBTS, []), [str]):
        raise DataError(f"expected {expected}", path)
    if data.get(UNFINISHED) and not unfinished:
        raise DataError("the run was stopped while its files were written: do it again", path)
    return data


def require_unchanged(folder: Path, config: dict[str, Any], *names: str) -> None:
    """`DataError` where a file of a run is not as its config.json has it; older kits do not say."""
    written = config.get(FILES, {})
    for name in names:
        if written.get(name) not in (None, file_sha256(folder / name)):
            raise DataError("was cut or changed since the run wrote it: do the run again", folder / name)


def is_finished(folder: Path) -> bool:
    """Whether a folder holds a finished run."""
    try:
        return bool(read_config(folder))
    except DataError:
        return False


def read_run(folder: Path, sequence: Sequence) -> Run:
    """A finished run of the sequence from its folder, to the digits that poses.txt and frames.csv have.

    Raises `DataError` where a file is missing or broken, or does not have a row for each frame.
    """
    stored = read_config(folder)
    try:
        config = settings.from_dict(config_class(str(stored.get("variant", "kit"))), stored["settings"])
    except DataError as error:
        raise DataError(str(error), folder / CONFIG) from None
    kept = folder / CALIBRATION
    require_unchanged(folder, stored, POSES, LOG, METRICS, *([CALIBRATION] if kept.exists() else []))
    poses = read_kitti_poses(folder / POSES)
    path = folder / LOG
    (_, heading), *lines = read_csv(path) or [(1, [])]
    rows = [dict(zip(heading, cells, strict=False)) for _, cells in lines]
    if len(poses) != len(sequence) or len(rows) != len(sequence) - 1:
        raise DataError(f"expected a row for each of the {len(sequence)} frames of {sequence.name}", path)
    T_cp = inverse(poses[1:]) @ poses[:-1]
    try:
        motions = [_read_motion(row, T) for row, T in zip(rows, T_cp, strict=True)]
    except (KeyError, ValueError):
        raise DataError("expected the columns of a per-frame log, as `vo run` writes it", path) from None
    learnt = read_calibration(kept) if kept.exists() else None
    return Run(sequence, config, poses, motions, learnt, tuple(stored.get(DOUBTS, ())))


def _read_motion(row: dict[str, str], T_cp: Array) -> FrameResult:
    """A row of frames.csv, and the motion that belongs to it."""
    return FrameResult(
        T_cp,
        matches=int(row["matches"]),
        removed=int(row["removed_by_boxes"]),
        used=int(row["used"]),
        inliers=int(row["inliers"]),
        prior_angle=float(row["prior_angle_deg"] or "nan"),
        flags=tuple(row["flags"].split()),
        ms={stage: float(row[f"{stage}_ms"]) for stage in STAGES if row.get(f"{stage}_ms")},
    )


def frames_csv(frames: tuple[str, ...], motions: list[FrameResult]) -> str:
    """The per-frame log as CSV: one row for the motion into each frame but the first."""
    heading = ["frame", "matches", "removed_by_boxes", "used", "inliers", "prior_angle_deg"]
    heading += ["step_m", "flags"]
    rows: list[list[object]] = [[*heading, *(f"{stage}_ms" for stage in STAGES)]]
    for frame, motion in zip(frames, motions, strict=True):
        angle = "" if math.isnan(motion.prior_angle) else f"{motion.prior_angle:.4f}"
        step, flags = f"{np.linalg.norm(motion.T_cp[:3, 3]):.4f}", " ".join(motion.flags)
        row = [frame, motion.matches, motion.removed, motion.used, motion.inliers, angle, step, flags]
        rows.append(row + [f"{motion.ms[stage]:.2f}" if stage in motion.ms else "" for stage in STAGES])
    return csv_text(rows)


def _json(data: dict[str, Any]) -> str:
    return json.dumps(data, indent=2, allow_nan=False) + "\n"
