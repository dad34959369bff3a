"""Stereo visual odometry by solution selection, with features on vehicles removed.

>>> from vo_lib import open_sequence, preset, run
>>> result = run(open_sequence("kitti/07"), preset("feature_selection"))  # doctest: +SKIP
>>> result.poses  # (N, 4, 4) poses of the left camera  # doctest: +SKIP
"""

import os
from importlib import import_module

# ONNX Runtime sends its maker reports on its use, unless this is set before it starts.
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")

TYPE_CHECKING = False  # typing's own would cost time before Ctrl-C is answered
if TYPE_CHECKING:
    from .config import METHODS, Config, preset
    from .core.errors import DataError
    from .data.sequence import Sequence, available, open_sequence
    from .runs.runner import Run, run

__all__ = ["METHODS", "Config", "DataError", "Run", "Sequence", "available", "open_sequence", "preset", "run"]

# Read when they are wanted: the `vo` command answers Ctrl-C before the second of imports.
_PLACES = {
    **dict.fromkeys(("METHODS", "Config", "preset"), "config"),
    "DataError": "core.errors",
    **dict.fromkeys(("Sequence", "available", "open_sequence"), "data.sequence"),
    **dict.fromkeys(("Run", "run"), "runs.runner"),
}


def __getattr__(name: str) -> object:
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_PLACES[name]}"), name)


def __dir__() -> list[str]:
    return [*globals(), *__all__]
