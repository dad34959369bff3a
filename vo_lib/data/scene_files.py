"""The file by which a drawn scene is known."""

from __future__ import annotations

from pathlib import Path

SCENE_FILE = Path("truth", "scene.json")  # the settings of the scene


def is_drawn(folder: Path) -> bool:
    """Whether a folder has a drawn scene."""
    return (folder / SCENE_FILE).is_file()
