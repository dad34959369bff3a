"""The files of a drawn scene, and how its folder is told from one that has only files of the reader."""

from __future__ import annotations

import re
from pathlib import Path

from ..files import DRAFT_NAME

# What a scene's folder has. The settings are the mark of a complete scene; readers may add other files.
SCENE_FILE = Path("truth", "scene.json")
SCENE_FOLDERS = ("image_0", "image_1", "labels", "truth", "truth/depth", "truth/instance")
SCENE_FILES = re.compile(
    r"(calib|times|poses)\.txt|(image_[01]|truth/depth|truth/instance)/[0-9]{6}\.png|labels/[0-9]{6}\.txt"
    r"|truth/(scene\.json|objects\.npz)"
)


def is_drawn(folder: Path) -> bool:
    """Whether a folder has a complete scene, and not just what `vo data clean_cache` has left of one."""
    return (folder / SCENE_FILE).is_file()


def has_other_labels(folder: Path) -> bool:
    """Whether the folder `labels` of a scene is a link, or has files of another program or of a detector."""
    labels = folder / "labels"
    if labels.is_symlink():
        return True
    if not labels.is_dir():
        return False
    names = [f"labels/{path.name}" for path in labels.iterdir() if DRAFT_NAME.fullmatch(path.name) is None]
    return not all(SCENE_FILES.fullmatch(name) for name in names)
