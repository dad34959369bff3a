"""What a vehicle detector costs: the network alone, and the whole run with it."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..config import Config, DetectorConfig
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
    model : its file's name; threads : of the network; width, height : of its images, pixels.
    alone : milliseconds an image, from the decoded image to the boxes, nothing else running.
    whole : milliseconds a frame of the whole run, every frame detected, the model's loading included.
    """

    model: str
    threads: int
    width: int
    height: int
    alone: float
    whole: float

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain values for JSON, with units in the names."""
        return {
            "model": self.model,
            "threads": self.threads,
            "width_px": self.width,
            "height_px": self.height,
            "alone_ms_an_image": self.alone,
            "whole_run_ms_a_frame": self.whole,
        }


class DetectorTimer:
    """Times a model on a sequence. `DataError` at once where the model cannot be used.

    Attributes
    ----------
    steps : how often `measure` calls back.
    """

    def __init__(self, sequence: Sequence, model: str):
        self._sequence, self._model = sequence, model
        self._detector = YoloDetector(model, DetectorConfig())
        self._images = min(ALONE, len(sequence))
        self.steps = self._images + len(sequence)

    def measure(self, config: Config, advance: Callable[[], None]) -> DetectorBench:
        """Time the detector alone, then a whole run of `config`; `advance` is called after each image."""
        detector, sequence = self._detector, self._sequence
        size = detector.input_size(sequence.camera.width, sequence.camera.height)
        alone = 0.0
        for i in range(self._images):
            left, _ = sequence.stereo(i)
            start = time.perf_counter()
            detector.detect(left)
            alone += time.perf_counter() - start
            advance()
        with tempfile.TemporaryDirectory() as cache:  # none of the boxes is there yet
            start = time.perf_counter()
            with detected_sequence(sequence, self._model, detector.config, cache=Path(cache)) as detected:
                run_methods(detected, {"": config}, lambda *_: advance())
            whole = time.perf_counter() - start
        alone, whole = 1e3 * alone / self._images, 1e3 * whole / len(sequence)
        return DetectorBench(detector.path.name, detector.config.threads, *size, alone, whole)
