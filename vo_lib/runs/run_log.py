"""The log of a run in progress: a line a frame, and checkpoints from which a killed run goes on."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import typing
from pathlib import Path
from typing import Any

import numpy as np

from ..beyond.odometry import State
from ..core.errors import DataError
from ..core.files import write_bytes_atomic, write_text_atomic
from ..core.frame import Motion
from .arrays import pack_arrays, unpack_arrays

LOG = "progress.jsonl"
CHECKPOINT = "checkpoint.npz"
EVERY = 50  # frames from one checkpoint to the next: at most so many are done twice


class RunLog:
    """Log and checkpoint of a run in its folder.

    The log's first line is the run's identity, each further one the motion into a frame. Lines are written
    as they come; a checkpoint holds the number of frames it stands for and the states of odometry and front
    end after the last of them. What follows the checkpoint in the log is done again.

    Attributes
    ----------
    identity : what the run is, from its first line.
    motions : motions known; frames : frames that need not be done again; state : after those frames.
    """

    def __init__(
        self, folder: Path, identity: dict[str, Any], motions: list[Motion], state: State, length: int
    ):
        self.folder = folder
        self.identity = identity
        self.motions = motions
        self.state = state
        self.frames = len(motions) + 1 if state else 0
        try:
            self._file = os.open(folder / LOG, os.O_WRONLY | os.O_APPEND | getattr(os, "O_BINARY", 0))
            os.truncate(self._file, length)
        except OSError as error:
            raise DataError(f"cannot be written: {error.strerror}", folder / LOG) from None

    @classmethod
    def start(cls, folder: Path, identity: dict[str, Any]) -> RunLog:
        """A new log; an old one is thrown away."""
        discard(folder)
        text = json.dumps(identity) + "\n"
        write_text_atomic(folder / LOG, text)
        return cls(folder, json.loads(text), [], {}, len(text))

    @classmethod
    def find(cls, folder: Path) -> RunLog | None:
        """The log left in a folder, up to its last checkpoint; None where there is none that can be read."""
        try:
            lines = (folder / LOG).read_bytes().splitlines(keepends=True)
            identity = json.loads(lines[0])
            if not isinstance(identity, dict):
                raise ValueError
        except (OSError, ValueError, IndexError):
            return None
        try:
            state = unpack_arrays((folder / CHECKPOINT).read_bytes())
            count = int(state.pop("frames")) - 1
            motions = [_motion_from(json.loads(line)) for line in lines[1 : count + 1]]
            if len(motions) != count:
                raise ValueError
        except (OSError, ValueError, KeyError, TypeError):
            # No checkpoint yet, or the disk lost something: from the first frame.
            return cls(folder, identity, [], {}, len(lines[0]))
        return cls(folder, identity, motions, state, sum(map(len, lines[: count + 1])))

    def append(self, motion: Motion) -> None:
        """Write the motion into the next frame."""
        data = memoryview(json.dumps(_motion_to(motion)).encode() + b"\n")
        try:
            while data:
                data = data[os.write(self._file, data) :]
        except OSError as error:
            raise DataError(f"cannot be written: {error.strerror}", self.folder / LOG) from None
        self.motions.append(motion)

    def checkpoint(self, state: State) -> None:
        """Keep the state after the frames logged so far."""
        try:
            os.fsync(self._file)
        except OSError as error:
            raise DataError(f"cannot be written: {error.strerror}", self.folder / LOG) from None
        frames = len(self.motions) + 1
        write_bytes_atomic(self.folder / CHECKPOINT, pack_arrays({"frames": np.array(frames), **state}))
        self.frames = frames

    def close(self) -> None:
        """Close the log; it stays in the folder."""
        os.close(self._file)


def discard(folder: Path) -> None:
    """Remove log and checkpoint, the log first: a checkpoint without a log means nothing."""
    for name in (LOG, CHECKPOINT):
        try:
            (folder / name).unlink(missing_ok=True)
        except OSError as error:
            raise DataError(f"cannot be removed: {error.strerror}", folder / name) from None


def logged_frames(folder: Path) -> int | None:
    """Frames logged in a folder where a run is in progress, for a progress bar; None where none is."""
    try:
        return (folder / LOG).read_bytes().count(b"\n")
    except OSError:
        return None


def _motion_to(motion: Motion) -> dict[str, Any]:
    """Plain values for JSON, whose numbers come back to the last bit; None for NaN."""
    plain: dict[str, Any] = {}
    for item in dataclasses.fields(motion):
        value = getattr(motion, item.name)
        if isinstance(value, np.ndarray):
            value = value.tolist()
        plain[item.name] = None if isinstance(value, float) and math.isnan(value) else value
    return plain


def _motion_from(plain: dict[str, Any]) -> Motion:
    hints = typing.get_type_hints(Motion)
    values: dict[str, Any] = {}
    for name, value in plain.items():
        if hints[name] is float and value is None:
            value = math.nan
        elif typing.get_origin(hints[name]) is tuple:
            value = tuple(value)
        elif typing.get_origin(hints[name]) is np.ndarray:
            value = np.array(value)
        values[name] = value
    return Motion(**values)
