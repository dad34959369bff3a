"""Thresholds of what the kit adds to the paper, and all of a run's together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ..baseline.config import PublishedConfig
from ..core.settings import Checked, section, setting
from ..front_end.config import FeatureConfig, MatchingConfig
from ..method import config as method


@dataclass(frozen=True)
class MovingConfig(Checked):
    """The judgement whether the vehicle in a box moves (chapter 5, beyond the paper)."""

    noise: float = setting(
        0.2, "standard deviation of a match, or more if the background shows it", unit="px", low=0.01, high=5
    )
    significance: float = setting(
        4.0, "a box moves when its step is this many standard deviations from none", low=1, high=50
    )
    min_step: float = setting(
        0.05, "a box moves when its step between two frames is longer than this", unit="m", low=0, high=5
    )
    agreement: float = setting(
        2.0, "standard deviations by which a feature in a box may be off", low=0.1, high=1000
    )


@dataclass(frozen=True)
class FilterConfig(method.FilterConfig):
    """Removal of features in vehicle boxes (chapter 5)."""

    rule: str = setting(
        "all", "which boxes remove their features", choices=("none", "all", "moving", "truth")
    )
    min_matches: int = setting(
        60, "with fewer matches left the filter is off for the frame", low=0, high=10000
    )
    min_share: float = setting(
        0.3, "with a smaller share left the filter is off for the frame", low=0, high=1
    )
    moving: MovingConfig = section(MovingConfig)


@dataclass(frozen=True)
class SelectionConfig(method.SelectionConfig):
    """Refinement of the winner, standing still, and when the prior is dropped (chapter 3)."""

    mode: str = setting(
        "refined", "take the winner as it is, or refine it on its inliers", choices=("literal", "refined")
    )
    refine_scale: float = setting(
        1.5, "residual that halves a match's weight when refined, in standard deviations", low=0.5, high=100
    )
    rest_flow: float = setting(
        0.05, "below this median flow, under a millimetre a frame, the camera rests", unit="px", low=0, high=5
    )
    prior_rejection_ratio: float = setting(
        1.25, "drop the prior when its best candidate is so many times worse than the best", low=1, high=1000
    )


@dataclass(frozen=True)
class TranslationConfig(method.TranslationConfig):
    """The translation with weights, robust (chapter 4)."""

    scale: float = setting(
        0.5, "pixel residual at which a feature's weight is halved", unit="px", low=0.05, high=20
    )
    iterations: int = setting(6, "largest number of robust re-weightings", low=1, high=50)
    agreement: float = setting(
        2.0, "a feature agrees with the motion where its rows leave less", unit="px", low=0.1, high=50
    )


@dataclass(frozen=True)
class CalibrationConfig(Checked):
    """What calib.txt leaves of the cameras' errors, found on the way (not in the paper)."""

    estimate: bool = setting(True, "learn the rig's errors on the way; off: they stay as at the start")
    scale: float = setting(
        0.5, "pixel residual at which a feature's weight is halved", unit="px", low=0.05, high=20
    )
    row_scale: float = setting(
        0.2, "difference of rows at which a match's weight is halved", unit="px", low=0.01, high=10
    )
    drift: float = setting(
        0.015,
        "standard deviation of a fault's change from frame to frame, as a share of that before the first",
        low=0,
        high=1,
    )
    noise_inflation: float = setting(
        2.5, "errors are learnt as if frames scattered this much more than noise", low=1, high=100
    )
    least_change: float = setting(
        0.03, "a smaller change of the disparities does not solve the step again", unit="px", low=0, high=1
    )


@dataclass(frozen=True)
class Config(PublishedConfig):
    """Everything that decides a run of the kit's own way, with the images."""

    variant: ClassVar[str] = "kit"

    features: FeatureConfig = section(FeatureConfig)
    matching: MatchingConfig = section(MatchingConfig)
    filter: FilterConfig = section(FilterConfig)
    selection: SelectionConfig = section(SelectionConfig)
    translation: TranslationConfig = section(TranslationConfig)
    calibration: CalibrationConfig = section(CalibrationConfig)
