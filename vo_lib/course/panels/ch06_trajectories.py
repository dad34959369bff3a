"""Chapter 6: estimates to be judged, from a run of a method or from a file."""

from __future__ import annotations

import numpy as np

from ...config import preset
from ...core.errors import DataError
from ...core.files import read_text
from ...core.poses import read_kitti_poses, read_tum
from ...core.types import Array, Progress
from ...data.sequence import Sequence
from ...evaluation.ate_rpe import check_pair
from ...runs.match_cache import CachedMatches
from ...runs.runner import run_methods
from .data import Memory

TUM_COLUMNS = 8

_runs: Memory[Array] = Memory(24)


def known_run(sequence: Sequence, method: str) -> Array | None:
    """Poses of a method that `method_poses` has run here, or None."""
    key = _key(sequence, method)
    return _runs.get(key, lambda: np.zeros(0)) if key in _runs else None


def method_poses(sequence: Sequence, method: str, progress: Progress | None = None) -> Array:
    """Poses (N, 4, 4) of a method over a whole sequence; the matches are kept on disk, the poses here."""

    def run() -> Array:
        config = preset(method)
        matches = CachedMatches(sequence, config.features, config.matching)
        return run_methods(sequence, {method: config}, progress, matches)[method].poses

    return _runs.get(_key(sequence, method), run)


def _key(sequence: Sequence, method: str) -> tuple[object, ...]:
    return sequence.folder, sequence.frames[0], len(sequence), method


def read_own(path: str, truth: Array) -> Array:
    """Poses (N, 4, 4) of a file in KITTI's or TUM's format, as many as the truth has.

    Raises
    ------
    DataError : the file cannot be read, or has another number of poses.
    """
    if not path:
        raise DataError("type the path of a file of poses: 12 numbers a row (KITTI), or 8 (TUM)")
    rows = [line for line in read_text(path).splitlines() if line.strip() and not line.startswith("#")]
    is_tum = bool(rows) and len(rows[0].split()) == TUM_COLUMNS
    poses = read_tum(path)[1] if is_tum else read_kitti_poses(path)
    check_pair(truth, poses, f"{path}: ")
    return poses
