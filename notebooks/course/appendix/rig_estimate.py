"""Appendix: a rig with given faults, its estimate by variant `kit`, and the lengths of the steps."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from vo_lib.errors import DataError
from vo_lib.geometry.camera import StereoCamera
from vo_lib.geometry.matches import StereoMatches
from vo_lib.geometry.motion import rigid
from vo_lib.geometry.types import Array
from vo_lib.kit.rig import DISPARITY_TERMS, ERROR_COUNT, ERROR_NAMES, RIG_FAULTS, Rig
from vo_lib.kit.settings import CalibrationConfig, KitTranslationConfig
from vo_lib.kit.weighted_translation import robust_translation
from vo_lib.paper.settings import TranslationConfig
from vo_lib.paper.translation import PairBefore, solve_translation

from ..simulation.tracks import SimulatedFrame

# Approximate faults of the rig in sequence 01 of KITTI: sizes of `RIG_FAULTS`, pixels.
KITTI_01 = {
    "shift along the rows": -0.6,
    "roll": -0.3,
    "tilt about the vertical": 0.5,
    "decentering along the rows": 6.3,
    "columns, y²": 0.0,
    "columns, x⁴": -3.5,
}
# The estimated terms of the disparity error, by the words in the control of the panel.
TERMS = {"all": DISPARITY_TERMS, "1 and x²": ("1", "x²"), "1 alone": ("1",)}
LAST = 15  # frames at the end of a drive, whose step lengths are evaluated
REST = 0.05  # metres; shorter steps are not evaluated


class Learnt(NamedTuple):
    """The estimated rig, and the ratios of step lengths to true step lengths, by name, a frame each (N,).

    The names are "as measured" and "corrected"; a ratio is NaN if the camera rests.
    """

    rig: Rig
    ratios: dict[str, Array]


def errors_of_rig(faults: dict[str, float]) -> Array:
    """Errors (ERROR_COUNT,), pixels, of a rig with perfect lenses and `RIG_FAULTS` of the given sizes."""
    errors = np.zeros(ERROR_COUNT)
    for fault, size in faults.items():
        columns, rows, _ = RIG_FAULTS[fault]
        for kind, shape in (("disparity", columns), ("row", rows)):
            for term, factor in shape.items():
                errors[ERROR_NAMES.index(f"{kind} {term}")] += size * factor
    return errors


# The disparity error, pixels, that fits KITTI's drives of three days alike.
_DRIVES = {"x²": 0.8, "xy": 0.8, "y²": 6.3, "x²y": 1.5, "x⁴": -4.0}
_DRIVES_FAULTS = {"shift along the rows": -0.2} | {f"columns, {term}": px for term, px in _DRIVES.items()}
DRIVES_ERRORS = errors_of_rig(_DRIVES_FAULTS)


def learn(
    camera: StereoCamera, tracks: list[SimulatedFrame], true: Array, terms: tuple[str, ...] = DISPARITY_TERMS
) -> Learnt:
    """What the kit learns from matches with the errors `true` (ERROR_COUNT,).

    It learns the row terms, and the disparity terms in `terms`.
    """
    *_, last = learn_by_frame(camera, tracks, true, terms)
    return last()


def learn_by_frame(
    camera: StereoCamera, tracks: list[SimulatedFrame], true: Array, terms: tuple[str, ...] = DISPARITY_TERMS
) -> Iterator[Callable[[], Learnt]]:
    """As `learn`; yields after each frame a function that returns the result so far.

    The result is valid until the next frame; the ratios of later frames are NaN.
    """
    learnt = Rig(camera, CalibrationConfig(drift=0.0))
    if terms != DISPARITY_TERMS:
        # Disparity terms that are not learnt: their variance is made so small that they stay at zero.
        free = np.ones(ERROR_COUNT, bool)
        free[: len(DISPARITY_TERMS)] = np.isin(DISPARITY_TERMS, terms)
        variances = np.diag(learnt.covariance) * np.where(free, 1.0, 1e-8)
        learnt.set_estimate(learnt.estimate, np.diag(variances))
    ratios = np.full((2, len(tracks)), np.nan)

    def so_far() -> Learnt:
        return Learnt(learnt, dict(zip(("as measured", "corrected"), ratios.copy(), strict=True)))

    for number, frame in enumerate(tracks):
        R_cp = frame.T_cp[:3, :3]
        true_length = float(np.linalg.norm(frame.T_cp[:3, 3]))
        # To correct by -true is to add the errors; what is learnt plays no part.
        spoiled = learnt.correct(frame.matches, -true)
        learnt.update_from_rows(spoiled)
        better = learnt.correct(spoiled)
        t_spoiled = _translation(camera, spoiled, R_cp, default=frame.T_cp[:3, 3])
        t_better = _translation(camera, better, R_cp, default=t_spoiled)
        learnt.update(better, R_cp, t_better)
        if true_length > REST:
            ratios[0, number] = float(np.linalg.norm(t_spoiled)) / true_length
            ratios[1, number] = float(np.linalg.norm(t_better)) / true_length
        yield so_far


def _translation(camera: StereoCamera, matches: StereoMatches, R_cp: Array, default: Array) -> Array:
    """Robust translation (3,), metres, or the default without a solution."""
    solved = robust_translation(camera, matches, R_cp, KitTranslationConfig())
    return default if solved is None else solved[0]


def third_frame(
    camera: StereoCamera, tracks: list[SimulatedFrame], true: Array, config: TranslationConfig
) -> dict[str, Array]:
    """Ratios (N,) of estimated to true step lengths of variant `published`, with two and with three frames.

    `true` : errors (ERROR_COUNT,) of the rig. The rotations of the steps are true.
    """
    ratios: dict[str, list[float]] = {"two frames": [], "three frames": []}
    before: dict[str, PairBefore | None] = dict.fromkeys(ratios)
    rig = Rig(camera, CalibrationConfig())
    for frame in tracks:
        matches = rig.correct(frame.matches, -true)  # adds the errors
        R_cp = frame.T_cp[:3, :3]
        for name in ratios:
            solved = solve_translation(camera, matches, R_cp, config, before[name])
            if solved is None:
                raise DataError(
                    "a frame of these tracks gives no translation: use more points, or smaller errors"
                )
            ratios[name].append(float(np.linalg.norm(solved[0]) / np.linalg.norm(frame.T_cp[:3, 3])))
            if name == "three frames":
                before[name] = PairBefore(matches, rigid(R_cp, solved[0]))
    return {name: np.array(values) for name, values in ratios.items()}


def too_long(ratios: Array) -> float:
    """Mean excess length of the last `LAST` steps, %, from their ratios (N,) to true ones; NaN for a camera at rest."""
    judged = ratios[np.isfinite(ratios)][-LAST:]
    return 100.0 * float(np.mean(judged) - 1.0) if len(judged) else np.nan
