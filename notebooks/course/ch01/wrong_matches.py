"""Chapter 1: how wrong matches are, by the truth of a drawn scene or, without it, by epipolar lines."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from vo_lib.config import preset
from vo_lib.data.sequence import Sequence
from vo_lib.data.truth import Truth
from vo_lib.geometry.matches import StereoMatches
from vo_lib.geometry.types import Array, BoolArray
from vo_lib.paper.selection import truncated_errors

from ..candidates import candidates_of
from ..frames import frame_points, scene_truth
from ..simulation.true_matches import depth, match_errors, predict

RIGHT = 1.0  # largest error of a right match, pixels
GROSS = 5.0  # an error above is no matter of accuracy: the match is another point, pixels
SETS = 200  # of five matches, for the motion that most matches agree with
SHOWN = 40.0  # largest error that a picture of the four images can show, pixels
RISE = 0.5  # no vehicle or person moves up or down by as much between two frames, metres
OUTLINE_WINDOW = 11  # side of the window that an outline crosses, pixels
OUTLINE_RATIO = 1.2  # of the largest and the smallest depth in this window


@dataclass(frozen=True, eq=False)
class ErrorMeasure:
    """The error of matches between a frame and the frame before, pixels; a call returns the errors (N,).

    In a drawn scene: the largest of the distances from the true places in the other three images; NaN where
    these are not known. Elsewhere: the distance of the current left place from its epipolar line, for the
    motion with which most matches agree (chapters 2 and 3). It misses errors along the line, and errors in the
    right images.

    Attributes
    ----------
    E : (3, 3) essential matrix of that motion. known : truth of the scene, or None.
    """

    sequence: Sequence
    frame: int
    E: Array
    known: Truth | None

    @property
    def name(self) -> str:
        """What the numbers are, for an axis."""
        return "error [px]" if self.known is not None else "distance from the epipolar line [px]"

    def __call__(self, matches: StereoMatches) -> Array:
        if self.known is None:
            return self.from_lines(matches)
        return match_errors(self.known, matches, self.frame)

    def lines(self, matches: StereoMatches) -> Array:
        """Epipolar lines a u + b v + c = 0 in the current left image, (N, 3) pixels, with a² + b² = 1."""
        camera = self.sequence.camera
        x_p = np.column_stack([camera.normalise(matches.prev_left), np.ones(len(matches))])
        lines = x_p @ self.E.T @ np.linalg.inv(camera.K)
        return np.asarray(lines / np.linalg.norm(lines[:, :2], axis=1, keepdims=True))

    def from_lines(self, matches: StereoMatches) -> Array:
        """Distances (N,) of the current left places from their epipolar lines, pixels."""
        lines = self.lines(matches)
        return np.asarray(np.abs(np.sum(lines[:, :2] * matches.cur_left, axis=1) + lines[:, 2]))

    def true_places(self, matches: StereoMatches) -> dict[str, Array]:
        """True places (N, 2) by the name of the image; empty if they are not known."""
        if self.known is None:
            return {}
        start = matches.prev_left
        _, prev_right, _ = predict(self.known, self.frame - 1, self.frame - 1, start)
        cur_left, cur_right, _ = predict(self.known, self.frame - 1, self.frame, start)
        return {"previous right": prev_right, "current right": cur_right, "current left": cur_left}

    def rises(self, matches: StereoMatches) -> Array:
        """How far each match would have moved up or down between the frames if it were right, (N,) metres.

        The rotation of the camera is undone, and a camera in a car hardly rises. From the difference of the two
        heights, what an error of one pixel in each disparity would change is subtracted: a height Y = y Z, with
        Z = f b / d, changes by |Y| / d. 0 if a disparity is not above 1 px.
        """
        camera = self.sequence.camera
        _, R_cp, _, _ = cv2.recoverPose(self.E, matches.prev_left, matches.cur_left, camera.K)
        disparities = []
        heights = []
        for left, right, R in (
            (matches.prev_left, matches.prev_right, R_cp),
            (matches.cur_left, matches.cur_right, np.eye(3)),
        ):
            disparity = left[:, 0] - right[:, 0]
            X = camera.back_project(left, np.maximum(disparity, 1.0))
            disparities.append(disparity)
            heights.append((X @ R.T)[:, 1])
        # The change of both heights together by one pixel of their disparities.
        by_a_pixel = np.sum(np.abs(heights) / np.maximum(disparities, 1.0), axis=0)
        rise = np.maximum(np.abs(heights[1] - heights[0]) - by_a_pixel, 0.0)
        return np.where(np.minimum(*disparities) > 1.0, rise, 0.0)

    def on_outline(self, matches: StereoMatches) -> BoolArray | None:
        """Mask (N,) of the matches with two depths in the window around them; None without true depths."""
        if self.known is None:
            return None
        inverse_depth = 1.0 / depth(self.known, self.frame - 1)  # 0 for the sky, whose depth is infinite
        reach = OUTLINE_WINDOW // 2
        mask = []
        for u, v in np.rint(matches.prev_left).astype(int).tolist():
            around = inverse_depth[max(v - reach, 0) : v + reach + 1, max(u - reach, 0) : u + reach + 1]
            mask.append(around.max() > OUTLINE_RATIO * around.min())
        return np.array(mask, np.bool_)


def measure_of(sequence: Sequence, frame: int) -> ErrorMeasure:
    """The measure of errors for a frame >= 1."""
    config = preset("solution_selection")
    points = frame_points(sequence, frame, config)
    E = candidates_of(points, SETS, 0).E
    limit = config.selection.threshold / sequence.camera.f
    winner = E[np.argmin(truncated_errors(E, points.x_p, points.x_c, limit))]
    return ErrorMeasure(sequence, frame, winner, scene_truth(sequence))


def count_line(name: str, error: Array) -> str:
    """A line with the number of matches, and of wrong and gross errors among those whose error is known."""
    known = error[np.isfinite(error)]
    wrong = np.count_nonzero(known > RIGHT)
    gross = np.count_nonzero(known > GROSS)
    line = f"{name}: {len(known)} matches, {wrong} above {RIGHT:g} px, {gross} above {GROSS:g} px"
    if len(known):
        line += f" = {gross / len(known):.1%}"
    unknown = len(error) - len(known)
    if unknown:
        line += f"; {unknown} more have no known error"
    return line


def strongest_wrong(
    matches: StereoMatches, error: Array, least: float = GROSS, most: float = SHOWN
) -> int | None:
    """Index of the strongest match with an error between two limits, pixels.

    Without such a match, it is that of the match with the largest error, if this is above `RIGHT`; None if no
    match is wrong.
    """
    if len(error) == 0:
        return None
    known = np.nan_to_num(error, nan=0.0)
    shown = np.flatnonzero((known > least) & (known < most))
    if len(shown):
        return int(shown[np.argmax(matches.strength[shown])])
    largest = int(np.argmax(known))
    return largest if known[largest] > RIGHT else None


def wrong_example(measure: ErrorMeasure, matches: StereoMatches) -> tuple[int | None, str]:
    """A match that is shown as wrong, or None if there is none; and what may be said about it.

    With truth: `strongest_wrong`. Without it, a match far from its line may be right on a moving thing. It is shown
    only if a thing would have to jump up or down for it.
    """
    error = measure(matches)
    if measure.known is not None:
        worst = strongest_wrong(matches, error)
        if worst is None:
            return None, f"No match here is known to be wrong by more than {RIGHT:g} px."
        return worst, (
            f"The error of this match is {error[worst]:.1f} px: it is wrong. Rings show the true places."
        )
    far = (error > GROSS) & (error < SHOWN)
    if not far.any():
        return None, (
            f"There is no truth here, and none of the {len(matches)} matches is between {GROSS:g} and {SHOWN:g} px\n"
            "away from its line. So the cell can call none of them wrong."
        )
    rise = measure.rises(matches)
    shown = np.flatnonzero(far & (rise > RISE))
    if len(shown) == 0:
        return None, (
            f"There is no truth here. {np.count_nonzero(far)} of {len(matches)} matches: between {GROSS:g} and {SHOWN:g} px "
            "away from their lines.\nEach of them may be right, on something that moves, so the cell can call none of "
            "them wrong."
        )
    worst = int(shown[np.argmax(matches.strength[shown])])
    return worst, (
        f"This match is {error[worst]:.1f} px away from the orange line. If it were right, its point would have\n"
        f"moved up or down by more than {rise[worst]:.1f} m in one frame. Nothing in a street does, so it is wrong."
    )
