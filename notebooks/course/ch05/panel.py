"""Chapter 5: from a network's candidates to boxes, to the kept features, and to their effect."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from vo_lib.config import change, preset
from vo_lib.data.catalogue import SYNTHETIC, available, open_sequence
from vo_lib.data.sequence import Sequence
from vo_lib.data.truth import matches_on_moving
from vo_lib.detection.models import find_model
from vo_lib.detection.settings import DetectorConfig
from vo_lib.detection.yolo import NetworkOutput, YoloDetector
from vo_lib.errors import DataError
from vo_lib.geometry.boxes import Boxes, no_boxes, overlap
from vo_lib.geometry.result import Flag, FrameResult
from vo_lib.geometry.types import Array, BoolArray, Image
from vo_lib.kit.boxes import BoxFilter, Filtered
from vo_lib.kit.settings import KitConfig, KitFilterConfig
from vo_lib.paper.boxes import on_vehicles, vehicles
from vo_lib.paper.settings import MethodConfig
from vo_lib.runs.drive import make_odometry
from vo_lib.settings import Checked, setting

from ..ch04.figures import MILLI
from ..controls import Control, Knob
from ..drawing import WIDTH, caption, figure, photo, raster, stack
from ..frames import Memory, frame_matches, key_of, stereo, true_motion, truth
from ..lessons import turned
from ..panel import Drawing, Panel, State
from ..results import Fact
from .figures import candidates_picture, errors_chart, filter_picture

PHOTO_HEIGHT, CHART_HEIGHT, NET_WIDTH = 298, 250, 640
HISTORY = 4  # frames before the one shown from which the rule `moving` knows its boxes
LABELS = "labels"  # in place of a model: the boxes of the sequence's own folder
RULES = {"published": ("none", "all"), "kit": ("none", "all", "moving", "truth")}
LEAST_SCORE = 0.01  # of a box on the curve of precision and recall


@dataclass(frozen=True)
class FilteringView(Checked):
    """Settings of the detector in the panel of chapter 5."""

    model: str = setting("street", "a detector by name, an ONNX file; or labels: the boxes of the folder")
    nms: float = setting(0.5, "of two boxes that overlap more (IoU) the better stays", low=0.05, high=1)


_detectors: Memory[YoloDetector] = Memory(3)
_candidates: Memory[NetworkOutput] = Memory(48)
_motions: Memory[FrameResult] = Memory(48)


def detector_of(model: str) -> YoloDetector:
    """A detector for all of its classes, loaded once; the filter chooses among them."""
    path = find_model(model.strip())
    key = (path.resolve(), path.stat().st_mtime_ns)
    return _detectors.get(key, lambda: YoloDetector(path, DetectorConfig(classes=())))


def frame_candidates(sequence: Sequence, frame: int, detector: YoloDetector) -> NetworkOutput:
    """The output of a detector for a frame's left image."""
    key = (*key_of(sequence, frame), detector.path)
    return _candidates.get(key, lambda: detector.candidates(stereo(sequence, frame)[0]))


def real_drives() -> Iterator[Sequence]:
    """The real drives found on this machine, one after the other."""
    return (open_sequence(name) for name in available() if not name.startswith(SYNTHETIC))


def frame_boxes(sequence: Sequence, frame: int, model: str, score: float, nms: float) -> Boxes:
    """Boxes of a frame's left image from a model or from the sequence's labels."""
    if model.strip() == LABELS:
        return sequence.boxes(frame)
    detector = detector_of(model)
    return detector.select_boxes(frame_candidates(sequence, frame, detector), score, nms)


def filtered_frame(
    sequence: Sequence, frame: int, config: MethodConfig, view: FilteringView
) -> tuple[Filtered, Boxes]:
    """The matches of a frame >= 1 that a method's rule keeps, and the frame's boxes.

    The rule `moving` starts `HISTORY` frames earlier, because it accumulates the motion of the camera.
    """
    rule = config.filter
    if rule.rule == "truth" and truth(sequence) is None:
        raise DataError(
            "the rule `truth` needs a drawn scene: other sequences do not have true motions of vehicles"
        )
    first = max(frame - HISTORY, 1) if rule.rule == "moving" else frame
    before = frame_boxes(sequence, first - 1, view.model, rule.score, view.nms)
    if not isinstance(rule, KitFilterConfig):
        boxes = frame_boxes(sequence, frame, view.model, rule.score, view.nms)
        gone = on_vehicles(frame_matches(sequence, frame, config), before, boxes, rule)
        return Filtered(~gone | (rule.rule == "none")), boxes
    judge = BoxFilter(sequence.camera, rule)
    judge.start(before)
    for index in range(first, frame + 1):
        matches = frame_matches(sequence, index, config)
        boxes = frame_boxes(sequence, index, view.model, rule.score, view.nms)
        on_moving = matches_on_moving(sequence, index, matches) if rule.rule == "truth" else None
        result = judge.step(matches, boxes, on_moving)
    return result, boxes


def motion_from(sequence: Sequence, frame: int, keep: BoolArray, config: MethodConfig) -> FrameResult:
    """The frame's motion from the matches that `keep` (N,) leaves, of its two pairs alone.

    No previous vector and no calibration: so nothing but the choice of features differs.
    """
    alone = change(change(config, "filter.rule", "none"), "selection.prior", False)
    if isinstance(alone, KitConfig):
        alone = change(alone, "calibration.estimate", False)
    matches = frame_matches(sequence, frame, config)
    key = (*key_of(sequence, frame), keep.tobytes(), alone)

    return _motions.get(key, lambda: make_odometry(sequence.camera, alone).step(matches[keep], no_boxes()))


def precision_recall(sequence: Sequence, frames: range, detector: YoloDetector) -> tuple[Array, Array, Array]:
    """Scores of a detector's boxes, best first, and precision and recall of all boxes down to each score.

    A box is right where its IoU with a labelled box is a half or more; of several on one, the best scored.
    """
    found, labelled = [], 0
    for frame in frames:
        boxes = detector.select_boxes(
            frame_candidates(sequence, frame, detector), LEAST_SCORE, DetectorConfig().nms
        )
        shared = overlap(boxes.xyxy, sequence.boxes(frame).xyxy)
        labelled += shared.shape[1]
        for row, score in zip(shared, boxes.score.tolist(), strict=True):
            right = float(row.max(initial=0.0) >= 0.5)
            found.append((score, right))
            if right:
                shared[:, row.argmax()] = 0.0  # each labelled box once
    scores, hits = np.array(sorted(found, reverse=True)).reshape(-1, 2).T
    hits = np.cumsum(hits)
    return scores, hits / np.arange(1, len(hits) + 1), hits / max(labelled, 1)


class FilteringPanel(Panel):
    """A frame's candidates, boxes and features, and its motion with and without the removed ones."""

    title = "From boxes to the features that stay"
    view = FilteringView
    start = preset("feature_selection")
    kit = preset("feature_selection", variant="kit")
    height = PHOTO_HEIGHT + CHART_HEIGHT
    controls = (
        Control("view.model", "model"),
        Control("filter.score", "score", low=0.01, high=0.99, step=0.01),
        Control("view.nms", "suppression, IoU", step=0.05),
        Control("filter.margin", step=0.05),
        Control("filter.classes"),
        Control("filter.rule", "rule"),
    )

    def _make_knobs(self, first: dict[str, Any]) -> dict[str, Knob]:
        knobs = super()._make_knobs(first)
        rule, variant = knobs["filter.rule"].widget, self.variant
        assert variant is not None

        def offer(_: Any = None) -> None:
            kept, rules = rule.value, RULES[variant.value]
            rule.options, rule.value = rules, kept if kept in rules else "all"

        offer()
        # Before the panel draws.
        variant.unobserve(self.redraw, "value")
        variant.observe(offer, "value")
        variant.observe(self.redraw, "value")
        return knobs

    def idle(self, state: State) -> set[str]:
        labels = {"filter.score", "view.nms"} if state.view.model.strip() == LABELS else set()
        return labels | ({"filter.margin", "filter.classes"} if state.config.filter.rule == "none" else set())

    def draw(self, state: State) -> Drawing:
        sequence, frame, rule = state.sequence, state.frame, state.config.filter
        matches = frame_matches(sequence, frame, state.config)
        result, boxes = filtered_frame(sequence, frame, state.config, state.view)
        judged = result.judgement
        shown = vehicles(boxes, rule) if judged is None else judged.boxes
        removed = int(np.sum(~result.keep))
        picture = filter_picture(
            stereo(sequence, frame)[0],
            matches,
            result.keep,
            shown,
            None if judged is None else judged.state,
            f"frame {frame}, rule {rule.rule}: kept features blue, removed ones orange",
            PHOTO_HEIGHT,
        )
        T_true = true_motion(sequence, frame)
        every = motion_from(sequence, frame, np.ones(len(matches), np.bool_), state.config).T_cp
        kept = motion_from(sequence, frame, result.keep, state.config).T_cp
        reference, words = (every, "all features") if T_true is None else (T_true, "the truth")
        title = f"{'change' if T_true is None else 'error'} of the translation, from above"
        errors = {name: MILLI * (T[:3, 3] - reference[:3, 3]) for name, T in (("all", every), ("kept", kept))}
        network, candidates = self._network(state, boxes)
        change = MILLI * float(np.linalg.norm(kept[:3, 3] - every[:3, 3]))
        turn = turned(kept[:3, :3], None if T_true is None else T_true[:3, :3])
        sizes = [np.nan if T_true is None else float(np.linalg.norm(error)) for error in errors.values()]
        sentence = f"With {len(shown)} boxes here and those of the image before, "
        sentence += f"the rule removes {removed} of {len(matches)} features. "
        if T_true is None:
            sentence += f"That moves the translation by {change:.1f} mm; this sequence has no truth."
        else:
            sentence += f"The translation is {sizes[0]:.1f} mm from the truth with all features, "
            sentence += f"{sizes[1]:.1f} mm with those kept."
        if judged is not None and removed:
            sentence += " Orange in a parked box (dashed): features that do not agree with the background."
        if state.view.model.strip() == "street" and truth(sequence) is None:
            sentence += " `street` was trained on drawn streets; it does not know real ones."
        if Flag.FILTER_OFF in result.flags:
            sentence += " Too few features would be left, so the filter is off in this frame."
        facts = [
            Fact("candidates", candidates),
            Fact("boxes", len(shown)),
            Fact("features", len(matches)),
            Fact("removed", removed),
            Fact("error, all", sizes[0], "mm", 1),
            Fact("error, kept", sizes[1], "mm", 1),
            Fact("change of t", change, "mm", 1),
            Fact("rotation error, kept", turn, "°", 3),
        ]
        if truth(sequence) is not None:
            moving = matches_on_moving(sequence, frame, matches)
            facts.append(Fact("on moving things, kept", int(np.sum(moving & result.keep))))
            facts.append(Fact("on standing things, removed", int(np.sum(~moving & ~result.keep))))
        chart, (axis,) = figure(CHART_HEIGHT, width=WIDTH - NET_WIDTH)
        errors_chart(axis, errors, words, title)
        below = np.hstack([network, raster(chart)])
        return Drawing(stack([picture, below], self.height), sentence, tuple(facts))

    def _network(self, state: State, boxes: Boxes) -> tuple[Image, int]:
        """The picture of the candidates, and their number; of labels the image alone."""
        image, rule = stereo(state.sequence, state.frame)[0], state.config.filter
        if state.view.model.strip() == LABELS:
            plain = photo(image, NET_WIDTH, CHART_HEIGHT)
            return caption(plain, f"{len(boxes)} boxes of the label folder, no network"), len(boxes)
        found = frame_candidates(state.sequence, state.frame, detector_of(state.view.model))
        letterbox = found.letterbox
        corners = (boxes.xyxy + 0.5) * letterbox.scale + (letterbox.left, letterbox.top) * 2
        count = int(np.count_nonzero(found.scores.max(axis=1) >= rule.score))
        words = f"network's image: {count} candidates orange, {len(boxes)} boxes left blue"
        return candidates_picture(image, found, rule.score, corners, words, NET_WIDTH, CHART_HEIGHT), count
