"""What decides a result, as short digests: images, labels, code, versions of the libraries."""

from __future__ import annotations

import functools
import hashlib
import json
import os
import platform
import subprocess
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from importlib import metadata
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ..core.errors import DataError
from ..core.files import file_sha256, read_bytes, read_json, write_text_atomic
from ..core.settings import to_dict
from ..data.drawn import cache_folder
from ..data.sequence import Sequence

PACKAGE = Path(__file__).resolve().parents[1]
ROOMS = ("core", "method", "front_end", "baseline", "beyond")
DIGITS = 16
NOT_USED = "not used"
# A file changed so short a time ago may change again and keep its time: file systems round it.
UNSETTLED = 2_000_000_000  # nanoseconds


def images_digest(sequence: Sequence) -> str:
    """Digest of the names and contents of all images; each is read once, and again when it has changed.

    Hashes are remembered in the user's cache folder with size and times of the file, in a JSON file for each
    folder; no program can set the time of the last change of any kind (ctime).
    """
    folder = sequence.folder
    names = [f"{side}/{frame}.png" for side in ("image_0", "image_1") for frame in sequence.frames]
    place = hashlib.sha256(os.fsencode(folder.resolve())).hexdigest()[:DIGITS]
    memory = cache_folder().parent / "hashes" / f"{place}.json"
    known, now = _remembered(memory), time.time_ns()
    try:
        stats = {name: (folder / name).stat() for name in names}
    except OSError as error:
        raise DataError(f"the image cannot be read: {error.strerror}", error.filename) from None
    stamps = {name: [stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns] for name, stat in stats.items()}
    changed = [name for name in names if known.get(name, [])[:-1] != stamps[name]]
    with ThreadPoolExecutor(max_workers=2) as pool:
        found = zip(changed, pool.map(file_sha256, [folder / name for name in changed]), strict=True)
        fresh: dict[str, list[Any]] = {name: [*stamps[name], digest] for name, digest in found}
    settled = {name: entry for name, entry in fresh.items() if max(entry[1:3]) < now - UNSETTLED}
    if settled:
        with suppress(OSError, DataError):
            memory.parent.mkdir(parents=True, exist_ok=True)
            write_text_atomic(memory, json.dumps(_remembered(memory) | settled))
    known |= fresh
    digest = hashlib.sha256("".join(f"{name} {known[name][3]}\n" for name in names).encode())
    return digest.hexdigest()[:DIGITS]


def _remembered(memory: Path) -> dict[str, list[Any]]:
    """Size, times and hash of files by name; nothing where it is missing or damaged."""
    with suppress(DataError):
        return dict(read_json(memory, {str: [(int, str)]}, "hashes"))
    return {}


def labels_digest(sequence: Sequence) -> str:
    """Digest of the label files of the sequence's frames; that of nothing where there are none.

    Of a detector that is still at work: its model and settings, which decide the labels.
    """
    known = sequence.labels_identity
    if known is not None:
        return known
    digest = hashlib.sha256()
    for frame in sequence.frames if sequence.labels is not None else ():
        path = Path(sequence.labels or "", f"{frame}.txt")
        if path.exists():
            digest.update(f"{frame} ".encode() + read_bytes(path))
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


def drive_identity(sequence: Sequence) -> dict[str, Any]:
    """What decides a result whatever is done with the images: these, their camera, the code."""
    return {
        "frames": [sequence.frames[0], sequence.frames[-1]],
        "camera": to_dict(sequence.camera),
        "images": images_digest(sequence),
        "made_with": versions() | {"code": code_digest()},
    }


def run_identity(sequence: Sequence, config: Any, method: str) -> dict[str, Any]:
    """All that decides the poses of a run, and its names, as it comes back from JSON.

    Runs with equal identities give equal bytes.
    """
    known = sequence.calibration
    identity = {"method": method, "variant": config.variant, "sequence": sequence.name}
    identity |= drive_identity(sequence) | {
        "settings": to_dict(config),
        "calibration": known and hashlib.sha256(known.to_json().encode()).hexdigest()[:DIGITS],
        "labels": NOT_USED if config.filter.rule == "none" else labels_digest(sequence),
    }
    return dict(json.loads(json.dumps(identity)))


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
    words = ["git", "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"]
    with suppress(OSError, subprocess.SubprocessError):
        return subprocess.check_output(
            words, cwd=PACKAGE.parent, text=True, stderr=subprocess.DEVNULL, timeout=20
        ).strip()
    return None
