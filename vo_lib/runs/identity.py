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
from ..core.files import file_sha256, fits, read_bytes, read_json, write_text_atomic
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
    """Digest of the names and contents of all images; each is read once, and again when it has changed."""
    names = [f"{side}/{frame}.png" for side in ("image_0", "image_1") for frame in sequence.frames]
    hashes = content_hashes(sequence.folder, names)
    digest = hashlib.sha256("".join(f"{name} {hashes[name]}\n" for name in names).encode())
    return digest.hexdigest()[:DIGITS]


def content_hashes(folder: Path, names: list[str]) -> dict[str, str]:
    """Hash of the content of each file of a folder, by name.

    Hashes are remembered in the user's cache folder with size and times of the file, in a JSON file for each
    folder; no program can set the time of the last change of any kind (ctime). Where the file is damaged, or
    two processes wrote it at once, files are hashed again.
    """
    place = hashlib.sha256(os.fsencode(folder.resolve())).hexdigest()[:DIGITS]
    memory = cache_folder().parent / "hashes" / f"{place}.json"
    known, now = _remembered(memory), time.time_ns()
    try:
        stats = {name: (folder / name).stat() for name in names}
    except OSError as error:
        raise DataError(f"the image cannot be read: {error.strerror}", error.filename) from None
    stamps = {name: [stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns] for name, stat in stats.items()}
    changed = [name for name in names if known.get(name, [])[:3] != stamps[name]]
    with ThreadPoolExecutor(max_workers=2) as pool:
        fresh = dict(zip(changed, pool.map(file_sha256, [folder / name for name in changed]), strict=True))
    settled = {n: [*stamps[n], fresh[n]] for n in changed if max(stamps[n][1:]) < now - UNSETTLED}
    if settled:
        with suppress(OSError, DataError):
            memory.parent.mkdir(parents=True, exist_ok=True)
            write_text_atomic(memory, json.dumps(_remembered(memory) | settled))
    return {name: fresh[name] if name in fresh else known[name][3] for name in names}


def _remembered(memory: Path) -> dict[str, list[Any]]:
    """Size, time and hash of files by name; nothing where it is missing or damaged."""
    with suppress(DataError):
        known = read_json(memory, {str: [(int, str)]}, "hashes")
        return {n: entry for n, entry in known.items() if len(entry) == 4 and fits(entry[3:], [str])}
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
        path = Path(sequence.labels or "") / f"{frame}.txt"
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


def run_identity(sequence: Sequence, config: Any, method: str) -> dict[str, Any]:
    """All that decides the poses of a run, and its names; runs with equal identities give equal bytes."""
    settings = to_dict(config)
    boxes = NOT_USED if config.filter.rule == "none" else labels_digest(sequence)
    known = sequence.calibration
    return {
        "method": method,
        "variant": config.variant,
        "sequence": sequence.name,
        "frames": [sequence.frames[0], sequence.frames[-1]],
        "settings": settings,
        "camera": to_dict(sequence.camera),
        "calibration": None
        if known is None
        else hashlib.sha256(known.to_json().encode()).hexdigest()[:DIGITS],
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
