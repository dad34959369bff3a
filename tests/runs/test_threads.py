"""Results do not depend on the number of threads, and a pool of processes ends with its context."""

from __future__ import annotations

import time
from pathlib import Path

import cv2
import pytest
from threadpoolctl import threadpool_limits

from vo_lib import open_sequence, preset, run
from vo_lib.config import change
from vo_lib.parallel import local_pool
from vo_lib.runs.drive import single_threaded


def test_number_of_threads_changes_no_byte(bands: Path) -> None:
    sequence, config = (
        open_sequence(bands),
        change(preset("solution_selection", variant="kit"), "features.cell", 10),
    )
    before, poses = cv2.getNumThreads(), []
    for threads in (4, 1):
        cv2.setNumThreads(threads)
        with threadpool_limits(limits=threads):
            poses.append(run(sequence, config).poses.tobytes())
        assert cv2.getNumThreads() == threads
    cv2.setNumThreads(before)
    assert poses[0] == poses[1]


def test_single_threaded_is_reentrant() -> None:
    before = cv2.getNumThreads()
    one, other = single_threaded(), single_threaded()
    one.__enter__()
    other.__enter__()
    one.__exit__(None, None, None)
    assert cv2.getNumThreads() == 1
    other.__exit__(None, None, None)
    assert cv2.getNumThreads() == before


def test_a_failed_run_does_not_limit_the_threads(bands: Path) -> None:
    """The limit ends with the run, not only when the caught error, which refers to the run, is forgotten."""

    def fail(done: int, total: int) -> None:
        raise ValueError(done)

    before = cv2.getNumThreads()
    cv2.setNumThreads(3)
    with pytest.raises(ValueError, match="1") as caught:
        run(open_sequence(bands), preset("solution_selection"), fail)
    assert caught.tb
    assert cv2.getNumThreads() == 3
    cv2.setNumThreads(before)


def test_a_pool_waits_for_its_calls_and_ends_them_after_an_error() -> None:
    with local_pool(2) as pool:
        futures = [pool.submit(time.sleep, 0.2) for _ in range(4)]
    assert all(future.done() for future in futures)
    start = time.monotonic()

    def broken() -> None:
        with local_pool(2) as pool:
            pool.submit(time.sleep, 60.0)
            raise KeyError

    with pytest.raises(KeyError):
        broken()
    assert time.monotonic() - start < 30.0
