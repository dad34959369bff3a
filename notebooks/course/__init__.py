"""What the notebooks import: a folder a chapter (panel, figures, exercises), and what chapters share.

`panel` has the pattern of all panels; `controls` makes controls from declared settings. Frames and their
matches come from `frames`, the look of pictures from `drawing`, threads for work of more than a second from
`progress`; `checker` judges exercises, `keep` keeps functions that passed.
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
