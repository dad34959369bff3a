"""Thresholds of the systems of Table 1, with default, unit, range and one sentence each.

The paper gives three of these numbers: buckets of 50×50 (from earlier work; we read them as pixels), k = 2
solutions kept per five-point set, and three frames for the translation. Of the other numbers, those of VISO2
follow StereoScan, and the rest are ours.

There are two variants of the systems: `published` is the method of the paper, and `kit` is the method with
our additions, from the package `vo_lib.kit`. `PublishedConfig`, and its sections `FeatureConfig`,
`MatchingConfig` and `TranslationConfig`, are settings of `published` alone; other code makes such a section
only to run a part of the paper's method. The settings in all other classes are those of both variants: `kit`
uses some of these classes as they are, and derives its own from the others.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ..geometry.boxes import VEHICLES
from ..settings import Checked, section, setting

# Conditions under which a setting is used: the values that other settings then have.
ESSENTIAL = {"estimator": ("essential",)}
REPROJECTION = {"estimator": ("reprojection",)}
PRIOR = ESSENTIAL | {"selection.prior": (True,)}
BOXES = {"filter.rule": ("all", "moving")}  # the rule `moving` is one of variant `kit`


@dataclass(frozen=True)
class ImageBorder(Checked):
    """The part of an image without features (chapter 1)."""

    border: int = setting(
        8, "width of the image border without features (published: at least 6)", unit="px", low=2, high=100
    )


@dataclass(frozen=True)
class FeatureConfig(ImageBorder):
    """Blobs and corners of an image (chapter 1)."""

    blob_cell: int = setting(
        19, "side of the square in which a blob or corner is the extremum", unit="px", low=3, high=101
    )
    blob_quality: float = setting(
        50.0, "response of the 5×5 masks that a blob or corner exceeds", unit="grey levels", low=0, high=2000
    )


@dataclass(frozen=True)
class StereoLimits(Checked):
    """Conditions for a match in four images (chapter 1)."""

    max_disparity: int = setting(
        160, "largest disparity searched in a stereo pair", unit="px", low=16, high=512
    )
    subpixel_window: int = setting(
        11, "side of the window for the sub-pixel refinement, an odd number", unit="px", low=5, high=41
    )
    loop_tolerance: float = setting(
        0.35,
        "largest distance between the two refined positions in the current right image",
        unit="px",
        low=0.05,
        high=10,
    )
    row_tolerance: float = setting(
        1.0,
        "largest row difference in a stereo pair, after the sub-pixel refinement",
        unit="px",
        low=0.05,
        high=10,
    )
    min_disparity: float = setting(
        0.5, "smallest disparity; a smaller disparity gives an uncertain depth", unit="px", low=0.05, high=50
    )


@dataclass(frozen=True)
class MatchingConfig(StereoLimits):
    """Matching in a loop through four images (chapter 1)."""

    search_radius: int = setting(
        120, "radius of the search around a feature's previous position", unit="px", low=5, high=1000
    )


@dataclass(frozen=True)
class BucketConfig(Checked):
    """Bucketing: the oldest features of each square; of equally old features, the strongest (chapter 1)."""

    size: int = setting(50, "side of a bucket", unit="px", low=10, high=500)
    features: int = setting(3, "features kept per bucket", low=1, high=100)


@dataclass(frozen=True)
class FilterConfig(Checked):
    """Removal of features in vehicle boxes (chapter 5)."""

    rule: str = setting("all", "boxes whose features are removed", choices=("none", "all"))
    margin: float = setting(
        0.0, "margin added to a box on every side, as a share of its size", low=-0.4, high=1.0, when=BOXES
    )
    classes: tuple[str, ...] = setting(
        (VEHICLES,),
        "classes of the boxes that count, names or numbers of the label folder or model; the word vehicles "
        "stands for cars, buses and trucks, by name or, without class names, by COCO's numbers 2, 5 and 7",
        when=BOXES,
    )
    score: float = setting(
        0.25, "smallest score of a box; a label without a score has the score 1", low=0, high=1, when=BOXES
    )

    @property
    def uses_boxes(self) -> bool:
        """Whether the rule needs boxes; `none`, and `truth` of variant `kit`, do not."""
        return self.rule in BOXES["filter.rule"]


@dataclass(frozen=True)
class SelectionConfig(Checked):
    """The rotation: five-point sets and solution selection (chapters 2 and 3)."""

    sets: int = setting(
        200, "five-point sets drawn per frame (n and N of the paper)", low=1, high=5000, when=ESSENTIAL
    )
    winner: str = setting(
        "error",
        "criterion of the best candidate: truncated Sampson error, or number of inliers as in RANSAC",
        choices=("error", "inliers"),
        when=ESSENTIAL,
    )
    prior: bool = setting(
        True,
        "select among the solutions nearest to the previous essential vector; off: among all solutions",
        when=ESSENTIAL,
    )
    top_k: int = setting(
        2,
        "solutions kept per five-point set, the nearest to the previous E (k of the paper)",
        low=1,
        high=10,
        when=PRIOR,
    )
    threshold: float = setting(
        0.5,
        "largest Sampson distance of an inlier; the error of a match does not grow beyond it",
        unit="px",
        low=0.05,
        high=10,
        when=ESSENTIAL,
    )
    standstill_flow: float = setting(
        0.5,
        "smallest median optical flow of a moving camera; with less, it stands still, and the motion is the "
        "identity or, with VISO2, what is measured",
        unit="px",
        low=0,
        high=5,
    )


@dataclass(frozen=True)
class TranslationLimits(Checked):
    """Features that the translation uses (chapter 4)."""

    max_depth: float = setting(
        100.0, "largest depth of a feature that is used", unit="m", low=5, high=1000, when=ESSENTIAL
    )
    agreement: float = setting(
        1.0,
        "largest norm of the residuals of an inlier's eight equations; with twelve, √(9/5) times as large",
        unit="px",
        low=0.1,
        high=50,
        when=ESSENTIAL,
    )

    @property
    def pairs(self) -> int:
        """Stereo pairs in a feature's equations: two, as in (3), unless a class has a setting for it.

        `TranslationConfig` replaces it by a setting, and variant `kit` does not read it. So no run uses this
        2: it only lets `Odometry.translate` read `pairs` in every `MethodConfig`.
        """
        return 2


@dataclass(frozen=True)
class TranslationConfig(TranslationLimits):
    """The translation by the pseudo-inverse, equations (2) and (3) (chapter 4)."""

    pairs: int = setting(
        3,
        "stereo pairs in a feature's equations: 2 as in equation (3), or 3 for features that were also "
        "matched one frame earlier",
        low=2,
        high=3,
        when=ESSENTIAL,
    )


@dataclass(frozen=True)
class ReprojectionConfig(Checked):
    """The VISO2 estimator: three matches per trial, Gauss-Newton on the reprojection error (StereoScan)."""

    trials: int = setting(
        200, "trial motions per frame, each from three random matches", low=1, high=5000, when=REPROJECTION
    )
    threshold: float = setting(
        2.0,
        "largest norm of an inlier's residuals in its four current coordinates",
        unit="px",
        low=0.05,
        high=20,
        when=REPROJECTION,
    )
    iterations: int = setting(20, "largest number of Gauss-Newton steps", low=1, high=100, when=REPROJECTION)
    centre: float = setting(
        0.05,
        "c in the weight 1 / (|u - cx| / |cx| + c) of a residual; a small c favours the image centre",
        low=1e-3,
        high=100,
        when=REPROJECTION,
    )


@dataclass(frozen=True)
class MethodConfig(Checked):
    """Settings of a system of Table 1, in the sections that both variants have."""

    variant: ClassVar[str]

    seed: int = setting(0, "seed of the random five-point sets or, with VISO2, of its random matches", low=0)
    min_matches: int = setting(
        12,
        "smallest number of matches, and of inliers; with fewer, the previous motion is repeated",
        low=5,
        high=1000,
    )
    stereo_limit: float = setting(
        1.5,
        "median reprojection error up to which a motion counts as right without a check; with little noise "
        "in the matches, the limit in use is smaller. A larger error is compared with that of a fit to the "
        "stereo depths; the motion is flagged if the fit's error is much smaller, or itself too large",
        unit="px",
        low=0,
        high=1000,
        when=ESSENTIAL,
    )
    features: ImageBorder = section(ImageBorder)
    matching: StereoLimits = section(StereoLimits)
    buckets: BucketConfig = section(BucketConfig)
    filter: FilterConfig = section(FilterConfig)
    selection: SelectionConfig = section(SelectionConfig)
    translation: TranslationLimits = section(TranslationLimits)
    estimator: str = setting(
        "essential",
        "essential: rotation from the essential matrix, then translation; reprojection: one fit of both",
        choices=("essential", "reprojection"),
    )
    reprojection: ReprojectionConfig = section(ReprojectionConfig)


@dataclass(frozen=True)
class PublishedConfig(MethodConfig):
    """Settings that, with the images, determine a run of the variant `published`."""

    variant: ClassVar[str] = "published"

    features: FeatureConfig = section(FeatureConfig)
    matching: MatchingConfig = section(MatchingConfig)
    translation: TranslationConfig = section(TranslationConfig)
