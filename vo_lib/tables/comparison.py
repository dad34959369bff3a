"""Finished runs read back from their folders, to be put side by side."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..core.errors import DataError
from ..core.files import NUMBER, fits
from ..core.poses import from_first, read_kitti_poses
from ..core.types import Array
from ..data.sequence import Sequence
from ..evaluation.kitti import KITTI_BIN_MINIMUM
from ..runs.results import CONFIG, METRICS, POSES, evaluate_path, read_config, read_metrics, require_unchanged
from .report import ReportTable, number

KINDS = {"kitti": "as KITTI, over 100 m and more", "short": "over 20, 50, 100 m, every frame"}
STORED: dict[str, Any] = {"frames": [str], "settings": {"seed": int}, "timing": {"ms_per_frame": NUMBER}}
STORED |= dict.fromkeys(("method", "sequence", "variant"), str)
COLUMNS = ["run", "TE %", "RE deg/100 m", "ATE m", "RPE m", "RPE deg", "ms a frame"]


@dataclass(frozen=True)
class StoredRun:
    """A run folder's content.

    Attributes
    ----------
    label : what a legend calls it: the method, with more where another run is called so.
    frames : names of the first and last frame.
    poses : (N, 4, 4) T_w_c.
    metrics : what metrics.json holds, by kind ("kitti", "short"); empty without truth.
    ms_per_frame : NaN where the folder does not say.
    """

    folder: Path
    label: str
    method: str
    variant: str
    seed: int
    sequence: str
    frames: tuple[str, str]
    poses: Array
    metrics: dict[str, Any]
    ms_per_frame: float


def read_stored_run(folder: str | Path) -> StoredRun:
    """A finished run of any method; `DataError` names the file that is missing or broken."""
    folder = Path(folder)
    if not folder.is_dir():
        raise DataError("the run folder is missing", folder)
    config = {"variant": "kit", "timing": {"ms_per_frame": math.nan}} | read_config(folder)
    if not fits(config, STORED) or len(config["frames"]) != 2:
        raise DataError("expected method, sequence and frames of a run", folder / CONFIG)
    require_unchanged(folder, config, POSES, *([METRICS] if (folder / METRICS).exists() else []))
    poses = read_kitti_poses(folder / POSES)
    first, last = config["frames"]
    seed, ms = config["settings"]["seed"], float(config["timing"]["ms_per_frame"])
    method, sequence, variant = config["method"], config["sequence"], config["variant"]
    metrics = read_metrics(folder)
    return StoredRun(folder, method, method, variant, seed, sequence, (first, last), poses, metrics, ms)


def read_stored_runs(folders: list[str]) -> dict[str, list[StoredRun]]:
    """Runs by sequence (and frames, where those differ), each with a label of its own."""
    groups: dict[tuple[str, str, str], list[StoredRun]] = {}
    for run in map(read_stored_run, folders):
        groups.setdefault((run.sequence, *run.frames), []).append(run)
    names = [name for name, _, _ in groups]
    return {
        name if names.count(name) == 1 else f"{name}, frames {first}-{last}": distinct(runs)
        for (name, first, last), runs in groups.items()
    }


def foreign_run(file: str, like: StoredRun, sequence: Sequence | None) -> StoredRun:
    """Another system's poses, a file in KITTI's format, as a run over the frames of `like`.

    Raises `DataError` where the sequence with its truth is not found, or frames and rows do not go together.
    """
    if sequence is None:
        raise DataError(f"the truth of {like.sequence} is not found: no errors of", file)
    poses = read_kitti_poses(file)
    if len(poses) != len(sequence):
        raise DataError(f"has {len(poses)} rows; the runs have {len(sequence)} frames", file)
    metrics = {kind: found.to_dict() for kind, found in evaluate_path(sequence, poses).items()}
    name, place, frames = Path(file).stem, Path(file), like.frames
    start = from_first(poses)
    return StoredRun(place, name, name, "", 0, like.sequence, frames, start, metrics, math.nan)


def comparison_table(name: str, runs: list[StoredRun]) -> ReportTable:
    """Errors and time of the runs over one sequence; over KITTI's sub-sequences where all have them."""
    kind = common_kind(runs)
    rows = []
    note = "No ground truth in these folders: no errors."
    for run in runs:
        values: list[float | None] = [None] * 5
        if kind is not None:
            found = run.metrics[kind]["sequences"][0]
            ate, step, turn = found["ate"], found["rpe"]["translation"], found["rpe"]["rotation"]
            values = [found["te_percent"], found["re_deg_per_100m"], ate["rmse_m"]]
            values += [step["rmse_m"], turn["rmse_deg"]]
            note = f"TE and RE {KINDS[kind]}; ATE (alignment {ate['alignment']}) and RPE (frame to frame) as "
            note += "root mean squares."
        rows.append([run.label, *map(number, values), number(run.ms_per_frame, 1)])
    return ReportTable(name, COLUMNS, rows, [note])


def common_kind(runs: list[StoredRun]) -> str | None:
    """The errors that all runs have: KITTI's where they make a curve, else those of short paths.

    Where a path is too short for any sub-sequence there are ATE and RPE alone. None without truth.
    """
    there = [kind for kind in KINDS if all(kind in run.metrics for run in runs)]
    kinds = [kind for kind in there if all(run.metrics[kind]["sequences"][0]["subsequences"] for run in runs)]
    drawn = [kind for kind in kinds if all(len(curve(run, kind, "length")) > 1 for run in runs)]
    return next(iter(drawn + kinds + there), None)


def curve(run: StoredRun, kind: str, by: str) -> list[tuple[float, float | None, float | None]]:
    """Points (length in m or speed in km/h, TE, RE) of a run; of three sub-sequences and more."""
    key, scale = ("length_m", 1.0) if by == "length" else ("speed_m_s", 3.6)
    return [
        (scale * point[key], point["te_percent"], point["re_deg_per_100m"])
        for point in run.metrics[kind]["sequences"][0][f"by_{by}"]
        if point["subsequences"] >= KITTI_BIN_MINIMUM
    ]


def distinct(runs: list[StoredRun]) -> list[StoredRun]:
    """The runs with the shortest labels that tell them apart: method, seed, folder."""
    methods = [f"{r.method}, {r.variant}" if r.variant == "published" else r.method for r in runs]
    pairs = list(zip(methods, runs, strict=True))
    seeds, folders = [f"{m}, seed {r.seed}" for m, r in pairs], [f"{m}, {r.folder}" for m, r in pairs]
    labels = first_distinct(methods, seeds, folders)
    return [dataclasses.replace(run, label=label) for run, label in zip(runs, labels, strict=True)]


def first_distinct(*candidates: list[str]) -> list[str]:
    """The first of several lists of names in which none stands twice, else the last."""
    return next((names for names in candidates if len(set(names)) == len(names)), candidates[-1])
