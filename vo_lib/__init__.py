"""Stereo visual odometry by solution selection, with features on vehicles removed.

>>> from vo_lib import open_sequence, preset, run
>>> result = run(open_sequence("kitti/07"), preset("feature_selection"))  # doctest: +SKIP
>>> result.poses  # (N, 4, 4) poses of the left camera  # doctest: +SKIP

Where to begin: `paper` is the paper's method, and its `odometry.py` names the seven steps of a frame and the
three additions to the paper. Beside it, a run as published needs `geometry`, the settings, reading and
writing of files, `data`, and the loop over the frames in `runs/drive.py`. Everything else serves that core,
and can stay unread until it is needed: the additions of variant `kit`, `detection`, `evaluation`, `report`,
`loops` and `commands`.

Chapters in docstrings are those of the course (notebooks 01 to 09), and sections are those of the paper.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from .errors import DataError

if TYPE_CHECKING:
    from .config import METHODS, preset
    from .data.catalogue import available, open_sequence
    from .data.sequence import Sequence
    from .runs.drive import Run, run

__all__ = ["METHODS", "DataError", "Run", "Sequence", "available", "open_sequence", "preset", "run"]
# These modules are imported when one of their names is first used: `vo --help` needs none of them.
_MODULES = {
    "config": ("METHODS", "preset"),
    "data.catalogue": ("available", "open_sequence"),
    "data.sequence": ("Sequence",),
    "runs.drive": ("Run", "run"),
}


def __getattr__(name: str) -> object:
    for module, names in _MODULES.items():
        if name in names:
            return getattr(import_module(f"{__name__}.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
