"""Widget panels of the notebooks, one module a chapter: `ch00_start`, `ch02_five_point`, `ch03_selection`, …

`base` has the pattern and an example; `controls` makes controls from declared settings; `facts` shows
numbers. Frames and their matches come from `..frames`, the look of pictures from `..drawing`, threads for
work of more than a second from `..progress`.
`PANELS` lists every panel class: the tests drive each of them through all its controls.
"""

from ..drawing import figure, finish, show, show_source, stack
from ..frames import frame_matches, frame_points, load, stereo, truth
from .appendix_calibration import CalibrationPanel
from .base import Drawing, Panel, State
from .ch00_start import StartPanel
from .ch01_matching import MatchingPanel
from .ch02_five_point import FivePointPanel
from .ch03_selection import SelectionPanel
from .ch04_translation import TranslationPanel
from .ch05_filtering import FilteringPanel
from .ch06_evaluation import EvaluationPanel
from .ch07_explore import ExplorePanel
from .ch07_reproduce import ReproducePanel
from .controls import Control
from .facts import Fact

PANELS: tuple[type[Panel], ...] = (
    StartPanel,
    MatchingPanel,
    FivePointPanel,
    SelectionPanel,
    TranslationPanel,
    FilteringPanel,
    EvaluationPanel,
    ReproducePanel,
    ExplorePanel,
    CalibrationPanel,
)

__all__ = [
    "PANELS",
    "CalibrationPanel",
    "Control",
    "Drawing",
    "EvaluationPanel",
    "ExplorePanel",
    "Fact",
    "FilteringPanel",
    "FivePointPanel",
    "MatchingPanel",
    "Panel",
    "ReproducePanel",
    "SelectionPanel",
    "StartPanel",
    "State",
    "TranslationPanel",
    "figure",
    "finish",
    "frame_matches",
    "frame_points",
    "load",
    "show",
    "show_source",
    "stack",
    "stereo",
    "truth",
]
