"""Chapter 5: where a frame's boxes come from: a detector, a network of the reader, or a label folder.

The panel names a source by what is typed into its control *model*. The sentences here name its controls.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vo_lib.data.class_names import COCO, ClassesError, ClassNames, listed
from vo_lib.data.label_names import read_class_names
from vo_lib.data.sequence import Sequence
from vo_lib.detection.label_folders import chosen_mask, model_classes, with_kinds
from vo_lib.detection.model_files import model_files
from vo_lib.detection.models import find_model
from vo_lib.detection.yolo import NetworkOutput, YoloDetector
from vo_lib.errors import DataError, did_you_mean
from vo_lib.geometry.boxes import VEHICLES, Boxes, no_boxes
from vo_lib.paper.settings import FilterConfig
from vo_lib.settings import WORD_OF_LIST, Checked, setting

from ..controls import typed_path
from ..frames import key_of, stereo
from ..memory import Memory

LABELS = "labels"  # in place of a model: the boxes of the sequence's own folder
MODEL_REMEDY = "type `street`, `labels`, or another ONNX file"
SHOWN_WORDS = 3  # of classes in a message

_detectors: Memory[YoloDetector] = Memory(3)
_candidates: Memory[NetworkOutput] = Memory(48)
# Networks of the reader by name. They have those methods of `YoloDetector` that are used here.
_offered: dict[str, Any] = {}


@dataclass(frozen=True)
class FilteringView(Checked):
    """Settings of the detector in the panel of chapter 5."""

    model: str = setting("street", "name of a detector, an ONNX file, or labels: the boxes of the folder")
    nms: float = setting(0.5, "IoU above which the lower-scored of two boxes is dropped", low=0.05, high=1)


def offer_network(name: str, network: Any) -> None:
    """Let a network of the reader be a source of boxes under a name; a later one takes its place.

    network : with those methods of `YoloDetector` that are used here, as `miniature.Miniature`.
    """
    _offered[name] = network


def is_offered(name: str) -> bool:
    """Whether a network of the reader has this name."""
    return name in _offered


def model_name(model: str) -> str:
    """The name of a model without its folder."""
    return Path(model.strip()).name


def typed_model(model: str) -> Path:
    """The typed name or path of a model; `DataError` if nothing is typed."""
    if not model.strip():
        raise DataError("the field is empty")
    return typed_path(model)


def detector_of(model: str) -> YoloDetector:
    """A detector, loaded once, or a network of the reader."""
    if is_offered(model.strip()):
        return _offered[model.strip()]  # type: ignore[no-any-return]
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

    A `ClassesError` of the library says that the choice is possible, but that no box would count: then the panel
    goes on without boxes. Any other `DataError` says that there is no such class: it is raised again, with a text
    that names the control, not the setting.
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
    source = f"the model {model_name(view.model)}"
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
