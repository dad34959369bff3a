"""Every threshold of the method, declared once, and the named presets of the paper's Table 1."""

from __future__ import annotations

import dataclasses
import difflib
from dataclasses import dataclass

from .core.errors import DataError
from .core.settings import Checked, section, setting


@dataclass(frozen=True)
class FeatureConfig(Checked):
    """Corner detection (chapter 1)."""

    cell: int = setting(18, "at most one corner in each square of this size", unit="px", low=10, high=100)
    quality: float = setting(
        3.0,
        "smallest corner strength, as contrast; higher: fewer, safer corners",
        unit="grey levels",
        low=0,
        high=50,
    )
    border: int = setting(8, "no corners this close to the image border", unit="px", low=2, high=100)
    blob_cell: int = setting(
        19,
        "blob_corner: side of the square of which a blob or corner is the extremum",
        unit="px",
        low=3,
        high=101,
    )
    blob_quality: float = setting(
        50.0, "blob_corner: smallest response of the 5×5 masks", unit="grey levels", low=0, high=2000
    )


@dataclass(frozen=True)
class MatchingConfig(Checked):
    """Matching round the loop of four images (chapter 1)."""

    front_end: str = setting("klt", "how features are found and followed", choices=("klt", "blob_corner"))
    window: int = setting(9, "side of the Lucas-Kanade window", unit="px", low=5, high=41)
    levels: int = setting(1, "pyramid levels above the image where a prediction exists", low=0, high=5)
    search_levels: int = setting(4, "pyramid levels where there is no prediction", low=0, high=6)
    finish_window: int = setting(
        11, "side of the bent window of the sub-pixel finish, odd", unit="px", low=5, high=41
    )
    surface_share: float = setting(
        0.6, "share of a feature's surroundings that must lie on its surface", low=0, high=1
    )
    surface_tolerance: float = setting(
        0.7, "largest distance of a feature's disparity from its surface", unit="px", low=0.05, high=10
    )
    loop_tolerance: float = setting(
        0.35, "largest distance between the two ways round the loop", unit="px", low=0.05, high=10
    )
    row_tolerance: float = setting(
        1.0, "largest row difference in a stereo pair", unit="px", low=0.05, high=10
    )
    min_disparity: float = setting(
        0.5, "smallest disparity; far points say little", unit="px", low=0.05, high=50
    )
    max_disparity: int = setting(
        160, "largest disparity searched in a new stereo pair", unit="px", low=16, high=512
    )
    max_difference: float = setting(
        20.0, "largest mean difference of matched windows", unit="grey levels", low=1, high=255
    )


@dataclass(frozen=True)
class BucketConfig(Checked):
    """Feature selection: equal squares, older features first, then stronger ones (chapter 1)."""

    size: int = setting(50, "side of a bucket", unit="px", low=10, high=500)
    features: int = setting(3, "features kept in a bucket", low=1, high=100)


@dataclass(frozen=True)
class MovingConfig(Checked):
    """The judgement whether the vehicle in a box moves (chapter 5, beyond the paper)."""

    noise: float = setting(
        0.2,
        "smallest standard deviation of a match; more where the street shows more",
        unit="px",
        low=0.01,
        high=5,
    )
    motion_error: float = setting(
        0.01, "standard deviation of the camera's step from features outside boxes", unit="m", low=0, high=1
    )
    turn_error: float = setting(
        0.01, "standard deviation of the camera's rotation", unit="deg", low=0, high=1
    )
    heights: tuple[float, ...] = setting(
        (2.3, 4.2, 4.2),
        "tallest vehicle of each of the classes; what is farther than such a one in its box is background",
        unit="m",
        low=0.5,
        high=10,
    )
    min_matches: int = setting(3, "a box with fewer matches is judged by its history", low=1, high=100)
    min_street: int = setting(
        30, "with fewer features outside boxes those in parked boxes join them", low=5, high=1000
    )
    moved_share: float = setting(
        0.3, "share of a box's matches that must move together; the rest may be background", low=0, high=1
    )
    overlap: float = setting(
        0.3, "a box is known again above this overlap (IoU) with its place expected", low=0.01, high=1
    )
    patience: int = setting(3, "frames for which a track waits for its box to be seen again", low=0, high=100)
    memory: float = setting(
        0.7, "share of a track's evidence that is kept from frame to frame", low=0, high=0.99
    )
    significance: float = setting(
        4.0, "a box moves when its step is this many standard deviations from none", low=1, high=50
    )
    min_step: float = setting(
        0.05, "a box moves when its step between two frames is longer than this", unit="m", low=0, high=5
    )
    unknown: str = setting(
        "keep", "what happens to features in boxes of which too little is known", choices=("keep", "remove")
    )
    agreement: float = setting(
        2.0,
        "a feature in any box must agree with the street within this many standard deviations",
        low=0.1,
        high=1000,
    )


@dataclass(frozen=True)
class FilterConfig(Checked):
    """Removal of features in vehicle boxes (chapter 5)."""

    rule: str = setting(
        "all", "which boxes remove their features", choices=("none", "all", "moving", "truth")
    )
    margin: float = setting(0.0, "a box grows by this share of its size on every side", low=-0.4, high=1.0)
    classes: tuple[int, ...] = setting(
        (2, 5, 7), "class ids of vehicles (COCO: car 2, bus 5, truck 7)", low=0
    )
    score: float = setting(
        0.25, "boxes scored lower are ignored; a label without score counts as 1", low=0, high=1
    )
    min_matches: int = setting(
        60, "with fewer matches left the filter is off for the frame", low=0, high=10000
    )
    min_share: float = setting(
        0.3, "with a smaller share left the filter is off for the frame", low=0, high=1
    )
    moving: MovingConfig = section(MovingConfig)


@dataclass(frozen=True)
class SelectionConfig(Checked):
    """The rotation: five-point sets, solution selection, refinement (chapters 2 and 3)."""

    sets: int = setting(200, "five-point sets drawn in a frame (n of the paper)", low=1, high=5000)
    prior: bool = setting(True, "choose by nearness to the previous essential vector; off: consensus alone")
    keep: int = setting(
        2, "solutions of a set kept by nearness to the previous one (k of the paper)", low=1, high=10
    )
    mode: str = setting(
        "refined", "take the winner as it is, or refine it on its inliers", choices=("literal", "refined")
    )
    threshold: float = setting(
        1.0, "a match is an inlier below this Sampson distance", unit="px", low=0.05, high=10
    )
    refine_scale: float = setting(
        1.5,
        "residual at which the refinement halves a match's weight, in standard deviations of the residuals; "
        "never above half the threshold",
        low=0.5,
        high=100,
    )
    standstill_flow: float = setting(
        0.5, "below this median flow the essential matrix is undefined", unit="px", low=0, high=5
    )
    rest_flow: float = setting(
        0.05, "below this median flow, under a millimetre a frame, the camera rests", unit="px", low=0, high=5
    )
    turn_ratio: float = setting(
        1.25,
        "drop the prior when its best candidate scores worse than the best of all by this factor",
        low=1,
        high=1000,
    )


@dataclass(frozen=True)
class TranslationConfig(Checked):
    """The translation by linear least squares, equations (2) and (3) (chapter 4)."""

    variant: str = setting(
        "stacked",
        "all features stacked, weighted and robust: the method; the others are for comparison",
        choices=("stacked", "unweighted", "feature_median", "feature_mean"),
    )
    scale: float = setting(
        0.5, "pixel residual at which a feature's weight is halved", unit="px", low=0.05, high=20
    )
    iterations: int = setting(6, "largest number of robust re-weightings", low=1, high=50)
    max_depth: float = setting(100.0, "features farther away are not used", unit="m", low=5, high=1000)
    agreement: float = setting(
        2.0, "a feature agrees with the motion where its rows leave less", unit="px", low=0.1, high=50
    )


@dataclass(frozen=True)
class ReprojectionConfig(Checked):
    """The VISO2 estimator: three matches a trial, Gauss-Newton on the reprojection error (StereoScan)."""

    trials: int = setting(200, "motions from three random matches in a frame", low=1, high=5000)
    threshold: float = setting(
        2.0,
        "a match is an inlier below this residual norm over its four current coordinates",
        unit="px",
        low=0.05,
        high=20,
    )
    iterations: int = setting(20, "largest number of Gauss-Newton steps", low=1, high=100)
    centre: float = setting(
        0.05,
        "a residual weighs 1 / (|u - cu| / |cu| + this): smaller, the middle counts more",
        low=1e-3,
        high=100,
    )


@dataclass(frozen=True)
class CalibrationConfig(Checked):
    """What is left of an imperfect rectification, found on the way (not in the paper)."""

    estimate: bool = setting(True, "learn rows, disparities and principal point; off: all is taken as it is")
    row_deviation: float = setting(
        3.0,
        "standard deviation of each coefficient of the rows before the first frame",
        unit="px",
        low=0.001,
        high=100,
    )
    row_scale: float = setting(
        0.2, "difference of rows at which a match's weight is halved", unit="px", low=0.01, high=10
    )
    row_memory: float = setting(
        1000.0, "what was learnt of the rows this long ago counts a third", unit="frames", low=10, high=1e6
    )
    centre_deviation: float = setting(
        8.0,
        "standard deviation of the principal point before the first frame, along u and v each; more than "
        "three times this is not believed",
        unit="px",
        low=0.001,
        high=100,
    )
    centre_scale: float = setting(
        3.0,
        "Sampson distance at which a match's weight for the principal point is a quarter, in standard "
        "deviations of the distances",
        low=0.5,
        high=100,
    )
    centre_caution: float = setting(
        1.5,
        "the principal point is learnt as if frames scattered this much more than noise",
        low=1,
        high=1000,
    )
    centre_floor: float = setting(
        2.0,
        "standard deviation of what is learnt of the principal point that no number of frames mends",
        unit="px",
        low=0,
        high=100,
    )
    flow_stretch: float = setting(
        0.05,
        "standard deviation of a flow that is too long along u and too short along v, in all frames alike",
        unit="px",
        low=0.0001,
        high=10,
    )
    initial_deviation: float = setting(
        1.0,
        "standard deviation of the disparity error before the first frame, the offset and the bow each",
        unit="px",
        low=0,
        high=10,
    )
    drift: float = setting(
        0.01,
        "standard deviation of the offset's change from frame to frame, ten times the bow's",
        unit="px",
        low=0,
        high=1,
    )
    caution: float = setting(
        4.0, "a frame's estimate is trusted as if it scattered this much more than noise", low=1, high=100
    )
    scale: float = setting(
        0.5, "pixel residual at which a feature's weight is halved", unit="px", low=0.05, high=20
    )
    least_change: float = setting(
        0.03, "a smaller change of the disparities does not solve the step again", unit="px", low=0, high=1
    )


@dataclass(frozen=True)
class DetectorConfig(Checked):
    """Vehicle boxes from a YOLO network (chapter 5). They decide a run only through the boxes they give."""

    size: int = setting(
        0,
        "longer side of the network's image, where the model leaves it open; 0: the one it was made for",
        unit="px",
        low=0,
        high=4096,
    )
    score: float = setting(0.25, "boxes scored lower are not reported", low=0.001, high=1)
    nms: float = setting(
        0.5, "of two boxes of one class that overlap more (IoU) the better stays", low=0.05, high=1
    )
    classes: tuple[str, ...] = setting(
        ("car", "bus", "truck"), "classes reported, by name or COCO number; none given: every class"
    )
    threads: int = setting(1, "processor threads of the network", low=1, high=64)


@dataclass(frozen=True)
class Config(Checked):
    """Everything that decides a run's result, with the images."""

    seed: int = setting(0, "seed of the random five-point sets", low=0)
    min_matches: int = setting(
        12, "with fewer matches the frame goes on with the last motion", low=5, high=1000
    )
    estimator: str = setting(
        "essential",
        "rotation from the essential matrix, then the translation; or both from the reprojection error",
        choices=("essential", "reprojection"),
    )
    features: FeatureConfig = section(FeatureConfig)
    matching: MatchingConfig = section(MatchingConfig)
    buckets: BucketConfig = section(BucketConfig)
    filter: FilterConfig = section(FilterConfig)
    selection: SelectionConfig = section(SelectionConfig)
    translation: TranslationConfig = section(TranslationConfig)
    reprojection: ReprojectionConfig = section(ReprojectionConfig)
    calibration: CalibrationConfig = section(CalibrationConfig)


def _method(prior: bool, rule: str) -> Config:
    return Config(selection=SelectionConfig(prior=prior), filter=FilterConfig(rule=rule))


METHODS: dict[str, Config] = {
    "viso2": Config(
        estimator="reprojection", buckets=BucketConfig(features=2), filter=FilterConfig(rule="none")
    ),
    "mesvo_f": _method(prior=False, rule="none"),
    "solution_selection": _method(prior=True, rule="none"),
    "feature_selection": _method(prior=True, rule="all"),
    "moving_selection": _method(prior=True, rule="moving"),
}


def preset(method: str, *, mode: str | None = None, seed: int | None = None) -> Config:
    """The configuration of a method of Table 1, optionally `literal` or `refined`, with a seed.

    Raises `DataError` for an unknown name, with the nearest known one.
    """
    if method not in METHODS:
        near = difflib.get_close_matches(method, METHODS, n=1, cutoff=0.3)
        hint = f"did you mean {near[0]}? " if near else ""
        raise DataError(f"unknown method {method!r}: {hint}the methods are {', '.join(METHODS)}")
    config = METHODS[method]
    if mode is not None:
        config = dataclasses.replace(config, selection=dataclasses.replace(config.selection, mode=mode))
    return config if seed is None else dataclasses.replace(config, seed=seed)
