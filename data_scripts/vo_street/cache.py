"""Scenes in a cache folder, drawn under a temporary name and then renamed."""

from __future__ import annotations

import os
from pathlib import Path

from vo_lib.data.scene_files import is_drawn
from vo_lib.data.scenes import SceneConfig
from vo_lib.files import locked_draft
from vo_lib.geometry.types import Progress

from .scene_folder import write_scene


def draw_scene(
    config: SceneConfig,
    folder: Path,
    progress: Progress | None = None,
    jobs: int = 2,
    frames: range | None = None,
) -> None:
    """Draw a scene into a new folder, which appears only when complete.

    Parameters
    ----------
    progress : called with (frames done, frames) while drawing.
    jobs : number of processes; the images do not depend on this number.
    frames : the frames to draw; None draws all frames.

    Raises `DataError` if the folder cannot be written.
    """
    with locked_draft(folder) as draft:
        draft.mkdir()
        write_scene(config, draft, progress, jobs, frames)
        try:
            os.rename(draft, folder)
        except OSError:
            if not is_drawn(folder):  # else another process has drawn the same scene
                raise
