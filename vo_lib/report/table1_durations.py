"""How long the methods and seeds of a table would take on all of KITTI's sequences with truth."""

from __future__ import annotations

from collections.abc import Hashable

from ..data.catalogue import KITTI
from ..data.kitti import EXPECTED_FRAMES
from ..runs.durations import DETECTION, Durations, Task, duration_words
from ..runs.jobs import Job, matching_task, running_task
from .table1 import LEFT_OUT, SUB_SEQUENCES


def kitti_duration(jobs: list[Job], durations: Durations, detects: bool = False) -> list[str]:
    """A sentence on how long these methods and seeds would take on all of KITTI's sequences 00-10.

    There is none if the jobs are on all of these sequences as a whole, or on none of them.

    detects : whether a detector is to detect the boxes.
    """
    frames_of_kitti = _frames_of_kitti()
    of_kitti = [job for job in jobs if job.sequence.name in frames_of_kitti]
    frames_of_jobs = {job.sequence.name: len(job.sequence) for job in of_kitti}
    if not of_kitti or frames_of_jobs == frames_of_kitti:
        return []
    seconds = kitti_seconds(of_kitti, durations)
    total = sum(frames_of_kitti.values())
    start = f"All of KITTI 00-10 ({total:,} frames), the same methods and seeds"
    if seconds is None:
        return [
            f"{start}: the time is not known, since matches or runs were kept from another processor or an "
            "earlier version."
        ]
    processes = "1 process" if durations.workers == 1 else f"{durations.workers} processes"
    matching, running = _kinds_of(of_kitti)
    are_measured = [durations.has_measured(kind) for kind in [*matching, *running]]
    if all(are_measured):
        source = "these runs"
    elif any(are_measured):
        source = "these runs and the times of kept ones"
    else:
        source = "the times of kept runs"
    sentence = f"{start}: about {duration_words(seconds)} ({processes}), extrapolated from {source}"
    detection = durations.seconds_of(Task(DETECTION, total))
    if detection is not None:
        sentence += f", and {duration_words(detection)} for the detector"
    elif detects:
        sentence += "; the time of the detector, whose boxes were kept ones, is not counted"
    return [f"{sentence}."]


def kitti_seconds(jobs: list[Job], durations: Durations) -> float | None:
    """Estimated seconds of methods and seeds on all of KITTI's sequences 00-10; None if a kind is unknown.

    From short runs, the estimate is too large rather than too small, since each run also writes its files.

    jobs : runs of these methods and seeds, on one sequence or more. Those on the first sequence tell the
        kinds of runs, since the others repeat them.
    durations : of runs on images of the same size, with as many processes at the same time.
    """
    frames = _frames_of_kitti().values()
    matching, running = _kinds_of(jobs)
    return durations.estimate(
        [Task(kind, count) for kind in matching for count in frames],
        [Task(kind, count) for kind in running for count in frames],
    )


def _kinds_of(jobs: list[Job]) -> tuple[list[Hashable], list[Hashable]]:
    """The kinds of work on a sequence: of the front ends, each once, and of the runs, once for each seed."""
    matching = dict.fromkeys(matching_task(job).kind for job in jobs)
    running = [running_task(job).kind for job in jobs if job.sequence.name == jobs[0].sequence.name]
    return list(matching), running


def _frames_of_kitti() -> dict[str, int]:
    """Numbers of frames of KITTI's sequences 00-10 by name."""
    return {f"{KITTI}{number}": EXPECTED_FRAMES[number] for number in (LEFT_OUT, *SUB_SEQUENCES)}
