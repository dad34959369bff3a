"""Drawn scenes in the user's cache: folders in KITTI's layout, each with a manifest of its files.

image_0/000000.png image_1/000000.png calib.txt times.txt poses.txt labels/000000.txt truth/ manifest.json
A scene that is not there is drawn by data_scripts/render_synthetic.py.
"""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
import zlib
from pathlib import Path

import cv2
import numpy as np
import platformdirs

from ..core.errors import DataError
from ..core.files import read_json
from ..core.settings import to_dict
from ..core.types import Progress
from .scenes import SCENES, SceneConfig, scene_config

# Raised with every change that alters a picture: old cached scenes are then drawn anew.
RENDERER_VERSION = 2
MANIFEST = "manifest.json"
SCRIPT = Path(__file__).resolve().parents[2] / "data_scripts" / "render_synthetic.py"


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


def find_scene(config: SceneConfig, parent: Path, frames: range | None = None) -> tuple[Path, bool]:
    """The folder of a scene, or of a part of it where the whole is not there, and whether it is complete."""
    folder = parent / scene_key(config)
    if frames is not None and not is_complete(folder):
        folder = parent / f"{folder.name}-{frames.start}-{frames.stop}"
    return folder, is_complete(folder)


def ensure_scene(
    name_or_config: str | SceneConfig,
    cache: Path | None = None,
    progress: Progress | None = None,
    jobs: int = 2,
    frames: range | None = None,
) -> Path:
    """The folder of a scene, named or by its settings; it is drawn unless it lies complete in the cache.

    Parameters
    ----------
    cache : folder that holds the scenes; default the user's cache folder.
    jobs : processes that draw. The pictures do not depend on it.
    frames : draw no others where the whole scene is not there: a part in a folder of its own.

    Raises `DataError`: no such scene, the cache cannot be written, or the kit is not used from its folder.
    """
    config = name_or_config if isinstance(name_or_config, SceneConfig) else scene_config(name_or_config)
    parent = (cache_folder() if cache is None else Path(cache)).absolute()
    folder, complete = find_scene(config, parent, frames)
    return folder if complete else _draw(config, parent, progress, jobs, frames)


def _draw(
    config: SceneConfig, parent: Path, progress: Progress | None, jobs: int, frames: range | None
) -> Path:
    """The folder that the script has drawn; it prints a line for each step, then the folder."""
    if not SCRIPT.is_file():
        raise DataError("drawing a street needs the kit's folder: install it from there with -e .", SCRIPT)
    base = next((name for name, known in SCENES.items() if known == config), "empty")
    start, wanted = to_dict(SCENES[base]), to_dict(config)
    words = [sys.executable, str(SCRIPT), base, "--cache", str(parent), "--jobs", str(jobs), "--count"]
    for name, value in wanted.items():
        if value != start[name]:
            words += [f"--{name.replace('_', '-')}={value}"]
    if frames is not None:
        words += ["--frames", f"{frames.start}:{frames.stop}"]
    line = ""
    pipe = subprocess.PIPE
    with subprocess.Popen(words, stdout=pipe, stderr=pipe, text=True, encoding="utf-8") as drawing:
        assert drawing.stdout is not None
        assert drawing.stderr is not None
        try:
            for line in drawing.stdout:
                done, of, total = line.partition(" of ")
                if progress and of and total.strip().isdigit():
                    progress(int(done), int(total))
            said = drawing.stderr.read().strip().rpartition("\n")[2]
        except BaseException:
            drawing.terminate()
            raise
    if drawing.returncode:
        raise DataError(said.partition(": error: ")[2] or said or "the street could not be drawn")
    return Path(line.rstrip("\n"))


def is_complete(folder: Path) -> bool:
    """Whether every file that the manifest names is there with the size and checksum it had.

    The manifest is written last: only a file that is younger needs to be read for its checksum.
    """
    try:
        manifest = folder / MANIFEST
        finished = manifest.stat().st_mtime_ns
        for name, expected in read_json(manifest, {str: [int]}, "a list of files").items():
            now = (folder / name).stat()
            younger = now.st_mtime_ns > finished
            if now.st_size != expected[0] or (younger and fingerprint(folder / name) != expected):
                return False
    except (OSError, DataError, ValueError, IndexError):
        return False
    return True


def fingerprint(path: Path) -> list[int]:
    """Size and checksum of a file."""
    data = path.read_bytes()
    return [len(data), zlib.crc32(data)]
