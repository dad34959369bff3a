"""The identity of a result: short digests of images, labels and code, settings, and library versions."""

from __future__ import annotations

import ast
import functools
import hashlib
import json
import os
import platform
import subprocess
from collections.abc import Iterable
from contextlib import suppress
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from ..data.drawn import cache_folder
from ..data.sequence import Sequence
from ..errors import DataError
from ..files import file_sha256, read_bytes, read_mapping, write_atomic
from ..paper.settings import MethodConfig
from ..settings import to_dict

if TYPE_CHECKING:
    from ..kit.calibration import Calibration

PACKAGE = Path(__file__).resolve().parents[1]
DIGEST_DIGITS = 16
NOT_USED = "not used"
# Entry modules of the code of matches and of poses; the modules that they import at top level belong to the
# code.
FRONT_END_CODE = {"published": ("runs.front_end",), "kit": ("runs.front_end", "kit.klt")}
POSE_CODE = {
    "published": ("runs.drive",),
    "kit": ("runs.drive", "kit.kit_odometry", "kit.klt", "data.truth"),
}


@functools.cache
def code_digest(modules: tuple[str, ...]) -> str:
    """Digest of modules (such as "runs.drive") and of the modules of vo_lib that they import at top level."""
    paths = import_closure(modules)
    names = [path.relative_to(PACKAGE).as_posix().encode() for path in paths]
    return _digest(
        b"".join(name + b"\n" + path.read_bytes() for name, path in zip(names, paths, strict=True))
    )


def import_closure(modules: Iterable[str]) -> tuple[Path, ...]:
    """Sorted files of `modules` and of all modules of vo_lib that these files import at top level."""
    waiting, files = [PACKAGE.joinpath(*name.split(".")).with_suffix(".py") for name in modules], set[Path]()
    while waiting:
        path = waiting.pop()
        if path in files or not path.exists():
            continue
        files.add(path)
        for node in ast.parse(path.read_bytes()).body:
            if isinstance(node, ast.ImportFrom) and node.level:
                folder = path.parents[node.level - 1].joinpath(*(node.module or "").split("."))
                waiting += [folder.with_suffix(".py"), *(folder / f"{name.name}.py" for name in node.names)]
    return tuple(sorted(files))


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:DIGEST_DIGITS]


def images_digest(sequence: Sequence) -> str:
    """Digest of the names and contents of all images.

    Each image is hashed once. A JSON file per folder of images, in the user's cache folder, stores the hashes
    with name, size and time of the image as key.
    """
    folder = sequence.folder.resolve()
    names = [f"{side}/{frame}.png" for side in sequence.sides for frame in sequence.frames]
    try:
        stats = [(folder / name).stat() for name in names]
    except OSError as error:
        raise DataError(f"the image cannot be read: {error.strerror}", error.filename) from None
    stamps = [f"{name} {stat.st_size} {stat.st_mtime_ns}" for name, stat in zip(names, stats, strict=True)]
    hash_file = hash_folder() / f"{_digest(os.fsencode(folder))}.json"
    hashes = _read_hashes(hash_file)
    if new := {stamp: name for stamp, name in zip(stamps, names, strict=True) if stamp not in hashes}:
        hashes |= {stamp: file_sha256(folder / name) for stamp, name in new.items()}
        with suppress(OSError, DataError):
            hash_file.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(hash_file, json.dumps(_read_hashes(hash_file) | hashes))
    lines = [f"{name} {hashes[stamp]}\n" for name, stamp in zip(names, stamps, strict=True)]
    return _digest("".join(lines).encode())


def hash_folder() -> Path:
    """The folder of the stored hashes of images."""
    return cache_folder().parent / "hashes"


def _read_hashes(path: Path) -> dict[str, str]:
    """The stored hashes of images (key: name, size and time); empty without a valid file of hashes."""
    with suppress(DataError):
        return read_mapping(path, "hashes")
    return {}


def labels_digest(sequence: Sequence) -> str:
    """Digest of the label files of the sequence's frames; without label files, of an empty text."""
    files = [] if sequence.labels is None else [sequence.labels / f"{frame}.txt" for frame in sequence.frames]
    return _digest_of_data(files)


def _digest_of_data(files: list[Path]) -> str:
    """Digest of the stems and contents of the existing files."""
    return _digest(b"".join(f"{path.stem} ".encode() + read_bytes(path) for path in files if path.exists()))


def truth_digest(sequence: Sequence) -> str:
    """Digest of the sequence's truth about moving vehicles, which the box rule `truth` reads."""
    folder = sequence.folder / "truth"
    files = [folder / "objects.npz", *(folder / "instance" / f"{frame}.png" for frame in sequence.frames)]
    return _digest_of_data(files)


def library_versions() -> dict[str, str]:
    """Versions of the kit and of the libraries that can change a result."""
    return {"kit": metadata.version("stereo-vo-kit"), "numpy": np.__version__, "opencv": cv2.__version__}


def matches_identity(sequence: Sequence, config: MethodConfig) -> dict[str, Any]:
    """All inputs of the matches of a sequence; the sequence is identified by its images, not by its name."""
    return {
        "variant": config.variant,
        "frames": [sequence.frames[0], sequence.frames[-1]],
        "camera": to_dict(sequence.camera),
        "images": images_digest(sequence),
        "settings": {"features": to_dict(config.features), "matching": to_dict(config.matching)},
        "made_with": library_versions() | {"code": code_digest(FRONT_END_CODE[config.variant])},
    }


def run_identity(
    sequence: Sequence, config: MethodConfig, method: str, calibration: Calibration | None = None
) -> dict[str, Any]:
    """All inputs that determine the poses of a run, and names of method and sequence, in types of JSON.

    Runs with equal identities have byte-identical poses.
    """
    identity = {"method": method, "variant": config.variant, "sequence": sequence.name}
    identity |= matches_identity(sequence, config) | {
        "settings": to_dict(config),
        "times": _digest(sequence.times.tobytes()),
        "labels": NOT_USED if config.filter.rule == "none" else labels_digest(sequence),
        "masks": _digest(b"".join(map(read_bytes, sequence.mask_files()))),
        "moving": truth_digest(sequence) if config.filter.rule == "truth" else NOT_USED,
        "calibration": calibration and _digest(calibration.to_json().encode()),
        "made_with": library_versions() | {"code": code_digest(POSE_CODE[config.variant])},
    }
    return dict(json.loads(json.dumps(identity)))


def machine_info() -> dict[str, str | None]:
    """Facts for the reader that do not change a result: commit, Python version, machine."""
    return {
        "commit": git_commit(),
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.machine()}",
    }


def git_commit() -> str | None:
    """Commit of the kit's work tree, with "-dirty" after local changes; None outside git."""
    if not (PACKAGE.parent / ".git").exists():
        return None
    describe = "describe --always --dirty --abbrev=40 --exclude=*"
    words = ["git", "-C", str(PACKAGE.parent), *describe.split()]
    with suppress(OSError, subprocess.SubprocessError):
        return subprocess.check_output(words, text=True, stderr=subprocess.DEVNULL).strip()
    return None
