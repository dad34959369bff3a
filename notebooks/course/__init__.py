"""Code of the notebooks: a folder per chapter (panel, figures, exercises), and shared modules.

`panel` has the base class of all panels, and `controls` makes controls from declared settings. `frames` has
frames and their matches. `drawing` has the style of the pictures. `progress` has threads for work of more
than a second. `checker` checks answers to exercises, and `keep` saves answers that passed.
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
