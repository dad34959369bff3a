"""What a vehicle detector costs: the network alone, and the whole run with it."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ..config import Config
from ..data.sequence import Sequence
from ..detection.label_cache import detected_sequence
from ..detection.yolo import YoloDetector
from ..runs.runner import run_methods

ALONE = 60  # images, from the first, of which the detector is timed alone


@dataclass(frozen=True)
class DetectorBench:
    """Times of the wall clock with one detector.

    Attributes
    ----------
    model : its file's name; threads : of the network; width_px, height_px : of its images.
    alone_ms_an_image : from the decoded image to the boxes, nothing else running.
    whole_run_ms_a_frame : every frame detected, the model's loading included.
    """

    model: str
    threads: int
    width_px: int
    height_px: int
    alone_ms_an_image: float
    whole_run_ms_a_frame: float


def time_detector(
    sequence: Sequence, detector: YoloDetector, config: Config, advance: Callable[[], None]
) -> DetectorBench:
    """Time the detector alone, then a whole run of `config`; `advance` is called after each image."""
    count = min(ALONE, len(sequence))
    alone = 0.0
    for i in range(count):
        left, _ = sequence.stereo(i)
        start = time.perf_counter()
        detector.detect(left)
        alone += time.perf_counter() - start
        advance()
    with tempfile.TemporaryDirectory() as cache:  # none of the boxes is there yet
        start = time.perf_counter()
        with detected_sequence(sequence, detector.path, detector.config, cache=Path(cache)) as detected:
            run_methods(detected, {"": config}, lambda *_: advance())
        whole = time.perf_counter() - start
    size = detector.input_size(sequence.camera.width, sequence.camera.height)
    threads = detector.config.threads
    return DetectorBench(detector.path.name, threads, *size, 1e3 * alone / count, 1e3 * whole / len(sequence))
