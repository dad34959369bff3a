"""Stereo visual odometry by solution selection, with features on vehicles removed.

>>> from vo_lib import open_sequence, preset, run
>>> result = run(open_sequence("kitti/07"), preset("feature_selection"))  # doctest: +SKIP
>>> result.poses  # (N, 4, 4) poses of the left camera  # doctest: +SKIP

Where to begin: `paper` is the paper's method, about 2,500 lines, and its `odometry.py` names the seven
steps of a frame and the three additions to the paper. A run of `feature_selection` as published, over a
drawn street or another sequence in a folder, imports about 8,300 lines in all, and those of `paper` are
among them. The largest part is `data`, about 3,400 lines, because it reads all kinds of files that people
bring, and refuses the wrong ones. What is left of such a run is `geometry`, the settings, reading and
writing of files, and the loop over the frames in `runs/drive.py`. Everything else serves that core, and can
stay unread until it is needed: the additions of variant `kit`, `detection`, `evaluation`, `report`, `loops`
and `commands`.

Chapters in docstrings are those of the course (notebooks 01 to 09), and sections are those of the paper.
"""

import os
from importlib import import_module
from typing import TYPE_CHECKING

from .old_notebooks import watch_notebook

# This variable disables ONNX Runtime's telemetry, if it is set before the runtime is imported.
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")

watch_notebook()

if TYPE_CHECKING:
    from .config import METHODS as METHODS
    from .config import preset as preset
    from .data.catalogue import available as available
    from .data.catalogue import open_sequence as open_sequence
    from .data.sequence import Sequence as Sequence
    from .errors import DataError as DataError
    from .paper.settings import MethodConfig as MethodConfig
    from .runs.drive import Run as Run
    from .runs.drive import run as run

# The module of each public name, imported on first use: `vo --help` needs none of them.
_MODULES = {
    "METHODS": "config",
    "preset": "config",
    "available": "data.catalogue",
    "open_sequence": "data.catalogue",
    "Sequence": "data.sequence",
    "DataError": "errors",
    "MethodConfig": "paper.settings",
    "Run": "runs.drive",
    "run": "runs.drive",
}


def __getattr__(name: str) -> object:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
