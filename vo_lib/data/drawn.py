"""Drawn scenes in the user's cache, folders in KITTI's layout; a missing scene is drawn by `vo_street`.

image_0/000000.png image_1/000000.png calib.txt times.txt poses.txt labels/000000.txt truth/
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
from .scenes import SCENES, SceneConfig, scene_config

# Raised with every change that alters a picture: old cached scenes are then drawn anew.
RENDERER_VERSION = 2


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
    name = next((name for name, scene in SCENES.items() if scene == config), "street")
    return f"{name}-{digest}"


def scene_folder(config: SceneConfig, cache: Path | None = None) -> Path:
    """Where a scene is kept in the cache, by default the user's; it is there only when it is complete."""
    return (cache_folder() if cache is None else Path(cache)).absolute() / scene_key(config)


def ensure_scene(
    name_or_config: str | SceneConfig,
    cache: Path | None = None,
    progress: Progress | None = None,
    jobs: int = 2,
    frames: range | None = None,
) -> Path:
    """The folder of a scene, named or by its settings; drawn unless it is in the cache.

    Parameters
    ----------
    cache : folder that holds the scenes; default the user's cache folder.
    jobs : processes that draw. The pictures do not depend on it.
    frames : draw no others where the whole scene is not there: a part in a folder of its own.

    Raises `DataError`: no such scene, the cache cannot be written, or the kit is not used from its folder.
    """
    config = name_or_config if isinstance(name_or_config, SceneConfig) else scene_config(name_or_config)
    folder = scene_folder(config, cache)
    if frames is not None and not folder.is_dir():
        folder = folder.with_name(f"{folder.name}-{frames.start}-{frames.stop}")
    if folder.is_dir():
        return folder
    try:
        from vo_street.cache import draw_scene
    except ImportError:
        raise DataError("drawing a street needs the kit's folder: install it from there with -e .") from None
    draw_scene(config, folder, progress, jobs, frames)
    return folder
