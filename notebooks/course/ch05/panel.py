"""Chapter 5: from a network's candidates to boxes, to the kept features, and to their effect; a lorry."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vo_lib.config import change, preset
from vo_lib.data.class_names import COCO, ClassesError, ClassNames, listed
from vo_lib.data.label_names import read_class_names
from vo_lib.data.sequence import Sequence
from vo_lib.data.truth import matches_on_moving
from vo_lib.detection.label_folders import chosen_mask, model_classes, with_kinds
from vo_lib.detection.model_files import model_files
from vo_lib.detection.models import find_model
from vo_lib.detection.yolo import NetworkOutput, YoloDetector
from vo_lib.errors import DataError, did_you_mean
from vo_lib.geometry.boxes import VEHICLES, Boxes, no_boxes
from vo_lib.geometry.matches import StereoMatches, empty_matches
from vo_lib.geometry.result import Flag, FrameResult
from vo_lib.geometry.types import Array, BoolArray, Image
from vo_lib.kit.settings import KitConfig
from vo_lib.paper.box_removal import Removal
from vo_lib.paper.buckets import select_by_bucket
from vo_lib.paper.selection import sampson_inliers
from vo_lib.paper.settings import FilterConfig, MethodConfig
from vo_lib.runs.drive import make_odometry
from vo_lib.settings import WORD_OF_LIST, Checked, setting

from ..controls import about, typed_path
from ..drawing import PHOTO_HEIGHT, WIDTH, caption, photo
from ..frames import frame_matches, key_of, scene_truth, stereo, true_motion
from ..memory import Memory
from ..panel import Control, Drawing, Fact, Panel, State
from ..simulation.lorry import LorryConfig, with_lorry
from .figures import candidates_picture, filter_picture

LABELS = "labels"  # in place of a model: the boxes of the sequence's own folder
NETWORK_HEIGHT = 252  # of the picture of the candidates
MODEL_REMEDY = "type `street`, `labels`, or another ONNX file"
SHOWN_WORDS = 3  # of classes in a message


@dataclass(frozen=True)
class FilteringView(Checked):
    """Settings of the detector in the panel of chapter 5."""

    model: str = setting("street", "name of a detector, an ONNX file, or labels: the boxes of the folder")
    nms: float = setting(0.5, "IoU above which the lower-scored of two boxes is dropped", low=0.05, high=1)


offered: dict[str, Any] = {}  # networks that a cell offers to the panel, by name, with the methods it uses
_detectors: Memory[YoloDetector] = Memory(3)
_candidates: Memory[NetworkOutput] = Memory(48)
_motions: Memory[FrameResult] = Memory(48)


def typed_model(model: str) -> Path:
    """The typed name or path of a model; `DataError` if nothing is typed."""
    if not model.strip():
        raise DataError("the field is empty")
    return typed_path(model)


def detector_of(model: str) -> YoloDetector:
    """A detector, loaded once, or a network that a cell offers."""
    if model.strip() in offered:
        return offered[model.strip()]  # type: ignore[no-any-return]
    path = find_model(typed_model(model))
    key = (path.resolve(), *(file.stat().st_mtime_ns for file in model_files(path)))
    return _detectors.get(key, lambda: YoloDetector(path))


def frame_candidates(sequence: Sequence, frame: int, detector: YoloDetector) -> NetworkOutput:
    """Output of a detector for a frame's left image."""
    key = (*key_of(sequence, frame), detector)  # another one after a change of the model's files
    return _candidates.get(key, lambda: detector.candidates(stereo(sequence, frame)[0]))


def frame_boxes(sequence: Sequence, frame: int, view: FilteringView, rule: FilterConfig) -> Boxes:
    """Boxes of the chosen classes in a frame's left image, from a model or from the sequence's labels."""
    if no_class(sequence, view, rule):
        return no_boxes()
    if view.model.strip() == LABELS:
        return sequence.boxes(frame, rule.classes)
    detector = detector_of(view.model)
    mask = chosen_mask(detector, rule.classes)
    output = frame_candidates(sequence, frame, detector)
    return with_kinds(detector, detector.select_boxes(output, rule.score, view.nms, mask))


def no_class(sequence: Sequence, view: FilteringView, rule: FilterConfig) -> str:
    """A sentence if the model or the labels have none of the chosen classes, else "".

    Raises `DataError` for a class that nothing has; the text names the control, not the setting.
    """
    if view.model.strip() == LABELS:
        if sequence.labels is None:
            return ""
        names = read_class_names(sequence.labels)
        try:
            sequence.boxes_of(rule.classes)
        except ClassesError:
            return f" No box counts, see *classes*: {_unknown(rule.classes, names, 'the label folder')}."
        except DataError:
            raise DataError(f"classes: {_unknown(rule.classes, names, 'the label folder')}") from None
        return ""
    detector = detector_of(view.model)
    names, _ = model_classes(detector)
    source = f"the model {Path(view.model.strip()).name}"
    try:
        chosen_mask(detector, rule.classes)
    except ClassesError:
        if not names.names:
            return f" No box counts, see *classes*: {_by_number(detector, source)}."
        return f" No box counts, see *classes*: {_unknown(rule.classes, names, source)}."
    except DataError:
        raise DataError(f"classes: {_unknown(rule.classes, names, source)}") from None
    return ""


def _by_number(detector: YoloDetector, source: str) -> str:
    """What can be typed for a model without class names."""
    last = "" if detector.class_count is None else f" from 0 to {detector.class_count - 1}"
    return f"{source} has no class names; type numbers of its classes{last}, such as 0"


def _unknown(words: tuple[str, ...], names: ClassNames, source: str) -> str:
    """Which of the typed classes a model or a label folder lacks, and what can be typed for it."""
    lacking = [word for word in words if not _exists(names, word)]
    if not lacking:
        lacking = [word for word in words if not _counts(names, word)]
    shown = " or ".join(word if word.isdecimal() else repr(word) for word in lacking[:SHOWN_WORDS])
    near = did_you_mean(lacking[0], names.names.values() or COCO)
    return f"there is no class {shown} in {source}; {near}type {_possible(names)}"


def _possible(names: ClassNames) -> str:
    """The classes that can be typed for a model or a label folder, as text."""
    if not names.names:
        return f"{VEHICLES}, a number, or a name of COCO such as truck"
    words = [VEHICLES, *(name for name in names.names.values() if re.fullmatch(WORD_OF_LIST, name))]
    possible = [word for word in words if _counts(names, word)]
    return f"one of: {listed(possible)}" if possible else "the number of a class"


def _exists(names: ClassNames, word: str) -> bool:
    """Whether a model or a label folder has this class, or may have it; its boxes need not count."""
    try:
        names.choose((word,))
    except ClassesError:
        return True
    except DataError:
        return False
    return True


def _counts(names: ClassNames, word: str) -> bool:
    """Whether boxes count if the choice is this class alone."""
    try:
        names.choose((word,))
    except DataError:
        return False
    return True


def filtered_frame(
    sequence: Sequence, frame: int, config: MethodConfig, view: FilteringView
) -> tuple[Removal, Boxes]:
    """What a method's box rule does to the matches of a frame >= 1, and the frame's boxes of all classes.

    The rule `moving` starts one frame earlier, since a match is also removed if its previous point was in a
    moving box.
    """
    rule = config.filter
    if rule.rule == "truth" and scene_truth(sequence) is None:
        raise DataError(
            "rule: `truth` needs the true motions of vehicles, which only a drawn scene has: choose another rule"
        )
    first = max(frame - 1, 1) if rule.rule == "moving" else frame

    def on_moving(number: int, matches: StereoMatches) -> BoolArray:
        return matches_on_moving(sequence, first - 1 + number, matches)

    box_filter = make_odometry(sequence.camera, config, on_moving=on_moving).box_filter
    box_filter.start(frame_boxes(sequence, first - 1, view, rule))
    for index in range(first, frame + 1):
        boxes = frame_boxes(sequence, index, view, rule)
        removal = box_filter.step(frame_matches(sequence, index, config), boxes)
    return removal, boxes


def motion_from(sequence: Sequence, frame: int, keep: BoolArray, config: MethodConfig) -> FrameResult:
    """Motion of a frame from the matches in the mask `keep` (N,), without earlier frames.

    The motions differ only by the features: neither a previous vector nor an estimated rig is used.
    """
    alone = change(change(config, "filter.rule", "none"), "selection.prior", False)
    if isinstance(alone, KitConfig):
        alone = change(alone, "calibration.estimate", False)
    matches = frame_matches(sequence, frame, config)
    key = (*key_of(sequence, frame), keep.tobytes(), alone)
    return _motions.get(
        key, lambda: make_odometry(sequence.camera, alone).step(matches[keep], no_boxes()).motion
    )


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
        rule = state.config.filter
        if state.view.model.strip() != LABELS:
            with about("model", MODEL_REMEDY):
                frame_candidates(sequence, frame, detector_of(state.view.model))
        matches = frame_matches(sequence, frame, state.config)
        result, boxes = filtered_frame(sequence, frame, state.config, state.view)
        words = f"frame {frame}, rule {rule.rule}: kept features blue, removed features orange"
        picture = filter_picture(
            stereo(sequence, frame)[0], matches, result.kept, result.boxes, result.state, words
        )

        T_true = true_motion(sequence, frame)
        every = motion_from(sequence, frame, np.ones(len(matches), np.bool_), state.config).T_cp
        kept = motion_from(sequence, frame, result.kept, state.config).T_cp
        removed = int(np.count_nonzero(~result.kept))
        model = state.view.model.strip()
        sentence = f"The rule removes {removed} of {len(matches)} features."
        if T_true is None:
            sentence += " The sequence has no ground truth."
        if model == LABELS and sequence.labels is None:
            sentence += (
                " The sequence has no label folder, so there are no boxes: type `street` under *model*."
            )
        if result.state is not None and removed:
            sentence += " Orange in a parked box (dashed): features that do not agree with the background."
        sentence += no_class(sequence, state.view, rule)
        if scene_truth(sequence) is None and model == "street":
            sentence += " `street` was trained on drawn streets, not on real ones."
        if scene_truth(sequence) is None and model in offered:
            sentence += f" `{model}` knows only the streets that you trained it on."
        if Flag.FILTER_OFF in result.flags:
            sentence += " Too few features would be left, so the filter is off in this frame."
        facts = [
            Fact("removed", removed),
            Fact("error, all", _apart(every, T_true), "mm", 1),
            Fact("error, kept", _apart(kept, T_true), "mm", 1),
            Fact("change of t", _apart(kept, every), "mm", 1),
        ]
        if scene_truth(sequence) is not None:
            moving = matches_on_moving(sequence, frame, matches)
            facts.append(Fact("on moving things, kept", int(np.count_nonzero(moving & result.kept))))
            facts.append(Fact("on standing things, removed", int(np.count_nonzero(~moving & ~result.kept))))
        return Drawing([picture, self._network(state, boxes)], sentence, tuple(facts))

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
        (_, box_p), (matches, box_c) = with_lorry(sequence.camera, given, state.view)
        lorry = matches.id < 0
        motions = {}
        for method in ("feature_selection", "solution_selection"):
            odometry = make_odometry(sequence.camera, preset(method, variant=config.variant))
            odometry.start(box_p)
            motions[method] = odometry.step(matches, box_c).motion
        of_all = motions["solution_selection"]  # from all features, also those on the lorry
        fits = np.zeros(len(matches), np.bool_)
        if of_all.e is not None:
            x_p = sequence.camera.normalise(matches.prev_left)
            x_c = sequence.camera.normalise(matches.cur_left)
            threshold = preset("solution_selection", variant=config.variant).selection.threshold
            fits = sampson_inliers(of_all.e.reshape(3, 3), x_p, x_c, threshold / sequence.camera.f)

        image = stereo(sequence, frame)[0].copy()
        for x0, y0, x1, y1 in np.rint(box_c.xyxy).astype(int).tolist():
            image[y0:y1, x0:x1] = image[y0:y1, x0:x1] // 4 + 96
        words = f"frame {frame}: the winner's inliers blue, other features orange, the lorry grey"
        picture = filter_picture(image, matches, fits, box_c, None, words)

        sentence = (
            f"The winner of all features fits {np.count_nonzero(fits & ~lorry)} of {np.count_nonzero(~lorry)} "
            f"matches on the street and {np.count_nonzero(fits & lorry)} of {np.count_nonzero(lorry)} on the lorry."
        )
        if of_all.e is None:
            sentence = "There is no winner: the camera stands still, or too few matches agree."
        elif Flag.CONTRADICTS_STEREO in of_all.flags:
            sentence += (
                " The depths from stereo do not fit its motion: the frame is flagged `contradicts_stereo`."
            )
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
        return Drawing([picture], sentence, facts)


def _percent(mask: BoolArray) -> float:
    """Share of a mask that is true, %; 0 for an empty mask."""
    return 100 * int(np.count_nonzero(mask)) / max(len(mask), 1)


def _apart(T: Array, T_other: Array | None) -> float:
    """Distance between the translations of two motions, millimetres; NaN if the second motion is None."""
    return np.nan if T_other is None else 1e3 * float(np.linalg.norm(T[:3, 3] - T_other[:3, 3]))
