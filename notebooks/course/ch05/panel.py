"""Chapter 5: from a network's candidates to boxes, to the kept features, and to their effect; a lorry."""

from __future__ import annotations

import numpy as np

from vo_lib.config import preset
from vo_lib.data.truth import matches_on_moving
from vo_lib.geometry.boxes import Boxes
from vo_lib.geometry.camera import StereoCamera
from vo_lib.geometry.matches import StereoMatches, empty_matches
from vo_lib.geometry.result import Flag, FrameResult
from vo_lib.geometry.types import Array, BoolArray, Image
from vo_lib.paper.box_removal import Removal
from vo_lib.paper.buckets import select_by_bucket
from vo_lib.paper.selection import sampson_inliers
from vo_lib.runs.drive import make_odometry

from ..controls import about
from ..drawing import PHOTO_HEIGHT, WIDTH, caption, photo
from ..frames import frame_matches, scene_truth, stereo, true_motion
from ..panel import Control, Drawing, Fact, Panel, State
from ..simulation.lorry import LorryConfig, with_lorry
from .box_sources import (
    LABELS,
    MODEL_REMEDY,
    FilteringView,
    detector_of,
    frame_candidates,
    is_offered,
    no_class,
)
from .figures import candidates_picture, filter_picture
from .frame_removal import filtered_frame, motion_from

NETWORK_HEIGHT = 252  # of the picture of the candidates


class FilteringPanel(Panel):
    """A frame's candidates, boxes and features, and its motion with and without the removed features."""

    title = "From boxes to the remaining features"
    view = FilteringView
    start = preset("feature_selection")
    kit = preset("feature_selection", variant="kit")
    height = PHOTO_HEIGHT + NETWORK_HEIGHT
    controls = (
        Control("view.model", "model"),
        Control("filter.score", "score", low=0.01, high=0.99, step=0.01),
        Control("view.nms", "suppression, IoU", step=0.05),
        Control("filter.margin", step=0.05),
        Control("filter.classes"),
        Control("filter.rule", "rule"),
    )

    def idle(self, state: State) -> set[str]:
        without = set()
        if state.view.model.strip() == LABELS:
            without |= {"filter.score", "view.nms"}
        if state.config.filter.rule == "none":
            without |= {"filter.margin", "filter.classes"}
        return without

    def draw(self, state: State) -> Drawing:
        sequence = state.sequence
        frame = state.frame
        if state.view.model.strip() != LABELS:
            # Only to fail here, with the label of the control; the result stays in memory for `filtered_frame`.
            with about("model", MODEL_REMEDY):
                frame_candidates(sequence, frame, detector_of(state.view.model))
        matches = frame_matches(sequence, frame, state.config)
        result, boxes = filtered_frame(sequence, frame, state.config, state.view)
        words = f"frame {frame}, rule {state.config.filter.rule}: kept features blue, removed features orange"
        picture = filter_picture(
            stereo(sequence, frame)[0], matches, result.kept, result.boxes, result.state, words
        )

        T_true = true_motion(sequence, frame)
        every = motion_from(sequence, frame, np.ones(len(matches), np.bool_), state.config).T_cp
        kept = motion_from(sequence, frame, result.kept, state.config).T_cp
        facts = [
            Fact("removed", int(np.count_nonzero(~result.kept))),
            Fact("error, all", _apart(every, T_true), "mm", 1),
            Fact("error, kept", _apart(kept, T_true), "mm", 1),
            Fact("change of t", _apart(kept, every), "mm", 1),
        ]
        if scene_truth(sequence) is not None:
            moving = matches_on_moving(sequence, frame, matches)
            facts.append(Fact("on moving things, kept", int(np.count_nonzero(moving & result.kept))))
            facts.append(Fact("on standing things, removed", int(np.count_nonzero(~moving & ~result.kept))))
        return Drawing([picture, self._network(state, boxes)], self._sentences(state, result), tuple(facts))

    def _sentences(self, state: State, result: Removal) -> str:
        """What the rule removes, and what a reader should know about the boxes."""
        sequence = state.sequence
        model = state.view.model.strip()
        removed = int(np.count_nonzero(~result.kept))
        sentence = f"The rule removes {removed} of {len(result.kept)} features."
        if true_motion(sequence, state.frame) is None:
            sentence += " The sequence has no ground truth."
        if model == LABELS and sequence.labels is None:
            sentence += (
                " The sequence has no label folder, so there are no boxes: type `street` under *model*."
            )
        if result.state is not None and removed:
            sentence += " Orange in a parked box (dashed): features that do not agree with the background."
        sentence += no_class(sequence, state.view, state.config.filter)
        if scene_truth(sequence) is None and model == "street":
            sentence += " `street` was trained on drawn streets, not on real ones."
        if scene_truth(sequence) is None and is_offered(model):
            sentence += f" `{model}` knows only the streets that you trained it on."
        if Flag.FILTER_OFF in result.flags:
            sentence += " Too few features would be left, so the filter is off in this frame."
        return sentence

    def _network(self, state: State, boxes: Boxes) -> Image:
        """The picture of the candidates; for boxes from labels, the image alone."""
        image = stereo(state.sequence, state.frame)[0]
        if state.view.model.strip() == LABELS:
            source = "no label folder" if state.sequence.labels is None else "boxes of the label folder"
            return caption(photo(image, WIDTH, NETWORK_HEIGHT), f"{len(boxes)} boxes: {source}, no network")
        output = frame_candidates(state.sequence, state.frame, detector_of(state.view.model))
        letterbox = output.letterbox
        score = state.config.filter.score
        corners = letterbox.to_network(boxes.xyxy)
        count = int(np.count_nonzero(output.scores.max(axis=1) >= score))
        words = f"network's image: {count} candidates orange, {len(boxes)} final boxes blue"
        return candidates_picture(image, output, score, corners, words, NETWORK_HEIGHT)


class LorryPanel(Panel):
    """A frame with a lorry: the features that the winner fits, and the error without the lorry's features."""

    title = "A lorry in front of the camera"
    view = LorryConfig
    kit = preset("solution_selection", variant="kit")
    height = PHOTO_HEIGHT
    controls = (
        Control("view.share", "share", high=0.9, step=0.05),
        Control("view.distance", "distance", high=20, step=0.5),
    )

    def draw(self, state: State) -> Drawing:
        sequence = state.sequence
        frame = state.frame
        config = state.config
        given = [empty_matches(), frame_matches(sequence, frame, config)]
        before, now = list(with_lorry(sequence.camera, given, state.view))
        _, box_p = before
        matches, box_c = now
        lorry = matches.id < 0
        motions = {}
        for method in ("feature_selection", "solution_selection"):
            odometry = make_odometry(sequence.camera, preset(method, variant=config.variant))
            odometry.start(box_p)
            motions[method] = odometry.step(matches, box_c).motion
        of_all = motions["solution_selection"]  # from all features, also those on the lorry
        fits = _inliers(of_all, matches, sequence.camera, config.variant)
        image = stereo(sequence, frame)[0].copy()
        for x0, y0, x1, y1 in np.rint(box_c.xyxy).astype(int).tolist():
            image[y0:y1, x0:x1] = image[y0:y1, x0:x1] // 4 + 96
        words = f"frame {frame}: the winner's inliers blue, other features orange, the lorry grey"
        picture = filter_picture(image, matches, fits, box_c, None, words)

        used = select_by_bucket(matches.cur_left, matches.age, matches.strength, config.buckets)
        T_true = true_motion(sequence, frame)
        error_of_all = _apart(of_all.T_cp, T_true) / 10
        error_of_boxes = _apart(motions["feature_selection"].T_cp, T_true) / 10
        facts = (
            Fact("on the lorry", _percent(lorry), "%"),
            Fact("after the buckets", _percent(lorry[used]), "%"),
            Fact("error, all features", error_of_all, "cm", 2),
            Fact("error, box removed", error_of_boxes, "cm", 2),
        )
        return Drawing([picture], _what_the_winner_fits(of_all, fits, lorry), facts)


def _inliers(motion: FrameResult, matches: StereoMatches, camera: StereoCamera, variant: str) -> BoolArray:
    """Mask (N,) of the matches that fit the winner of a motion; none of them without a winner."""
    if motion.e is None:
        return np.zeros(len(matches), np.bool_)
    x_p = camera.normalise(matches.prev_left)
    x_c = camera.normalise(matches.cur_left)
    threshold = preset("solution_selection", variant=variant).selection.threshold
    return sampson_inliers(motion.e.reshape(3, 3), x_p, x_c, threshold / camera.f)


def _what_the_winner_fits(motion: FrameResult, fits: BoolArray, lorry: BoolArray) -> str:
    """A sentence on the winner of all features: how many it fits on the street and on the lorry (masks (N,))."""
    if motion.e is None:
        return "There is no winner: the camera stands still, or too few matches agree."
    sentence = (
        f"The winner of all features fits {np.count_nonzero(fits & ~lorry)} of {np.count_nonzero(~lorry)} "
        f"matches on the street and {np.count_nonzero(fits & lorry)} of {np.count_nonzero(lorry)} on the lorry."
    )
    if Flag.CONTRADICTS_STEREO in motion.flags:
        sentence += (
            " The depths from stereo do not fit its motion: the frame is flagged `contradicts_stereo`."
        )
    return sentence


def _percent(mask: BoolArray) -> float:
    """Share of a mask that is true, %; 0 for an empty mask."""
    return 100 * int(np.count_nonzero(mask)) / max(len(mask), 1)


def _apart(T: Array, T_other: Array | None) -> float:
    """Distance between the translations of two motions, millimetres; NaN if the second motion is None."""
    return np.nan if T_other is None else 1e3 * float(np.linalg.norm(T[:3, 3] - T_other[:3, 3]))
