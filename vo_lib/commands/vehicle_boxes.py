"""Vehicle boxes of the sequences that a command opens: their detection, and what it says about them."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from ..config import VARIANTS
from ..data.catalogue import SYNTHETIC
from ..data.class_names import ClassesError
from ..data.label_remarks import label_remarks, missing_labels
from ..data.sequence import Sequence
from ..detection.label_folders import detection_record, labelled_sequence
from ..detection.settings import DetectorConfig
from ..detection.yolo import PROVIDERS
from ..errors import DataError
from ..geometry.boxes import VEHICLES
from ..paper.settings import MethodConfig
from ..runs.durations import DETECTION, Durations, Task
from ..runs.jobs import Job
from .console import continues_when_repeated, print_wrapped, reporting

DETECT = "For boxes, add `--detector MODEL`, an ONNX file or a model of `vo data get_detector`"
DEFAULT_PROVIDER = "cpu"
TYPED_CLASSES = "--filter.classes {}"  # how `vo run` takes the setting
TYPED_SET_CLASSES = "--set filter.classes={}"  # how `vo reproduce` and `vo sweep` take it


def add_detector(parser: argparse.ArgumentParser, where: str = "") -> None:
    """Add the options for a detector and its processor.

    where : the rest of a sentence that begins with "detect the vehicles".
    """
    text = (
        f"detect the vehicles{where}. MODEL is `street`, which comes with the kit and knows drawn streets, a "
        "downloaded model, or an ONNX file"
    )
    parser.add_argument("--detector", metavar="MODEL", help=text)
    text = f"the processor on which the detector runs; default {DEFAULT_PROVIDER}"
    parser.add_argument("--provider", default=DEFAULT_PROVIDER, choices=list(PROVIDERS), help=text)


def check_options(options: argparse.Namespace, names: list[str]) -> None:
    """Raise `DataError` for options on boxes that contradict each other, or that have no effect.

    A folder of labels contradicts a detector, and several sequences (`names`).
    """
    if options.provider != DEFAULT_PROVIDER and options.detector is None:
        raise DataError("--provider has no effect without --detector")
    if options.labels is not None and options.detector is not None:
        raise DataError("--labels and --detector: use only one of them, since both give boxes")
    if options.labels is not None and len(names) > 1:
        raise DataError(
            f"--labels: one folder of labels belongs to one sequence, and there are {len(names)}; labels/ in "
            "the folder of each sequence is found without this option"
        )


def note_unused_boxes(
    options: argparse.Namespace,
    configs: Iterable[MethodConfig],
    who: str = "no method of the table uses",
    what_remains: str = "",
) -> None:
    """Print a note if --labels or --detector has been typed, and no configuration uses boxes.

    who : the words before "the boxes", such as "viso2 does not use". what_remains : the end of the note.
    """
    if any(config.filter.uses_boxes for config in configs):
        return
    for name in ("labels", "detector"):
        if getattr(options, name) is not None:
            print_wrapped(f"note: {who} the boxes of --{name}{what_remains}")


class Opener:
    """The sequences of a table by name, with the boxes of --detector for the classes of a configuration.

    A call with a name and a configuration returns the sequence. Its boxes are detected by the first call that
    needs them, once for all configurations with the same classes.

    Parameters
    ----------
    durations : gets the time of the detector.

    Attributes
    ----------
    names : names of the sequences.
    """

    def __init__(self, sequences: list[Sequence], options: argparse.Namespace, durations: Durations):
        self._sequences = {sequence.name: sequence for sequence in sequences}
        self.names = [sequence.name for sequence in sequences]
        self._options = options
        self._detected_by_classes: dict[tuple[str, tuple[str, ...]], Sequence] = {}  # by name and classes
        self._durations = durations
        self._unlabelled_by_name: dict[str, int] = {}  # numbers of images, as in `_unlabelled_images`

    def undetected(self, name: str, config: MethodConfig) -> Sequence:
        """The sequence as it was opened, without the boxes of --detector; parameters as in a call."""
        return self._sequences[name]

    def detector_of(self, job: Job) -> dict[str, Any] | None:
        """The record of --detector if it is to detect the boxes of a job; otherwise None."""
        if self._options.detector is None or not self._unlabelled_images(job.sequence):
            return None
        return detection_record(
            self._options.detector, DetectorConfig(), job.config.filter.classes, self._options.provider
        )

    def __call__(self, name: str, config: MethodConfig) -> Sequence:
        """The sequence with its labels if every image has a label file, else with the boxes of --detector."""
        sequence = self._sequences[name]
        if self._options.detector is None or not self._unlabelled_images(sequence):
            return sequence
        key = (name, config.filter.classes)
        if key not in self._detected_by_classes:
            self._detected_by_classes[key] = self._detect(sequence, config)
        return self._detected_by_classes[key]

    def _unlabelled_images(self, sequence: Sequence) -> int:
        """The number of images without a label file; the folder is read by the first call alone."""
        if sequence.name not in self._unlabelled_by_name:
            self._unlabelled_by_name[sequence.name] = len(missing_labels(sequence))
        return self._unlabelled_by_name[sequence.name]

    def _detect(self, sequence: Sequence, config: MethodConfig) -> Sequence:
        """The sequence with the boxes of --detector; a note says that labels of some images do not count."""
        if sequence.labels is not None:
            unlabelled = self._unlabelled_images(sequence)
            print_wrapped(
                f"note: {sequence.name}: {unlabelled} of {len(sequence)} images have no label file, so the "
                "boxes of all images are those of --detector"
            )
        return with_detected_boxes(
            sequence,
            self._options,
            classes=config.filter.classes,
            option=TYPED_SET_CLASSES,
            durations=self._durations,
        )


def with_detected_boxes(
    sequence: Sequence,
    options: argparse.Namespace,
    config: DetectorConfig | None = None,
    classes: tuple[str, ...] = (VEHICLES,),
    option: str = TYPED_CLASSES,
    durations: Durations | None = None,
) -> Sequence:
    """The sequence, with the boxes of --detector if the option is present; the cache stores the boxes.

    classes : the classes to detect (setting filter.classes); option : how they are typed, as in
    `naming_classes`; durations : gets the time of the images in which the detector ran.
    """
    if options.detector is None:
        return sequence
    if options.detector == "street" and not sequence.name.startswith(SYNTHETIC):
        print_wrapped(
            f"warning: `street` was trained on drawn streets; its boxes on {sequence.name} may be wrong"
        )
    label = f"detecting vehicles in {sequence.name}"

    def add_time(images: int, seconds: float) -> None:
        if durations is not None:
            durations.add(Task(DETECTION, images), seconds)

    with reporting(label) as report, continues_when_repeated(), naming_classes(option):
        sequence = labelled_sequence(
            sequence,
            options.detector,
            config,
            classes=classes,
            provider=options.provider,
            cache=options.cache,
            progress=report,
            detected=add_time,
        )
    warn_without_vehicles(sequence)
    return sequence


@contextmanager
def naming_classes(option: str) -> Iterator[None]:
    """Errors on the choice of classes say how to type it; `option` : text such as "--filter.classes {}"."""
    try:
        yield
    except ClassesError as error:
        typed = option.format(shlex.quote(error.value))
        raise DataError(f"{error.problem} {typed}{error.condition}") from None


def remarks_on_labels(
    runs: Iterable[tuple[Sequence, MethodConfig]], option: str, with_name: bool = False
) -> list[str]:
    """Remarks on the label folders of runs that remove features in boxes, each once.

    option : how filter.classes is typed, as in `naming_classes`; with_name : begin with the sequence's name.

    Raises `DataError` if a label file is invalid or no box can count.
    """
    choices: dict[tuple[str, tuple[str, ...]], Sequence] = {}
    for sequence, config in runs:
        if config.filter.uses_boxes:
            choices[sequence.name, config.filter.classes] = sequence
    remarks: dict[str, None] = {}
    with naming_classes(option):
        for (_, classes), sequence in choices.items():
            prefix = f"{sequence.name}: " if with_name else ""
            remarks |= dict.fromkeys(prefix + remark for remark in label_remarks(sequence, classes))
    return list(remarks)


def warnings_without_boxes(runs: Iterable[tuple[str, Sequence, MethodConfig]]) -> list[str]:
    """A warning about sequences without boxes, if a method removes features in boxes.

    runs : the name of the method, the sequence and the settings of each run.
    """
    without: dict[str, None] = {}
    methods: dict[str, None] = {}  # those whose preset is solution_selection with a box rule
    for method, sequence, config in runs:
        if sequence.labels is None and config.filter.uses_boxes:
            without[sequence.name] = None
            if VARIANTS[config.variant][method].filter.uses_boxes:
                methods[method] = None
    if not without:
        return []
    consequence = "as with filter.rule none"
    if methods:
        are = "is" if len(methods) == 1 else "are"
        consequence = f"so {' and '.join(methods)} {are} equal to solution_selection"
    effect = f"No vehicle boxes for {', '.join(without)}: no features are removed, {consequence}."
    return [f"{effect} {DETECT}."]


def warn_without_vehicles(sequence: Sequence) -> None:
    """Print a warning if a detector's labels of the sequence have no box at all."""
    if not any(len(sequence.labelled_boxes(index)) for index in range(len(sequence))):
        images = f"the {len(sequence)} images of {sequence.name}"
        print_wrapped(f"warning: the detector found no vehicle in {images}: no features are removed")
