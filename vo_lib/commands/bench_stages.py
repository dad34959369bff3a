"""What a machine needs for the method: time of every stage, memory, the cost of a detector."""

from __future__ import annotations

import os
import platform
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..config import Config, DetectorConfig
from ..core.frame import Clock
from ..core.matches import StereoMatches
from ..core.types import Progress
from ..data.sequence import Sequence
from ..detection.label_cache import detected_sequence
from ..detection.yolo import YoloDetector
from ..runs.identity import surroundings, versions
from ..runs.match_cache import CHUNK, pack, unpack
from ..runs.results import timing
from ..runs.runner import FoundMatches, TimedMatches, run_methods
from .bench_matches import FeatureErrors, feature_errors
from .bench_solver import Precision, microseconds_a_set, precision

BACK_END_RUNS = 3
ALONE = 60  # images, from the first, of which a detector is timed alone


@dataclass(frozen=True)
class Effort:
    """How much a bench does: repeats of a timed call, and problems of each kind for the precision."""

    repeats: int = 40
    problems: int = 20000
    problems_of_others: int = 2000


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


@dataclass(frozen=True)
class Bench:
    """Figures of one machine. Other work on it lengthens times of the wall clock, which they are if not said.

    Attributes
    ----------
    machine : processor, cores, versions, and `load`, how many processes wanted to run before the bench.
    sequence : name, frames, width and height, method, and the mean number of matches a frame.
    ms_a_frame_of : mean of each stage; whole_run_ms_a_frame : from start to end.
    processor_ms_a_frame : processor time of the whole run, all threads; decoding_ms_a_frame : of decoding the
        same images and no more, in one thread.
    back_end_from_cache_ms_a_frame : from matches read out of a cache to the motion; least of several runs.
    peak_memory_mb : of the process until the sequence was done, the bench's own store of matches included;
        None where the system does not tell.
    five_point_us_a_set : by solver; five_point_precision : rows of its table.
    features : by "inside boxes" and "outside boxes"; None where there is no truth of single pixels.
    detector : what a detector costs; None where none was asked for.
    """

    machine: dict[str, Any]
    sequence: dict[str, Any]
    ms_a_frame_of: dict[str, float]
    whole_run_ms_a_frame: float
    processor_ms_a_frame: float
    decoding_ms_a_frame: float
    back_end_from_cache_ms_a_frame: float
    peak_memory_mb: float | None
    five_point_us_a_set: dict[str, float]
    five_point_precision: list[Precision]
    features: dict[str, FeatureErrors] | None
    detector: DetectorBench | None = None


def run_bench(
    sequence: Sequence,
    method: str,
    config: Config,
    effort: Effort,
    progress: Progress | None = None,
    detector: str | None = None,
) -> Bench:
    """Run the method over a sequence with a clock, then its parts alone; `progress` counts frames and parts.

    Parameters
    ----------
    detector : name or file of a model whose cost is measured too.

    Raises
    ------
    DataError : the sequence cannot be read, or the detector cannot be used.
    """
    loaded = None if detector is None else YoloDetector(detector, DetectorConfig())  # refused at once
    steps = len(sequence) * (2 + BACK_END_RUNS) + 2
    if loaded is not None:
        steps += min(ALONE, len(sequence)) + len(sequence)
    done = 0

    def advance(count: int = 1) -> None:
        nonlocal done
        done += count
        if progress is not None:
            progress(done, steps)

    machine = describe_machine()
    found = _Recorded(FoundMatches(sequence, config.features, config.matching))
    start, used = time.perf_counter(), time.process_time()
    result = run_methods(sequence, {"": config}, lambda *_: advance(), found)[""]
    whole, used = time.perf_counter() - start, time.process_time() - used
    memory = peak_memory()
    decoding = time.process_time()
    for i in range(len(sequence)):
        sequence.stereo(i)
        advance()
    decoding = time.process_time() - decoding
    packed = [pack(found.matches[i : i + CHUNK]) for i in range(0, len(sequence), CHUNK)]
    back_end = []
    for _ in range(BACK_END_RUNS):
        start = time.perf_counter()
        run_methods(sequence, {"": config}, matches=_read(packed))
        back_end.append(time.perf_counter() - start)
        advance(len(sequence))
    solver = microseconds_a_set(effort.repeats)
    advance()
    solver_precision = precision(effort.problems, effort.problems_of_others)
    advance()
    cost = None if loaded is None else time_detector(sequence, loaded, config, advance)
    what = {
        "name": sequence.name,
        "frames": len(sequence),
        "width_px": sequence.camera.width,
        "height_px": sequence.camera.height,
        "method": method,
        "matches_a_frame": float(np.mean([len(matches) for matches in found.matches[1:]])),
    }
    return Bench(
        machine,
        what,
        timing(result)["ms_per_frame_of"],
        1e3 * whole / len(sequence),
        1e3 * used / len(sequence),
        1e3 * decoding / len(sequence),
        1e3 * min(back_end) / len(sequence),
        memory,
        solver,
        solver_precision,
        feature_errors(sequence, found.matches, config),
        cost,
    )


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


class _Recorded:
    """Matches as they are found, and kept."""

    def __init__(self, found: FoundMatches):
        self.found = found
        self.matches: list[StereoMatches] = []

    def __iter__(self) -> Iterator[TimedMatches]:
        for matches, ms in self.found:
            self.matches.append(matches)
            yield matches, ms


def _read(packed: list[bytes]) -> Iterator[TimedMatches]:
    """Matches out of the bytes of a cache's files."""
    for data in packed:
        clock = Clock()
        frames = unpack(data)
        clock.stage("cached_matches")
        yield from (
            (matches, {"cached_matches": clock.ms["cached_matches"] / len(frames)}) for matches in frames
        )


def describe_machine() -> dict[str, Any]:
    """Processor, cores that may be used, load, system, commit and versions."""
    affinity = getattr(os, "sched_getaffinity", None)
    return {
        "processor": processor_name(),
        "cores": len(affinity(0)) if affinity is not None else os.cpu_count(),
        "load": round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else None,
        **surroundings(),
        **versions(),
    }


def processor_name() -> str:
    """The processor's name as the system gives it."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def peak_memory() -> float | None:
    """Largest memory of this process so far, megabytes; None where the system does not tell (Windows)."""
    if sys.platform == "win32":
        return None
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1e6 if sys.platform == "darwin" else 1e3)
