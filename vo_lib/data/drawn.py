"""The kit's cache folder, and the drawn scenes in it: folders in KITTI's layout.

A missing scene is drawn by `vo_street`, a package of its own in data_scripts. A scene has

image_0/000000.png image_1/000000.png calib.txt times.txt poses.txt labels/000000.txt
truth/scene.json truth/objects.npz truth/instance/000000.png
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import cv2
import numpy as np
import platformdirs

from ..errors import DataError
from ..geometry.types import Progress
from ..settings import to_dict
from .scene_files import is_drawn
from .scenes import SCENES, SceneConfig, scene_config

# Increase with every change of the images: scenes in the cache are then drawn again.
RENDERER_VERSION = 2
KIT = "stereo-vo-kit"
MARKER = "cache_of_the_kit.txt"  # shows that the kit has made the cache folder, so it may empty it


def cache_folder(cache: Path | None = None) -> Path:
    """The kit's own cache folder, with a folder for each kind of file that the kit stores.

    It is `stereo-vo-kit` in the folder `cache`, or by default in the user's cache folder.
    """
    if cache is None:
        return platformdirs.user_cache_path(KIT, appauthor=False)
    return Path(cache) / KIT


def make_cache_folder(folder: Path) -> None:
    """Create the folder for a kind of files in the kit's cache; a cache that is empty gets the marker.

    Raises `DataError` if the cache cannot be written.
    """
    cache = folder.parent
    try:
        cache.mkdir(parents=True, exist_ok=True)
        if not any(cache.iterdir()):
            (cache / MARKER).write_text("`vo data clean_cache` deletes what is beside this file.\n")
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise DataError(f"the cache cannot be written: {error.strerror}", folder) from None


def cache_sizes(cache: Path | None = None) -> dict[str, int]:
    """Bytes in each folder of the kit's cache, by name, without what lies behind links."""
    folder = cache_folder(cache)
    folders = [path for path in sorted(folder.glob("*")) if path.is_dir() and not path.is_symlink()]
    return {
        path.name: sum(file.lstat().st_size for file in path.rglob("*") if file.is_file()) for path in folders
    }


def scenes_folder(cache: Path | None = None) -> Path:
    """The folder of drawn scenes, by default in the user's cache."""
    return cache_folder(cache) / "synthetic"


def scene_key(config: SceneConfig) -> str:
    """The name of a scene's folder, from the settings and the versions of the renderer and the libraries.

    It begins with the scene's name, or with "street" if none of the named scenes has these settings.
    """
    inputs = {
        "config": to_dict(config),
        "renderer": RENDERER_VERSION,
        "numpy": np.__version__,
        "opencv": cv2.__version__,
    }
    digest = hashlib.sha256(json.dumps(inputs, sort_keys=True).encode()).hexdigest()[:12]
    names = [name for name, scene in SCENES.items() if scene == config]
    name = names[0] if names else "street"
    return f"{name}-{digest}"


def scene_folder(config: SceneConfig, cache: Path | None = None) -> Path:
    """The path of a scene's folder, by default in the user's cache; drawing the scene creates the folder."""
    return scenes_folder(cache).absolute() / scene_key(config)


def ensure_scene(
    name_or_config: str | SceneConfig,
    cache: Path | None = None,
    progress: Progress | None = None,
    jobs: int = 2,
    frames: range | None = None,
) -> Path:
    """The folder of a scene with this name or these settings; a scene that is not in the cache is drawn.

    Parameters
    ----------
    cache : folder with the kit's cache folder; default the user's.
    jobs : number of processes that draw; the images do not depend on this number.
    frames : if the complete scene is not in the cache, draw only these frames, in a separate folder.

    Raises `DataError` if the scene is unknown or the cache is not writable.
    """
    config = name_or_config if isinstance(name_or_config, SceneConfig) else scene_config(name_or_config)
    folder = scene_folder(config, cache)
    if frames is not None and not is_drawn(folder):
        folder = folder.with_name(f"{folder.name}-{frames.start}-{frames.stop}")
    if is_drawn(folder):
        return folder
    from vo_street.cache import draw_scene  # here, since vo_street imports this package

    make_cache_folder(folder.parent)
    draw_scene(config, folder, progress, jobs, frames)
    return folder


def scene_frames(config: SceneConfig) -> int:
    """The number of frames of a scene with these settings, which need not be drawn."""
    from vo_street.route import frame_count  # here, since vo_street imports this package

    return frame_count(config)
