"""Where downloaded data goes."""

from __future__ import annotations

import os
from pathlib import Path

import platformdirs

from .sequence import kitti_roots

PROJECT = Path(__file__).resolve().parents[2]


def kitti_root() -> Path:
    """The KITTI folder that the kit uses: the first one found, else where one would be made.

    That is KITTI_ROOT where it is set, else data/kitti of the project (of the current folder where the
    package is installed without its project).
    """
    for root in kitti_roots():
        return root
    named = os.environ.get("KITTI_ROOT", "")
    if named:
        return Path(named)
    return (PROJECT if (PROJECT / "pyproject.toml").is_file() else Path()) / "data" / "kitti"


def detector_folder() -> Path:
    """Where fetched detectors are kept unless told otherwise: the user's data folder."""
    return platformdirs.user_data_path("stereo-vo-kit", appauthor=False) / "detectors"
