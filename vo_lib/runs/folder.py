"""Run folders: atomic writing and reading of the files of a run."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from .. import settings
from ..config import METHODS, preset
from ..data.kitti import has_images
from ..data.label_names import DETECTOR_RECORD
from ..data.poses import format_kitti_poses, format_tum, read_kitti_poses
from ..data.sequence import Sequence
from ..data.tables import csv_text, read_csv
from ..errors import DataError
from ..files import DRAFT, LOCK, file_sha256, locked_draft, read_mapping, write_atomic
from ..geometry.motion import inverse
from ..geometry.result import Flag, FrameResult
from ..geometry.types import Array
from ..paper.settings import MethodConfig
from .drive import Run
from .identity import machine_info, short_digest
from .run_quality import LOG, evaluate_run, path_lost, warnings_of

CONFIG = "config.json"
METRICS = "metrics.json"
POSES = "poses.txt"
POSES_TUM = "poses_tum.txt"
CALIBRATION = "calibration.json"
PICTURE = "trajectory.png"
# Only after the closing of loops.
LOOPS = "loops.csv"
LOOPS_POSES = "poses_loops.txt"
RUN_FILES = (CONFIG, POSES, POSES_TUM, LOG, CALIBRATION, METRICS, PICTURE, LOOPS, LOOPS_POSES)

# Fields of config.json beside the identity of the run (`identity.run_identity`).
SETTINGS_DIGEST = "settings_digest"  # shows whether somebody has edited the settings
DETECTOR_OF_BOXES = "detector_of_boxes"  # `DETECTOR_INPUTS` of its record; null if no detector made the boxes
DETECTOR_INPUTS = ("model", "sha256", "provider", "settings", "classes")
# The type of each value that is read back, and its name in messages. `_are_two_texts` checks "frames".
CONFIG_VALUES: dict[str, tuple[type, str]] = {
    "method": (str, "a text"),
    "variant": (str, "a text"),
    "sequence": (str, "a text"),
    "camera": (dict, "an object"),
    "made_with": (dict, "an object"),
    "files": (dict, "an object"),
}
# A config.json that a person writes, for --config, does not have all of these fields.
WRITTEN_BY_RUNS = ("method", "variant", "frames", "images", "made_with", "files", SETTINGS_DIGEST)

# Columns of frames.csv: the counts, by attribute of `FrameResult`, and the stages, each with a time.
COUNTS = {"matches": "matches", "removed": "removed_by_boxes", "used": "used", "inliers": "inliers"}
STAGES = ("wait_images", "matching", "cached_matches", "filter", "rotation", "translation", "calibration")


@contextmanager
def run_folder(folder: str | Path) -> Iterator[Path]:
    """A folder for results, created if it is missing.

    Created folders that are still empty at the end are removed.

    Raises
    ------
    DataError : the name is empty, the folder cannot be created, or it is the folder of a sequence, in which a
        run's poses.txt would replace the ground truth.
    """
    if not str(folder):
        raise DataError("the folder's name is empty: give a folder for the results")
    path = Path(folder)
    try:
        if has_images(path):
            raise DataError("contains images of a sequence: choose another folder for the results", path)
        new_folders = [place for place in (path, *path.parents) if not place.exists()]
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DataError(f"the folder cannot be created: {error.strerror}", path) from None
    try:
        yield path
    finally:
        with suppress(OSError):
            for new_folder in new_folders:
                new_folder.rmdir()


@contextmanager
def written_together(folder: Path) -> Iterator[Path]:
    """A temporary folder, whose files replace those of `folder` one by one when the context ends.

    Every file is complete on the disk before the first one is replaced, so on a full disk the files from
    before remain. A file whose name ends with `DRAFT` is the mark of a complete result: it is the last one,
    and gets its name without the ending only then. If this is interrupted, files that were not there before
    go again, so that none of them is taken for somebody else's. Raises `DataError` like `write_atomic`.
    """
    with locked_draft(folder / "results") as draft:
        draft.mkdir()
        yield draft
        names = sorted(os.listdir(draft), key=lambda name: (name.endswith(DRAFT), name))
        targets = {name: folder / name.removesuffix(DRAFT) for name in names}
        new = [target for target in targets.values() if not os.path.lexists(target)]
        try:
            for name, target in targets.items():
                os.replace(draft / name, target)
        except BaseException:
            for target in new:
                target.unlink(missing_ok=True)
            raise


def refuse_foreign(folder: Path, names: Iterable[str], own: bool) -> None:
    """Raise `DataError` with the first file that a result would replace in a folder that is not the kit's.

    own : whether the folder has results of the kit; a folder with the lock of a process is the kit's too.
    """
    there = [name for name in names if os.path.lexists(folder / name)]
    if there and not own and not (folder / LOCK).exists():
        raise DataError("is not the kit's file: choose another folder for the results", folder / there[0])


def refuse_foreign_files(folder: Path, fresh: bool = False) -> None:
    """Raise `DataError` if a folder contains files that no run of the kit wrote.

    A folder with the config.json of a run may have other files. In one with the lock of a killed process,
    files with the names of a run's are the kit's, but other files are still refused.

    fresh : allow other files, as long as a run does not replace them.
    """
    if is_finished(folder):
        return
    refuse_foreign(folder, RUN_FILES, own=False)
    if fresh:
        return
    try:
        names = sorted(os.listdir(folder))
    except OSError as error:
        raise DataError(f"the folder cannot be read: {error.strerror}", folder) from None
    for name in names:
        if name not in RUN_FILES and not name.startswith("."):
            raise DataError(
                f"the folder contains other files, such as {name}: choose another folder, or add --fresh",
                folder,
            )


def delete_unfinished(folder: Path) -> None:
    """Delete the files of a run that was killed before its last file, config.json, was written."""
    if not is_finished(folder):
        for name in RUN_FILES:
            (folder / name).unlink(missing_ok=True)


def changed_files(folder: Path) -> list[str]:
    """Names of the files of a finished run that are missing, or that differ from what the run wrote."""
    if not is_finished(folder):
        return []
    digests = read_config(folder)["files"]
    written = [name for name in RUN_FILES if name in digests]
    return [name for name in written if _digest_or_none(folder / name) != digests[name]]


def _digest_or_none(path: Path) -> str | None:
    """SHA-256 of a file; None for a file that is missing or cannot be read."""
    try:
        return file_sha256(path)
    except DataError:
        return None


def write_run(folder: Path, result: Run, identity: dict[str, Any]) -> None:
    """Write poses, per-frame log, errors and, last, config.json, which marks the run as finished.

    A run that is in the folder already remains whole on a full disk. The config.json has the SHA-256 of the
    other files.

    identity : result of `identity.run_identity`.

    Raises `DataError` if the folder cannot be written.
    """
    sequence = result.sequence
    metrics: dict[str, Any] = {kind: errors.to_dict() for kind, errors in evaluate_run(result).items()}
    if sequence.truth_file is not None:
        metrics["truth"] = sequence.truth_name
    metrics["path"] = {
        "frames_without_motion": sum(not motion.measured for motion in result.motions),
        "lost": path_lost(result),
        "warnings": warnings_of(result),
    }
    # Files of an earlier run in this folder that this function does not replace are deleted.
    stale = [PICTURE, LOOPS, LOOPS_POSES]
    if result.calibration is None:
        stale.append(CALIBRATION)
    with written_together(folder) as draft:
        write_atomic(draft / POSES, format_kitti_poses(result.poses))
        write_atomic(draft / POSES_TUM, format_tum(sequence.times, result.poses))
        write_atomic(draft / LOG, frames_csv(sequence.frames[1:], result.motions))
        if result.calibration is not None:
            write_atomic(draft / CALIBRATION, result.calibration.to_json())
        write_atomic(draft / METRICS, _json(metrics))
        about_run: dict[str, Any] = {
            "timing": timing(result),
            "machine_info": machine_info(),
            "files": {path.name: file_sha256(path) for path in sorted(draft.iterdir())},
            SETTINGS_DIGEST: _digest_of_settings(identity["settings"]),
            DETECTOR_OF_BOXES: _detector_of_boxes(result),
            "folder": os.path.abspath(sequence.folder),  # a link is kept, since it may lead to the truth
        }
        # Under this name, a search for finished runs does not find it (`written_together`).
        write_atomic(draft / (CONFIG + DRAFT), _json(identity | about_run))
        for name in stale:
            (folder / name).unlink(missing_ok=True)


def _detector_of_boxes(result: Run) -> dict[str, Any] | None:
    """The record of the detector that wrote the run's boxes; None for other labels, or without boxes."""
    labels = result.sequence.labels
    if labels is None or not result.config.filter.uses_boxes or not (labels / DETECTOR_RECORD).is_file():
        return None
    record = read_mapping(labels / DETECTOR_RECORD, "the record of a detector")
    return {name: record[name] for name in DETECTOR_INPUTS if name in record}


def timing(result: Run) -> dict[str, Any]:
    """Mean milliseconds per frame, of each stage and in total."""
    mean_of_stage = {}
    for stage in STAGES:
        if any(stage in motion.ms for motion in result.motions):
            of_frames = [motion.ms.get(stage, 0.0) for motion in result.motions]
            mean_of_stage[stage] = float(np.mean(of_frames))
    return {"ms_per_frame": result.ms_per_frame, "ms_per_frame_of": mean_of_stage}


def read_config(path: Path) -> dict[str, Any]:
    """The content of config.json, from its path or folder; `DataError` if the file is missing or invalid."""
    path = path / CONFIG if path.is_dir() else path
    expected = "the settings of a run, as written by `vo run`"
    data = read_mapping(path, expected)
    if not isinstance(data.get("settings"), dict):
        raise DataError(f"expected {expected}", path)
    for name, (kind, words) in CONFIG_VALUES.items():
        if name in data and not isinstance(data[name], kind):
            raise DataError(f"{name}: expected {words}, as written by `vo run`", path)
    if "frames" in data and not _are_two_texts(data["frames"]):
        raise DataError("frames: expected the names of the first and the last frame", path)
    return data


def _are_two_texts(value: object) -> bool:
    """Whether a value of JSON is a list of two texts."""
    return isinstance(value, list) and len(value) == 2 and all(isinstance(each, str) for each in value)


def is_as_written(data: dict[str, Any]) -> bool:
    """Whether the content of a config.json is that of a run whose settings nobody has edited since."""
    is_complete = all(name in data for name in WRITTEN_BY_RUNS)
    return is_complete and data[SETTINGS_DIGEST] == _digest_of_settings(data["settings"])


def _digest_of_settings(values: dict[str, Any]) -> str:
    """A digest of the settings in config.json, 16 hexadecimal digits."""
    return short_digest(json.dumps(values, sort_keys=True).encode())


def settings_in(data: dict[str, Any], path: Path) -> MethodConfig:
    """The settings in the content of the config.json at `path`; a `DataError` names this file."""
    try:
        cls = type(preset(METHODS[0], variant=str(data.get("variant"))))
        config: MethodConfig = settings.from_dict(cls, data["settings"])
    except DataError as error:
        raise DataError(str(error), path) from None
    return config


def is_finished(folder: Path) -> bool:
    """Whether a folder contains a finished run: config.json has the content that only a run writes."""
    if not (folder / CONFIG).exists():
        return False
    try:
        data = read_config(folder)
    except DataError:
        return False
    return all(name in data for name in WRITTEN_BY_RUNS)


def has_runs(folder: Path) -> bool:
    """Whether a folder contains a finished run in one of its folders."""
    return any(is_finished(path.parent) for path in folder.rglob(CONFIG))


def read_run(folder: Path, sequence: Sequence) -> Run:
    """A finished run of the sequence, read from its folder with the precision of poses.txt and frames.csv.

    Raises `DataError` if a file is missing, invalid or not as the run wrote it, or does not have one row per
    frame.
    """
    changed = changed_files(folder)
    if not changed:
        return _parse_run(folder, sequence)
    fault = ""
    try:
        _parse_run(folder, sequence)  # may find the line at fault
    except DataError as error:
        fault = f" ({str(error).removeprefix(f'{folder}/')})"
    raise DataError(f"is missing or is not as the run wrote it: repeat the run{fault}", folder / changed[0])


def _parse_run(folder: Path, sequence: Sequence) -> Run:
    """The run in a folder; a `DataError` names a file that is missing or damaged."""
    config = settings_in(read_config(folder), folder / CONFIG)
    poses = read_kitti_poses(folder / POSES)
    rows = _read_log(folder / LOG)
    frames = len(sequence)
    if len(poses) != frames:
        raise DataError(
            f"expected a pose for each of the {frames} frames of {sequence.name}, found {len(poses)}",
            folder / POSES,
        )
    if len(rows) != frames - 1:
        raise DataError(
            f"expected a row for each of the {frames} frames of {sequence.name} but the first, "
            f"found {len(rows)}",
            folder / LOG,
        )
    T_cp = inverse(poses[1:]) @ poses[:-1]
    try:
        motions = [_read_motion(row, T_cp_of_frame) for row, T_cp_of_frame in zip(rows, T_cp, strict=True)]
    except (KeyError, ValueError):
        raise DataError(
            "expected the columns of a per-frame log, as written by `vo run`", folder / LOG
        ) from None
    if config.variant == "published":
        return Run(sequence, config, poses, motions)
    from ..kit.calibration import read_learnt_calibration

    calibration = read_learnt_calibration(folder / CALIBRATION, max_error=math.inf)  # as the run found it
    return Run(sequence, config, poses, motions, calibration)


def _read_log(path: Path) -> list[dict[str, str]]:
    """The rows of frames.csv, each as cells by column; a row may lack the last columns."""
    lines = [cells for _, cells in read_csv(path)]
    if not lines:
        return []
    heading = lines[0]
    return [dict(zip(heading, cells, strict=False)) for cells in lines[1:]]


def _read_motion(row: dict[str, str], T_cp: Array) -> FrameResult:
    """The result of a frame from its row of frames.csv and its motion T_cp (4, 4).

    Raises KeyError for a missing column, and ValueError for a cell that is no number or no flag.
    """
    counts: dict[str, Any] = {name: int(row[column]) for name, column in COUNTS.items()}
    angle = float(row["prior_angle_deg"] or "nan")
    flags = tuple(map(Flag, row["flags"].split()))
    ms = {stage: float(row[f"{stage}_ms"]) for stage in STAGES if row.get(f"{stage}_ms")}
    return FrameResult(T_cp, **counts, prior_angle=angle, flags=flags, ms=ms)


def frames_csv(frames: tuple[str, ...], motions: list[FrameResult]) -> str:
    """The per-frame log as CSV, one row for each frame except the first."""
    stage_columns = [f"{stage}_ms" for stage in STAGES]
    rows: list[list[object]] = [
        ["frame", *COUNTS.values(), "prior_angle_deg", "step_m", "flags", *stage_columns]
    ]
    for frame, motion in zip(frames, motions, strict=True):
        counts = [getattr(motion, name) for name in COUNTS]
        angle = "" if math.isnan(motion.prior_angle) else f"{motion.prior_angle:.4f}"
        step = f"{np.linalg.norm(motion.T_cp[:3, 3]):.4f}"
        flags = " ".join(motion.flags)
        times = [f"{motion.ms[stage]:.2f}" if stage in motion.ms else "" for stage in STAGES]
        rows.append([frame, *counts, angle, step, flags, *times])
    return csv_text(rows)


def _json(data: dict[str, Any]) -> str:
    """The text of a JSON file; ValueError for a number that is not finite."""
    return json.dumps(data, indent=2, allow_nan=False) + "\n"
