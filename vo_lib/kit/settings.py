"""Thresholds of the kit's own way, each declared once; those shared with the paper: `paper.settings`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ..paper.settings import (
    FilterConfig,
    ImageBorder,
    MethodConfig,
    SelectionConfig,
    StereoLimits,
    TranslationLimits,
)
from ..settings import Checked, section, setting


@dataclass(frozen=True)
class KitFeatureConfig(ImageBorder):
    """Corners for Lucas-Kanade, beside the paper's blobs and corners (chapter 1)."""

    cell: int = setting(18, "at most one corner in each square of this size", unit="px", low=10, high=100)
    quality: float = setting(
        3.0, "weakest contrast of a corner; higher: fewer, safer corners", unit="grey levels", low=0, high=50
    )


@dataclass(frozen=True)
class KitMatchingConfig(StereoLimits):
    """Matching by Lucas-Kanade with bent windows (chapter 1)."""

    window: int = setting(9, "side of the Lucas-Kanade window", unit="px", low=5, high=41)
    levels: int = setting(1, "pyramid levels above the image where a prediction exists", low=0, high=5)
    search_levels: int = setting(4, "pyramid levels where there is no prediction", low=0, high=6)
    surface_share: float = setting(
        0.6, "share of a feature's surroundings that must lie on its surface", low=0, high=1
    )
    surface_tolerance: float = setting(
        0.7, "largest distance of a feature's disparity from its surface", unit="px", low=0.05, high=10
    )
    max_difference: float = setting(
        20.0, "largest mean difference of matched windows", unit="grey levels", low=1, high=255
    )


@dataclass(frozen=True)
class MovingConfig(Checked):
    """The judgement whether the vehicle in a box moves (chapter 5, beyond the paper)."""

    noise: float = setting(0.2, "standard deviation of a match", unit="px", low=0.01, high=5)
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
class KitFilterConfig(FilterConfig):
    """Removal of features in vehicle boxes (chapter 5)."""

    rule: str = setting(
        "all", "which boxes remove their features", choices=("none", "all", "moving", "truth")
    )
    min_matches: int = setting(
        12, "with fewer matches left the filter is off for the frame", low=0, high=10000
    )
    moving: MovingConfig = section(MovingConfig)


@dataclass(frozen=True)
class KitSelectionConfig(SelectionConfig):
    """Refinement of the winner, and when the prior is dropped (chapter 3)."""

    mode: str = setting(
        "refined", "take the winner as it is, or refine it on its inliers", choices=("literal", "refined")
    )
    refine_scale: float = setting(
        1.5, "residual that halves a match's weight when refined, in standard deviations", low=0.5, high=100
    )
    prior_rejection_ratio: float = setting(
        1.25, "drop the prior when its best candidate is so many times worse than the best", low=1, high=1000
    )


@dataclass(frozen=True)
class KitTranslationConfig(TranslationLimits):
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


@dataclass(frozen=True)
class VehicleConfig(Checked):
    """Limits of a vehicle's motion; the fastest of KITTI's cars has half of each turn and tilt."""

    check: bool = setting(True, "flag what no car does; off for a camera that is carried or flies")
    speed_change: float = setting(
        30.0, "largest change of velocity, in any direction", unit="m/s²", low=1, high=1e4
    )
    turn_rate: float = setting(90.0, "fastest turn to the left or right", unit="deg/s", low=1, high=1e4)
    tilt_rate: float = setting(40.0, "fastest pitch and roll", unit="deg/s", low=1, high=1e4)


@dataclass(frozen=True)
class KitConfig(MethodConfig):
    """Everything that decides a run of the kit's own way, with the images."""

    variant: ClassVar[str] = "kit"

    features: KitFeatureConfig = section(KitFeatureConfig)
    matching: KitMatchingConfig = section(KitMatchingConfig)
    filter: KitFilterConfig = section(KitFilterConfig)
    selection: KitSelectionConfig = section(KitSelectionConfig)
    translation: KitTranslationConfig = section(KitTranslationConfig)
    calibration: CalibrationConfig = section(CalibrationConfig)
    vehicle: VehicleConfig = section(VehicleConfig)
