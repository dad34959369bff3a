"""Stereo visual odometry by solution selection, with features on vehicles removed.

>>> from vo_lib import open_sequence, preset, run
>>> result = run(open_sequence("kitti/07"), preset("feature_selection"))  # doctest: +SKIP
>>> result.poses  # (N, 4, 4) poses of the left camera  # doctest: +SKIP
"""

from .config import METHODS, Config, preset
from .core.errors import DataError
from .data.sequence import Sequence, available, open_sequence
from .runs.runner import Run, run

__all__ = ["METHODS", "Config", "DataError", "Run", "Sequence", "available", "open_sequence", "preset", "run"]
