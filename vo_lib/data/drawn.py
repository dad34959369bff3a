"""Drawn scenes: folders in KITTI's layout in the user's cache.

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

from ..geometry.types import Progress
from ..settings import to_dict
from .scene_files import is_drawn
from .scenes import SCENES, SceneConfig, scene_config

# Increase with every change of the images: scenes in the cache are then drawn again.
RENDERER_VERSION = 2


def user_cache() -> Path:
    """The user's cache folder, with a folder for each kind of file that the kit stores."""
    return platformdirs.user_cache_path("stereo-vo-kit", appauthor=False)


def scenes_folder() -> Path:
    """The folder of drawn scenes in the user's cache."""
    return user_cache() / "synthetic"


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
    scenes = scenes_folder() if cache is None else Path(cache)
    return scenes.absolute() / scene_key(config)


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
    cache : folder of drawn scenes; default that in the user's cache.
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

    draw_scene(config, folder, progress, jobs, frames)
    return folder


def scene_frames(config: SceneConfig) -> int:
    """The number of frames of a scene with these settings, which need not be drawn."""
    from vo_street.route import frame_count  # here, since vo_street imports this package

    return frame_count(config)
