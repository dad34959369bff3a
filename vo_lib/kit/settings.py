"""Thresholds of the variant `kit`; `paper.settings` has the thresholds that both variants share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ..paper.settings import (
    ESSENTIAL,
    PRIOR,
    FilterConfig,
    ImageBorder,
    MethodConfig,
    SelectionConfig,
    StereoLimits,
    TranslationLimits,
)
from ..settings import Checked, section, setting

# Conditions under which a setting is used: the values that other settings then have.
MOVING_RULE = {"filter.rule": ("moving",)}
REMOVAL_RULES = {"filter.rule": ("all", "moving", "truth")}
REFINED_MODE = ESSENTIAL | {"selection.mode": ("refined",)}
CALIBRATION_ESTIMATED = {"calibration.estimate": (True,)}


@dataclass(frozen=True)
class KitFeatureConfig(ImageBorder):
    """Corners for Lucas-Kanade tracking, instead of the paper's blobs and corners (chapter 1)."""

    cell: int = setting(18, "side of the squares with at most one corner each", unit="px", low=10, high=100)
    quality: float = setting(
        3.0,
        "smallest contrast of a corner; a higher value gives fewer, more reliable corners",
        unit="grey levels",
        low=0,
        high=50,
    )


@dataclass(frozen=True)
class KitMatchingConfig(StereoLimits):
    """Matching by Lucas-Kanade with windows that follow the surface (chapter 1)."""

    window: int = setting(9, "side of the Lucas-Kanade window", unit="px", low=5, high=41)
    levels: int = setting(1, "pyramid levels above the image, with a predicted position", low=0, high=5)
    search_levels: int = setting(4, "pyramid levels without a predicted position", low=0, high=6)
    surface_share: float = setting(
        0.6, "smallest share of a feature's neighbours on the same surface", low=0, high=1
    )
    surface_tolerance: float = setting(
        0.7, "largest disparity difference between a feature and its surface", unit="px", low=0.05, high=10
    )
    max_difference: float = setting(
        20.0, "largest mean difference between matched windows", unit="grey levels", low=1, high=255
    )
    without: tuple[str, ...] = setting(
        (),
        "parts of the front end that are turned off, to measure what they do; without tracking, the paper's "
        "matcher is used",
        choices=(
            "tracking",  # all of it
            "prediction",  # of positions, by the last motion
            "second-search",  # after a predicted search that failed
            "equal-exposure",  # of the images of the second search
            "stereo-warp",  # of windows from the left to the right image
            "motion-warp",  # of windows from the previous to the current image
            "stereo-fit",  # sub-pixel refinement from the left to the right image
            "motion-fit",  # sub-pixel refinement from the previous to the current image
            "brightness",  # equal in the two windows that are compared
        ),
    )


@dataclass(frozen=True)
class MovingConfig(Checked):
    """The test whether the vehicle in a box moves (chapter 5, not in the paper)."""

    noise: float = setting(
        0.2, "standard deviation of a matched position", unit="px", low=0.01, high=5, when=MOVING_RULE
    )
    significance: float = setting(
        4.0, "smallest displacement of a moving box, in standard deviations", low=1, high=50, when=MOVING_RULE
    )
    min_step: float = setting(
        0.05, "smallest displacement of a moving box in one frame", unit="m", low=0, high=5, when=MOVING_RULE
    )
    agreement: float = setting(
        2.0,
        "largest residual of a static feature in a box, in standard deviations of a match",
        low=0.1,
        high=1000,
        when=MOVING_RULE,
    )
    without: tuple[str, ...] = setting(
        (),
        "parts of the test that are turned off, to measure what they do",
        choices=("moving-mean",),  # the mean that starts from the features that disagree with the background
        when=MOVING_RULE,
    )


@dataclass(frozen=True)
class KitFilterConfig(FilterConfig):
    """Removal of features in vehicle boxes (chapter 5)."""

    rule: str = setting("all", "boxes whose features are removed", choices=("none", "all", "moving", "truth"))
    min_matches: int = setting(
        12,
        "smallest number of remaining matches; with fewer, all matches are kept",
        low=0,
        high=10000,
        when=REMOVAL_RULES,
    )
    moving: MovingConfig = section(MovingConfig)


@dataclass(frozen=True)
class KitSelectionConfig(SelectionConfig):
    """Refinement of the winner, and rejection of the prior (chapter 3)."""

    mode: str = setting(
        "refined",
        "literal: unchanged winner; refined: fit to its inliers",
        choices=("literal", "refined"),
        when=ESSENTIAL,
    )
    refine_scale: float = setting(
        1.5,
        "residual at which the refinement halves a match's weight, in standard deviations",
        low=0.5,
        high=100,
        when=REFINED_MODE,
    )
    clean_sets: int = setting(
        50,
        "expected number of sets without an outlier; no more sets are drawn than should give it",
        low=1,
        high=1_000_000,
        when=REFINED_MODE,
    )
    prior_rejection_ratio: float = setting(
        1.25,
        "largest ratio of the prior's best error to the smallest error; if larger, the prior is dropped",
        low=1,
        high=1000,
        when=PRIOR,
    )


@dataclass(frozen=True)
class KitTranslationConfig(TranslationLimits):
    """The translation by robust, weighted least squares (chapter 4)."""

    scale: float = setting(
        0.5, "residual at which a feature's weight is halved", unit="px", low=0.05, high=20, when=ESSENTIAL
    )
    iterations: int = setting(6, "largest number of robust re-weightings", low=1, high=50, when=ESSENTIAL)
    agreement: float = setting(
        2.0,
        "largest norm of the residuals of an inlier's eight equations",
        unit="px",
        low=0.1,
        high=50,
        when=ESSENTIAL,
    )
    without: tuple[str, ...] = setting(
        (),
        "parts that are turned off, to measure what they do; without robust-solution, the paper's "
        "pseudo-inverse of two stereo pairs is used",
        choices=("robust-solution", "robust-start"),
        when=ESSENTIAL,
    )


@dataclass(frozen=True)
class CalibrationConfig(Checked):
    """Calibration errors that remain in calib.txt, estimated during the run (not in the paper)."""

    estimate: bool = setting(
        True, "estimate the calibration errors during the run; off: keep the initial errors"
    )
    scale: float = setting(
        0.5,
        "residual at which a feature's weight is halved",
        unit="px",
        low=0.05,
        high=20,
        when=CALIBRATION_ESTIMATED,
    )
    row_scale: float = setting(
        0.2,
        "row difference at which a match's weight is halved",
        unit="px",
        low=0.01,
        high=10,
        when=CALIBRATION_ESTIMATED,
    )
    drift: float = setting(
        0.015,
        "standard deviation of the change of an error per frame, as a share of the initial deviation",
        low=0,
        high=1,
        when=CALIBRATION_ESTIMATED,
    )
    noise_inflation: float = setting(
        2.5,
        "factor on the assumed noise when calibration errors are estimated",
        low=1,
        high=100,
        when=CALIBRATION_ESTIMATED,
    )
    without: tuple[str, ...] = setting(
        (),
        "parts that are turned off, to measure what they do: groups of errors that are held at zero, the "
        "measurement of row differences, or the shrinking of the estimate",
        choices=(
            "field",  # of disparities and rows
            "field-shape",  # all of the field but its two constants
            "undistortion",  # the field's terms that no fault of the rig explains
            "focal-length",  # different in the two cameras
            "lens",  # equal in the two cameras
            "rows",  # the measurement of row differences, and with it the drift
            "shrinking",  # of the estimate
        ),
    )


@dataclass(frozen=True)
class KitConfig(MethodConfig):
    """Settings that, with the images, determine a run of the variant `kit`."""

    variant: ClassVar[str] = "kit"

    features: KitFeatureConfig = section(KitFeatureConfig)
    matching: KitMatchingConfig = section(KitMatchingConfig)
    filter: KitFilterConfig = section(KitFilterConfig)
    selection: KitSelectionConfig = section(KitSelectionConfig)
    translation: KitTranslationConfig = section(KitTranslationConfig)
    calibration: CalibrationConfig = section(CalibrationConfig)
