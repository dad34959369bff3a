"""What a person should know about a label folder before a run: classes, missing files, unusual boxes."""

from __future__ import annotations

from pathlib import Path

from ..errors import DataError
from .class_names import COCO, ClassChoice, ClassNames, listed
from .kitti import list_frames
from .label_files import LabelCounts, count_labels, label_files, label_stems
from .label_names import DETECTOR_RECORD, LISTS, read_class_names
from .sequence import Sequence


def label_remarks(sequence: Sequence, classes: tuple[str, ...]) -> list[str]:
    """Sentences on a sequence's label folder for a choice of classes (setting filter.classes).

    Raises `DataError` for a label file that cannot be read, and `ClassesError` if no box can count.
    """
    if sequence.labels is None:
        return []
    sequence.refuse_other_numbers(classes)
    names = read_class_names(sequence.labels)
    counts = count_labels(label_files(sequence.labels))
    choice = names.choose(classes)
    if names.names:
        class_remarks = [_named_remark(sequence.labels, names, counts, choice)]
    else:
        class_remarks = _unnamed_remarks(counts, choice)
    return class_remarks + coverage_remarks(sequence) + _shape_remarks(counts)


def missing_labels(sequence: Sequence) -> list[str]:
    """The frames of a sequence (or of a part of a sequence) without a label file."""
    if sequence.labels is None:
        return list(sequence.frames)
    stems = label_stems(sequence.labels)
    return [frame for frame in sequence.frames if frame not in stems]


def coverage_remarks(sequence: Sequence) -> list[str]:
    """A sentence on frames without a label file, and one on label files without an image."""
    if sequence.labels is None:
        return []
    missing = missing_labels(sequence)
    stems = label_stems(sequence.labels)
    # The sequence may be a part of the frames in its folder, and the labels may be those of all these frames.
    # But as many label files as frames in the part are probably meant for this part.
    may_be_labels_of_whole_sequence = len(stems) != len(sequence)
    labelled_frames = list_frames(sequence.folder) if may_be_labels_of_whole_sequence else sequence.frames
    surplus = stems.difference(labelled_frames)
    remarks = []
    if missing:
        remarks.append(f"{len(missing)} of {len(sequence)} images have no label file, which means no vehicle")
    if surplus:
        files = listed(f"{stem}.txt" for stem in sorted(surplus))
        remark = f"{files}: no image of the sequence has this name"
        if missing:
            remark += f", and {missing[0]}.png has no label file: are the names shifted?"
        remarks.append(remark)
    return remarks


def _named_remark(folder: Path, names: ClassNames, counts: LabelCounts, choice: ClassChoice) -> str:
    """The chosen classes and the others, of labels with names; `DataError` for a box of a class without."""
    source = Path(names.source)
    unnamed = sorted(counts.boxes.keys() - names.names.keys())
    if unnamed:
        last = max(names.names)
        raise DataError(
            f"class {listed(unnamed)} of the labels in {folder} has no name, the last name is that of "
            f"class {last}: are these the names of other labels, or do the numbers begin at 1? "
            f"Write the names of these labels into {folder / LISTS[0]}, one a line, class 0 first",
            source,
        )
    where = f"names from {source.parent.name}/{source.name}"
    if source.name == DETECTOR_RECORD:
        where = "as the detector names them"
    return f"boxes of {choice.sentence()} ({where})"


def _unnamed_remarks(counts: LabelCounts, choice: ClassChoice) -> list[str]:
    """The numbers that count and those that do not, of labels without names; nothing if all boxes count."""
    chosen_boxes = 0
    others = []
    for number, count in sorted(counts.boxes.items()):
        if number in choice.kinds:
            chosen_boxes += count
        else:
            name = _coco_name(number) or "not in COCO"
            others.append(f"{number} ({name}): {count} boxes")
    if not others:
        return []
    chosen = [f"{number} {_coco_name(number)}".strip() for number in choice.kinds]
    return [
        f"the labels have numbers without names: {chosen_boxes} boxes of class {listed(chosen)} (numbers of "
        f"COCO) count; the others do not, class {listed(others)}"
    ]


def _coco_name(number: int) -> str:
    """The name of COCO's class with a number; "" if COCO has none."""
    return COCO[number] if number < len(COCO) else ""


def _shape_remarks(counts: LabelCounts) -> list[str]:
    """Sentences on labels that are no boxes, or may be something else."""
    remarks = []
    if counts.polygons:
        remarks.append(
            f"{counts.polygons} labels are polygons or rotated boxes: their bounding boxes are used"
        )
    if counts.may_be_keypoints:
        remarks.append(
            f"{counts.may_be_keypoints} of the polygons may be boxes with keypoints, class cx cy w h x y …: "
            "if so, keep the first 5 numbers of each line"
        )
    if counts.may_be_corners:
        remarks.append(
            "every box is wider than its centre is far from the left edge of the image, and higher than it "
            "is far from the top: are the labels corners, not centre and size?"
        )
    return remarks
