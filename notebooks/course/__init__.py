"""Code of the notebooks: a folder per chapter (panel, figures, exercises), and shared modules.

`panel` has the base class of all panels; `controls` makes controls from declared settings. Frames and their
matches are in `frames`, the style of pictures is in `drawing`, threads for work of more than a second are in
`progress`; `checker` judges exercises, `keep` saves answers that passed.
"""

from .drawing import figure, finish, show, show_source, stack
from .frames import frame_matches, frame_points, has_truth, load, real_pair, stereo, truth

__all__ = [
    "figure",
    "finish",
    "frame_matches",
    "frame_points",
    "has_truth",
    "load",
    "real_pair",
    "show",
    "show_source",
    "stack",
    "stereo",
    "truth",
]
