"""What decides a result, as short digests: images, labels, code, versions of the libraries."""

from __future__ import annotations

import ast
import functools
import hashlib
import os
import platform
import subprocess
import threading
from importlib import metadata
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from .errors import DataError
from .sequence import Sequence
from .settings import to_dict

PACKAGE = Path(__file__).resolve().parent
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


_PARSING = threading.Lock()


@functools.lru_cache
def code_digest(*modules: str) -> str:
    """Digest of the sources of modules of the kit, "front_end", and of all that they import from it."""
    seen: dict[Path, bytes] = {}
    waiting = [PACKAGE / f"{name}.py" for name in modules]
    while waiting:
        path = waiting.pop()
        if path in seen:
            continue
        seen[path] = path.read_bytes()
        waiting += _imported(path, seen[path])
    digest = hashlib.sha256()
    for path in sorted(seen):
        digest.update(path.relative_to(PACKAGE).as_posix().encode() + b"\n" + seen[path])
    return digest.hexdigest()[:DIGITS]


def _imported(path: Path, source: bytes) -> list[Path]:
    """Files of the kit that a file imports, by relative imports as everywhere in the kit."""
    found = []
    # Python 3.11 may fail where two threads parse at once ("AST constructor recursion depth mismatch").
    with _PARSING:
        tree = ast.parse(source)
    for node in ast.walk(tree):
        if not isinstance(node, ast.ImportFrom) or node.level == 0:
            continue
        base = path.parents[node.level - 1]
        names = [node.module] if node.module else [alias.name for alias in node.names]
        for name in names:
            target = base.joinpath(*name.split("."))
            found += [p for p in (target.with_suffix(".py"), target / "__init__.py") if p.is_file()]
    return found


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
        "made_with": versions() | {"code": code_digest("front_end", "odometry")},
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
