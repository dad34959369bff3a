"""A scene as a folder in KITTI's layout, drawn once and kept in the user's cache.

image_0/000000.png image_1/000000.png calib.txt times.txt poses.txt labels/000000.txt truth/ manifest.json
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import tempfile
import time
import zlib
from pathlib import Path

import cv2
import numpy as np
import platformdirs

from ..core.errors import DataError
from ..core.files import read_json
from ..core.settings import to_dict
from ..core.types import Progress
from .folder import write_scene
from .scenes import SCENES, SceneConfig, scene_config

# Raised with every change that alters a picture: old cached scenes are then drawn anew.
RENDERER_VERSION = 2
MANIFEST = "manifest.json"
ABANDONED = 6 * 3600.0  # seconds after which a half-written scene is thrown away


def cache_folder() -> Path:
    """Where scenes are kept unless told otherwise."""
    return platformdirs.user_cache_path("stereo-vo-kit", appauthor=False) / "synthetic"


def scene_key(config: SceneConfig) -> str:
    """A name for the bytes that these settings give with this renderer and these libraries."""
    everything = {
        "config": to_dict(config),
        "renderer": RENDERER_VERSION,
        "numpy": np.__version__,
        "opencv": cv2.__version__,
    }
    digest = hashlib.sha256(json.dumps(everything, sort_keys=True).encode()).hexdigest()[:12]
    name = next((name for name, known in SCENES.items() if known == config), "street")
    return f"{name}-{digest}"


def ensure_scene(
    name_or_config: str | SceneConfig,
    cache: Path | None = None,
    progress: Progress | None = None,
    jobs: int = 2,
    frames: range | None = None,
) -> Path:
    """The folder of a scene; draws it unless it lies complete in the cache.

    Parameters
    ----------
    name_or_config : a name from `SCENES`, or settings of your own.
    cache : folder that holds the scenes; default the user's cache folder.
    progress : called with (frames done, frames) while drawing.
    jobs : processes that draw. The pictures do not depend on it.
    frames : draw no others where the whole scene is not there: a part in a folder of its own.

    Raises
    ------
    DataError : no such scene, or the cache cannot be written.
    """
    config = name_or_config if isinstance(name_or_config, SceneConfig) else scene_config(name_or_config)
    parent = cache_folder() if cache is None else Path(cache)
    folder = parent / scene_key(config)
    if is_complete(folder):
        return folder
    if frames is not None:
        folder = parent / f"{folder.name}-{frames.start}-{frames.stop}"
        if is_complete(folder):
            return folder
    try:
        parent.mkdir(parents=True, exist_ok=True)
        _sweep(parent, folder.name)
        draft = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=parent))
    except OSError as error:
        raise DataError(f"the cache cannot be written: {error.strerror}", parent) from None
    try:
        write_scene(config, draft, progress, jobs, frames)
        _write_manifest(draft)
        _publish(draft, folder)
    except OSError as error:
        raise DataError(f"the cache cannot be written: {error.strerror}", parent) from None
    finally:
        shutil.rmtree(draft, ignore_errors=True)
    return folder


def is_complete(folder: Path) -> bool:
    """Whether every file that the manifest names is there with the size and checksum it had.

    The manifest is written last: only a file that is younger needs to be read for its checksum.
    """
    try:
        manifest = folder / MANIFEST
        finished = manifest.stat().st_mtime_ns
        files = read_json(manifest, {str: [int]}, "a list of files")
        return all(_unchanged(folder / name, expected, finished) for name, expected in files.items())
    except (OSError, DataError, ValueError, IndexError):
        return False


def _unchanged(path: Path, expected: list[int], finished: int) -> bool:
    now = path.stat()
    if now.st_mtime_ns <= finished:
        return now.st_size == expected[0]
    return _fingerprint(path) == expected


def _write_manifest(folder: Path) -> None:
    """List every file with its size and checksum; the last file written, so that it stands for the end."""
    names = sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file())
    manifest = {name: _fingerprint(folder / name) for name in names}
    (folder / MANIFEST).write_text(json.dumps(manifest, indent=0) + "\n")


def _fingerprint(path: Path) -> list[int]:
    """Size and checksum of a file."""
    data = path.read_bytes()
    return [len(data), zlib.crc32(data)]


def _publish(draft: Path, folder: Path) -> None:
    """Give a finished scene its name; of two drawn at the same time one stays."""
    for _ in range(5):
        try:
            os.rename(draft, folder)
            return
        except OSError:
            if is_complete(folder):
                return
            broken = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
            try:
                os.rename(folder, broken / "broken")
            except OSError:
                time.sleep(0.05)  # another process is about to put its own there
            shutil.rmtree(broken, ignore_errors=True)
    raise DataError("the finished scene cannot take its place; is the folder in use?", folder)


def _sweep(parent: Path, name: str) -> None:
    """Throw away what a process that was killed left half written."""
    for left in parent.glob(f".{name}.*"):
        if time.time() - left.stat().st_mtime > ABANDONED:
            shutil.rmtree(left, ignore_errors=True)
