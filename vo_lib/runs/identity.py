"""What decides a result, as short digests: images, labels, code, versions of the libraries."""

from __future__ import annotations

import functools
import hashlib
import os
import platform
import subprocess
from importlib import metadata
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ..core.errors import DataError
from ..core.settings import to_dict
from ..data.sequence import Sequence

PACKAGE = Path(__file__).resolve().parents[1]
ROOMS = ("core", "method", "front_end", "baseline", "beyond")
DIGITS = 16
NOT_USED = "not used"
# A PNG ends with the checksum of all pixels (4 bytes, Adler-32), that of the last chunk (4) and IEND (12).
PNG_TAIL = 20


def images_digest(sequence: Sequence) -> str:
    """Digest of the names, sizes and pixel checksums of all images; only the end of each file is read."""
    digest = hashlib.sha256()
    for side in ("image_0", "image_1"):
        for frame in sequence.frames:
            path = sequence.folder / side / f"{frame}.png"
            try:
                with open(path, "rb") as file:
                    size = file.seek(0, os.SEEK_END)
                    file.seek(max(size - PNG_TAIL, 0))
                    tail = file.read()
            except OSError as error:
                raise DataError(f"the image cannot be read: {error.strerror}", path) from None
            digest.update(f"{side}/{frame} {size} ".encode() + tail)
    return digest.hexdigest()[:DIGITS]


def labels_digest(sequence: Sequence) -> str:
    """Digest of the label files of the sequence's frames; that of nothing where there are none.

    Of a detector that is still at work: its model and settings, which decide the labels.
    """
    known = sequence.labels_identity()
    if known is not None:
        return known
    digest = hashlib.sha256()
    for frame in sequence.frames if sequence.labels is not None else ():
        path = Path(sequence.labels or "") / f"{frame}.txt"
        try:
            digest.update(f"{frame} ".encode() + path.read_bytes())
        except FileNotFoundError:
            continue
        except OSError as error:
            raise DataError(f"cannot be read: {error.strerror}", path) from None
    return digest.hexdigest()[:DIGITS]


@functools.cache
def code_digest() -> str:
    """Digest of all code that can decide a pose: any change of it makes results another's."""
    digest = hashlib.sha256()
    for path in [PACKAGE / "config.py", *sorted(p for room in ROOMS for p in (PACKAGE / room).glob("*.py"))]:
        digest.update(path.relative_to(PACKAGE).as_posix().encode() + b"\n" + path.read_bytes())
    return digest.hexdigest()[:DIGITS]


def versions() -> dict[str, str]:
    """Versions of the kit and of the libraries whose change can change a result."""
    return {
        "kit": metadata.version("stereo-vo-kit"),
        "numpy": np.__version__,
        "opencv": cv2.__version__,
    }


def run_identity(sequence: Sequence, config: Any, method: str) -> dict[str, Any]:
    """All that decides the poses of a run, and its names; runs with equal identities give equal bytes."""
    settings = to_dict(config)
    boxes = NOT_USED if config.filter.rule == "none" else labels_digest(sequence)
    return {
        "method": method,
        "sequence": sequence.name,
        "frames": [sequence.frames[0], sequence.frames[-1]],
        "settings": settings,
        "camera": to_dict(sequence.camera),
        "images": images_digest(sequence),
        "labels": boxes,
        "made_with": versions() | {"code": code_digest()},
    }


def surroundings() -> dict[str, str | None]:
    """What a result should not depend on but a person may want to know: commit, Python, machine."""
    return {
        "commit": git_commit(),
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.machine()}",
    }


def git_commit() -> str | None:
    """Commit of the kit's own work tree, "-dirty" behind it when files were changed; None outside of git."""
    if not (PACKAGE.parent / ".git").exists():
        return None
    command = ["git", "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"]
    try:
        done = subprocess.run(
            command, cwd=PACKAGE.parent, capture_output=True, text=True, check=True, timeout=20
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()
