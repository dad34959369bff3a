"""What a person should know about a label folder before a run: classes, missing files, unusual boxes."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from ..errors import DataError
from .class_names import COCO, ClassNames, listed
from .kitti import list_frames
from .label_files import LabelCounts, count_labels, label_files
from .label_names import DETECTOR_RECORD, LISTS, is_file_of_names, read_class_names
from .sequence import Sequence


def label_remarks(sequence: Sequence, classes: tuple[str, ...]) -> list[str]:
    """Sentences on a sequence's label folder for a choice of classes (setting filter.classes).

    Raises `DataError` for a label file that cannot be read, and `ClassesError` if no box can count.
    """
    if sequence.labels is None:
        return []
    sequence.require_boxes(classes)
    names = read_class_names(sequence.labels)
    counts = count_labels(label_files(sequence.labels))
    return [
        *_class_remark(sequence.labels, names, counts, classes),
        *coverage_remarks(sequence),
        *_shape_remarks(counts),
    ]


def missing_labels(sequence: Sequence) -> list[str]:
    """The frames of a sequence (or of a part of a sequence) without a label file."""
    if sequence.labels is None:
        return list(sequence.frames)
    stems = _label_stems(sequence.labels)
    return [frame for frame in sequence.frames if frame not in stems]


def coverage_remarks(sequence: Sequence) -> list[str]:
    """A sentence on frames without a label file, and one on label files without an image."""
    if sequence.labels is None:
        return []
    missing = missing_labels(sequence)
    stems = _label_stems(sequence.labels)
    one_each = len(stems) == len(sequence)  # then each label file should belong to an image of the sequence
    frames = sequence.frames if one_each else list_frames(sequence.folder)
    surplus = sorted(stems - set(frames))
    remarks = []
    if missing:
        remarks.append(f"{len(missing)} of {len(sequence)} images have no label file, which means no vehicle")
    if surplus:
        files = listed(f"{stem}.txt" for stem in surplus)
        remarks.append(f"{files}: no image of the sequence has this name")
    if missing and surplus:
        remarks[-1] += f", and {missing[0]}.png has no label file: are the names shifted?"
    return remarks


def _label_stems(folder: Path) -> set[str]:
    return {path.stem for path in folder.glob("*.txt") if not is_file_of_names(path.name)}


def _class_remark(
    folder: Path, names: ClassNames, counts: LabelCounts, classes: tuple[str, ...]
) -> Iterable[str]:
    """The chosen classes and the others; nothing if all boxes of a folder without names count."""
    choice = names.choose(classes)
    if names.names:
        source = Path(names.source)
        if source.name == DETECTOR_RECORD:
            where = "as the detector names them"
        else:
            where = f"names from {source.parent.name}/{source.name}"
        unnamed = sorted(counts.boxes.keys() - names.names.keys())
        if unnamed:
            last = max(names.names)
            raise DataError(
                f"class {listed(unnamed)} of the labels in {folder} has no name, the last name is that of "
                f"class {last}: are these the names of other labels, or do the numbers begin at 1? "
                f"Write the names of these labels into {folder / LISTS[0]}, one a line, class 0 first",
                source,
            )
        return [f"boxes of {choice.sentence()} ({where})"]
    others = {number: count for number, count in sorted(counts.boxes.items()) if number not in choice.kinds}
    if not others:
        return []
    words = (
        f"{number} ({COCO[number] if number < len(COCO) else 'not in COCO'}): {count} boxes"
        for number, count in others.items()
    )
    numbered = sum(count for number, count in counts.boxes.items() if number in choice.kinds)
    chosen = listed(f"{number} {COCO[number]}" if number < len(COCO) else number for number in choice.kinds)
    return [
        f"the labels have numbers without names: {numbered} boxes of class {chosen} (numbers of COCO) count; "
        f"the others do not, class {listed(words)}"
    ]


def _shape_remarks(counts: LabelCounts) -> list[str]:
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
            "every box is higher and wider than its centre's distance from the corner of the image: are the "
            "labels corners, not centre and size?"
        )
    return remarks
