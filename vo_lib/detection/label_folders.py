"""Label folders from a detector: a YOLO text file per frame, and a record of the detector.

A label folder contains `000000.txt` …; `detector.json`, with the model's SHA-256, the settings, and the names
and numbers of the classes; and `images.sha256`, with the hash of the image of each label.

A class has a number of the model's own, one in label files, and one of its kind; see `data/class_names.py`.
"""

from __future__ import annotations

import dataclasses
import functools
import glob
import hashlib
import json
import os
import re
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from ..data.class_names import ClassesError, ClassNames, label_numbers
from ..data.drawn import cache_folder, make_cache_folder
from ..data.image_hashes import image_hashes
from ..data.kitti import COLOUR, GREY, IMAGE_BITS, list_frames, read_image
from ..data.label_files import label_files, read_label_rows, write_labels
from ..data.label_names import DETECTOR_RECORD
from ..data.label_remarks import missing_labels
from ..data.sequence import Sequence
from ..errors import DataError
from ..files import only_process, read_bytes, read_mapping, read_text, write_atomic
from ..geometry.boxes import VEHICLES, Boxes
from ..geometry.types import BoolArray, Progress
from ..settings import to_dict
from .metadata import MAX_CLASSES
from .model_files import model_sha256
from .models import find_model
from .settings import DetectorConfig
from .yolo import YoloDetector

RECORD_KEYS = {"model", "sha256", "settings"}  # in every record of the kit
IMAGE_LIST = "images.sha256"  # a line for each label: the hash of the image, then its name, as of sha256sum
IMAGE_LINE = re.compile(r"([0-9a-f]{64})  (\d+)\.png")
EXPECTED_RECORD = "the record of the detector that wrote the labels"
FILES_OF_SEQUENCES = ("calib.txt", "times.txt")
FILES_OF_RUNS = ("poses.txt", "poses_tum.txt", "frames.csv", "metrics.json")
# A label folder has none of these.
FILES_OF_OTHER_FOLDERS = (*GREY, *COLOUR, *FILES_OF_SEQUENCES, *FILES_OF_RUNS)
# A folder with one of these has recordings below it, in the layouts of KITTI, KITTI's raw drives and EuRoC.
IMAGE_FOLDERS = re.compile(r"image_\d{1,2}|cam\d")
IMAGE_ENDINGS = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".ppm", ".pgm")
LEVELS_TO_SEQUENCE = 3  # from a folder of images up to its sequence, as in mav0/cam0/data
# Threads, one image each: the network works on one image while another is read or its boxes are selected.
DETECTION_THREADS = 2


def detection_record(
    model: str | Path, config: DetectorConfig, classes: tuple[str, ...] = (VEHICLES,), provider: str = "cpu"
) -> dict[str, Any]:
    """All inputs that determine a detector's labels, apart from the images, for JSON.

    The model and its hash, the provider, the settings, and the wanted classes (setting filter.classes).
    Raises `DataError` as `find_model` and `model_sha256`.
    """
    path = find_model(model)
    settings = to_dict(config)
    del settings["threads"]  # which changes the speed alone
    return {
        "model": path.name,
        "sha256": model_sha256(path),
        "provider": provider,
        "settings": settings,
        "classes": list(classes),
    }


def label_folder(sequence: Sequence, record: dict[str, Any], cache: Path | None = None) -> Path:
    """The folder for a detector's labels of these images, in the kit's cache (`cache_folder`).

    The name has a digest of the record and one of the names and contents of the images, so that other images
    in the same place have another folder, and the same images in another place have the same folder.
    """
    images = _digest([sequence.frames, list(_image_digests(sequence).values())])
    return cache_folder(cache) / "labels" / f"{_folder_prefix(record)}-{images}"


def _folder_prefix(record: dict[str, Any]) -> str:
    """The beginning of the names of all label folders of a detector in the cache."""
    return f"{Path(record['model']).stem}-{_digest(record)}"


def _digest(data: Any) -> str:
    """Twelve hexadecimal digits of the SHA-256 of data for JSON."""
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()[:12]


def _image_digests(sequence: Sequence) -> dict[str, str]:
    """SHA-256 of the left image of each frame, by frame.

    With grey values of more than 8 bits, it also depends on the bits that the sequence needs: they decide
    which 8 of them the detector sees.
    """
    left, _ = sequence.sides
    names = [f"{left}/{frame}.png" for frame in sequence.frames]
    digests = list(image_hashes(sequence.folder, names).values())
    if sequence.bits > IMAGE_BITS:
        digests = [hashlib.sha256(f"{digest} {sequence.bits}".encode()).hexdigest() for digest in digests]
    return dict(zip(sequence.frames, digests, strict=True))


def model_classes(detector: YoloDetector) -> tuple[ClassNames, ClassNames]:
    """The classes of a detector, with its own numbers and with the numbers in label files.

    The numbers in label files are those of `label_numbers`; without names, the detector's own.
    """
    source = str(detector.path)
    if detector.names is None:
        return ClassNames(source=source), ClassNames(source=source)
    own = ClassNames(dict(enumerate(detector.names)), source)
    numbers = label_numbers(detector.names).tolist()
    in_labels = ClassNames(dict(zip(numbers, detector.names, strict=True)), source)
    return own, in_labels


def chosen_mask(detector: YoloDetector, classes: tuple[str, ...]) -> BoolArray:
    """Mask (C,) of a detector's classes, by its own numbers, that are chosen by name or number.

    For a model without names, the mask ends with the largest chosen number.

    Raises as `ClassNames.choose`. For a model without names, raises `ClassesError` unless each word, one or
    more, is the number of a class; so it does for the default `vehicles`.
    """
    own, _ = model_classes(detector)
    if own.names:
        numbers = list(own.choose(classes).kinds)
        count = len(own.names)
    else:
        numbers = [int(word) for word in classes if word.isdecimal()]
        if not numbers or len(numbers) < len(classes) or not _have_numbers(detector, numbers):
            raise _choose_by_number(detector)
        count = max(numbers) + 1
    mask = np.zeros(count, np.bool_)
    mask[numbers] = True
    return mask


def _have_numbers(detector: YoloDetector, numbers: list[int]) -> bool:
    """Whether a detector has classes with all of these numbers, one or more, as far as its file tells."""
    class_count = MAX_CLASSES if detector.class_count is None else detector.class_count
    return max(numbers) < class_count


def _choose_by_number(detector: YoloDetector) -> ClassesError:
    """The error for a choice of classes that a model without names does not have."""
    count = detector.class_count
    which = "" if count is None or count == 1 else f" from 0 to {count - 1}"
    problem = f"the model has no class names, so its classes are chosen by number{which}:"
    if count == 1:
        return ClassesError(problem, detector.path, "0", " if its one class is that of the vehicles")
    return ClassesError(problem, detector.path, "NUMBER", " with the number of the vehicles")


def with_label_numbers(detector: YoloDetector, boxes: Boxes) -> Boxes:
    """A detector's boxes with the class numbers of label files, without boxes of classes beyond the names."""
    if detector.names is None:
        return boxes
    known = boxes[boxes.class_id < len(detector.names)]
    return dataclasses.replace(known, class_id=label_numbers(detector.names)[known.class_id])


def with_kinds(detector: YoloDetector, boxes: Boxes) -> Boxes:
    """A detector's boxes with the number of their kind, as a run has them from a label folder."""
    numbered = with_label_numbers(detector, boxes)
    _, names = model_classes(detector)
    if not names.names:
        return numbered
    return names.choose_all().select(numbered)


def write_label_folder(
    sequence: Sequence,
    model: str | Path,
    config: DetectorConfig,
    folder: Path,
    *,
    classes: tuple[str, ...] = (VEHICLES,),
    provider: str = "cpu",
    replace: bool = False,
    others: Iterable[Path] = (),
    progress: Progress | None = None,
    detected: Callable[[int, float], None] | None = None,
) -> int:
    """Write the missing labels of a folder and return their number; a second call continues the first.

    Only boxes of the chosen classes are written: boxes of other classes take no part in the suppression. The
    record of the detector lists these classes, so that a run with another choice does not take the folder.
    A label counts as missing if the content of its image has changed since.

    Parameters
    ----------
    classes : classes by name or number (setting filter.classes).
    replace : delete the frames' labels of another detector with its record and list of images, and no other
        file.
    others : other folders with labels of this record; the labels of the same images are copied.
    detected : called at the end with the number of images in which the detector ran, if it ran in any, and
        the seconds that this took; copied labels count in neither.

    Raises
    ------
    DataError : the folder is that of a sequence or a run, or has the record of another program.
        A file in it is named as a label and is none.
        It has labels of another detector, and `replace` is false or such a label is of no frame.
        Another process writes labels into it.
        The model or an image cannot be used, or the classes cannot be chosen (`chosen_mask`).
    """
    record = detection_record(model, config, classes, provider)
    require_label_folder(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DataError(f"the folder cannot be created: {error.strerror}", folder) from None
    with only_process(folder):
        _require_replaceable(folder)
        is_own = _are_labels_of(folder, record)
        if not is_own:
            _refuse_other_labels(folder, replace)
        digests = _image_digests(sequence)
        missing = _missing_frames(folder, sequence, digests) if is_own else list(sequence.frames)
        if not missing:
            return 0
        detector = YoloDetector(model, config, provider=provider)
        class_mask = chosen_mask(detector, classes)
        if not is_own:
            _replace_labels(folder, sequence)
        _write_record(folder, record, detector, class_mask)
        # Images that this detector has seen in another folder are copied, the others are detected.
        labels_elsewhere = _labels_by_image(others)
        copied = [frame for frame in missing if digests[frame] in labels_elsewhere]
        new = [frame for frame in missing if digests[frame] not in labels_elsewhere]
        written = _WrittenLabels(
            folder / IMAGE_LIST,
            digests,
            count=len(sequence) - len(missing),
            total=len(sequence),
            progress=progress,
        )
        for frame in copied:
            write_atomic(folder / f"{frame}.txt", read_bytes(labels_elsewhere[digests[frame]]))
            written.add(frame)
        start = time.perf_counter()
        detect_label = functools.partial(_detect_label, sequence, folder, detector, class_mask)
        _in_threads(detect_label, new, written.add)
        if detected and new:
            detected(len(new), time.perf_counter() - start)
        return len(missing)


def _missing_frames(folder: Path, sequence: Sequence, digests: dict[str, str]) -> list[str]:
    """The frames without a label of their image in a folder. digests : SHA-256 of each frame's image."""
    written = read_image_list(folder)
    missing = []
    for frame in sequence.frames:
        if written.get(frame) != digests[frame] or not (folder / f"{frame}.txt").exists():
            missing.append(frame)
    return missing


@dataclasses.dataclass
class _WrittenLabels:
    """The list of images of a label folder while labels are written, and their progress.

    Attributes
    ----------
    path : the list of images.
    digests : SHA-256 of each frame's image.
    count : number of frames whose labels are written. total : number of all frames.
    progress : called after each label with `count` and `total`.
    """

    path: Path
    digests: dict[str, str]
    count: int
    total: int
    progress: Progress | None

    def add(self, frame: str) -> None:
        """List the image of a frame whose label file is complete; `DataError` if the disk is full."""
        try:
            with open(self.path, "a") as file:
                file.write(f"{self.digests[frame]}  {frame}.png\n")
        except OSError as error:
            raise DataError(f"cannot be written: {error.strerror}", self.path) from None
        self.count += 1
        if self.progress:
            self.progress(self.count, self.total)


def _detect_label(
    sequence: Sequence, folder: Path, detector: YoloDetector, class_mask: BoolArray, frame: str
) -> None:
    """Detect the boxes in a frame's left image, and write its label file into the folder."""
    image = read_image(sequence.left_file(frame), sequence.bits)
    boxes = with_label_numbers(detector, detector.detect(image, class_mask))
    height, width = image.shape
    write_labels(folder / f"{frame}.txt", boxes, width, height)


def _in_threads(work: Callable[[str], None], frames: list[str], finished: Callable[[str], None]) -> None:
    """Do the work for each frame in threads; `finished` is called in this one, in the order of the frames."""
    with ThreadPoolExecutor(DETECTION_THREADS) as pool:
        results = pool.map(work, frames)
        try:
            for frame in frames:
                next(results)
                finished(frame)
        except BaseException:
            pool.shutdown(cancel_futures=True)  # Ctrl-C does not wait for the other images
            raise


def labelled_sequence(
    sequence: Sequence,
    model: str | Path,
    config: DetectorConfig | None = None,
    *,
    classes: tuple[str, ...] = (VEHICLES,),
    provider: str = "cpu",
    cache: Path | None = None,
    progress: Progress | None = None,
    detected: Callable[[int, float], None] | None = None,
) -> Sequence:
    """The sequence with a detector's labels, which are stored in the cache folder.

    Images that this detector has seen before, in any place, are not detected again. `detected` and errors as
    in `write_label_folder`.
    """
    config = config or DetectorConfig()
    record = detection_record(model, config, classes, provider)
    folder = label_folder(sequence, record, cache)
    make_cache_folder(folder.parent)
    _delete_damaged_record(folder / DETECTOR_RECORD)
    of_this_detector = sorted(folder.parent.glob(f"{glob.escape(_folder_prefix(record))}-*"))
    write_label_folder(
        sequence,
        model,
        config,
        folder,
        classes=classes,
        provider=provider,
        replace=True,
        others=[other for other in of_this_detector if other != folder],
        progress=progress,
        detected=detected,
    )
    return dataclasses.replace(sequence, labels=folder)


def with_all_labels(
    sequence: Sequence,
    model: str | Path,
    *,
    cache: Path | None = None,
    progress: Progress | None = None,
) -> Sequence:
    """The sequence with its own labels if every image has a label file, else with those of a detector.

    The detector's labels are stored in the cache folder; see `labelled_sequence`.
    """
    if not missing_labels(sequence):
        return sequence
    return labelled_sequence(sequence, model, cache=cache, progress=progress)


def read_image_list(folder: Path) -> dict[str, str]:
    """SHA-256 of the image of each label in a detector's folder, by frame; of several, the last counts."""
    path = folder / IMAGE_LIST
    if not path.exists():
        return {}
    digests: dict[str, str] = {}
    for line in read_text(path).splitlines():
        entry = IMAGE_LINE.fullmatch(line)
        if entry is not None:
            digest, frame = entry.groups()
            digests[frame] = digest
    return digests


def _labels_by_image(folders: Iterable[Path]) -> dict[str, Path]:
    """The label files in folders of a detector by the SHA-256 of their image."""
    labels: dict[str, Path] = {}
    for folder in folders:
        for frame, digest in read_image_list(folder).items():
            label = folder / f"{frame}.txt"
            if label.exists():
                labels[digest] = label
    return labels


def _write_record(
    folder: Path, record: dict[str, Any], detector: YoloDetector, class_mask: BoolArray
) -> None:
    """Write the record of a detector, with the names of its classes and the numbers of the written ones."""
    class_fields: dict[str, Any] = {"written": np.flatnonzero(class_mask).tolist()}
    if detector.names is not None:
        numbers = label_numbers(detector.names)
        names = {str(number): name for number, name in zip(numbers, detector.names, strict=True)}
        class_fields = {
            "written": numbers[class_mask].tolist(),
            "names": names,
            "numbers": numbers.tolist(),  # of the model's classes, in the model's order
        }
    write_atomic(folder / DETECTOR_RECORD, json.dumps(record | class_fields, indent=1) + "\n")


def require_label_folder(folder: Path) -> None:
    """Raise `DataError` if a folder for labels is that of a sequence, of a run, or of a sequence's images."""
    for name in FILES_OF_OTHER_FOLDERS:
        if os.path.lexists(folder / name):
            raise DataError(
                f"contains {name}, so it is the folder of a sequence or a run: choose another folder",
                folder,
            )
    if _has_images_of_sequence(folder):
        raise DataError("is a folder of images of a sequence: choose another folder", folder)


def _has_images_of_sequence(folder: Path) -> bool:
    """Whether a folder is inside a sequence and has images, or the name of a sequence's image folder."""
    if not folder.is_dir():
        return False
    # The folder itself and, if it is a link, the folder that it leads to.
    for path in {Path(os.path.abspath(folder)), folder.resolve()}:
        has_images = any(file.suffix.lower() in IMAGE_ENDINGS for file in path.iterdir())
        is_named_so = IMAGE_FOLDERS.fullmatch(path.name) is not None
        above = list(path.parents)[:LEVELS_TO_SEQUENCE]
        if (has_images or is_named_so) and any(_is_sequence(parent) for parent in above):
            return True
    return False


def _is_sequence(folder: Path) -> bool:
    """Whether a folder has the files or image folders of a sequence."""
    if any(os.path.lexists(folder / name) for name in FILES_OF_SEQUENCES):
        return True
    try:
        return any(IMAGE_FOLDERS.fullmatch(path.name) for path in folder.iterdir())
    except OSError:  # a folder that others may not list
        return False


def _are_labels_of(folder: Path, record: dict[str, Any]) -> bool:
    """Whether the labels in a folder are those of this record; not so in a folder without a record.

    Raises `DataError` for a file in place of the record that cannot be read.
    """
    path = folder / DETECTOR_RECORD
    if not path.exists():
        return False
    present = read_mapping(path, EXPECTED_RECORD)
    return all(present.get(name) == value for name, value in record.items())


def _refuse_other_labels(folder: Path, replace: bool) -> None:
    """Raise `DataError` for another program's record, and for another detector's labels unless `replace`."""
    path = folder / DETECTOR_RECORD
    if path.exists() and not RECORD_KEYS.issubset(read_mapping(path, EXPECTED_RECORD)):
        raise DataError(f"expected {EXPECTED_RECORD}: choose another folder for labels", path)
    if label_files(folder) and not replace:
        raise DataError(
            "contains labels that this detector did not write: choose another folder, or add --replace",
            folder,
        )


def _require_replaceable(folder: Path) -> None:
    """Raise `DataError` for a file that is named as a label and is none: it would be overwritten.

    A file in the list of images is the kit's own, even if it is damaged.
    """
    own_frames = read_image_list(folder)
    for file in label_files(folder):
        if file.stem in own_frames:
            continue
        try:
            read_label_rows(file)
        except DataError:
            raise DataError(
                "is named as a frame and is no YOLO label, so it is not replaced: choose another folder", file
            ) from None


def _replace_labels(folder: Path, sequence: Sequence) -> None:
    """Delete the frames' labels of another detector, its record and list of images, and no other file.

    Raises `DataError` for a file that would then seem to be this detector's.
    """
    labels = label_files(folder)
    frames = set(list_frames(sequence.folder))
    for file in labels:
        if file.stem not in frames:
            raise DataError(
                f"is another detector's label, and {sequence.name} has no such frame: choose another folder",
                file,
            )
    # The record is deleted first: a folder never has labels of one detector and the record of another.
    for file in (folder / DETECTOR_RECORD, folder / IMAGE_LIST, *labels):
        file.unlink(missing_ok=True)


def _delete_damaged_record(path: Path) -> None:
    """Delete a record that is not JSON from the cache, whose files are the kit's own."""
    try:
        if path.exists():
            read_mapping(path, EXPECTED_RECORD)
    except DataError:
        path.unlink(missing_ok=True)
