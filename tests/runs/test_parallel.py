"""Tasks in several processes: each has its own end, whatever becomes of the others."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import loky
import pytest

from vo_lib import DataError
from vo_lib.runs.parallel import KILLED, parallel


def write(item: tuple[Path, str]) -> None:
    """What a test asks for, and a mark that it was done."""
    folder, name = item
    with open(folder / name, "a", encoding="utf-8") as file:
        file.write("x")
    if name.startswith("bad input"):
        raise DataError("the image is black", folder, 3)
    if name.startswith("bug"):
        raise ZeroDivisionError("one\nby none")
    if name.startswith("dies"):
        os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.parametrize("workers", [1, 2])
def test_a_task_that_fails_says_why_and_the_others_finish(tmp_path: Path, workers: int) -> None:
    names = ["a", "bad input", "b", "bug", "c"]
    done = parallel(write, [(tmp_path, name) for name in names], workers)
    assert [cause is None for cause in done] == [True, False, True, False, True]
    assert done[1] == f"{tmp_path}, line 3: the image is black"
    assert str(done[3]).startswith("ZeroDivisionError: one by none (test_parallel.py, line ")
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names)


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_a_killed_process_is_the_end_of_its_own_task_only(tmp_path: Path) -> None:
    names = ["a", "dies", "b", "c", "dies too", "d"]
    done = parallel(write, [(tmp_path, name) for name in names], 2)
    assert done == [None, KILLED, None, None, KILLED, None]
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names)


def test_no_more_processes_start_than_there_are_tasks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked, make = [], loky.ProcessPoolExecutor

    def watched(workers: int, **settings: Any) -> Any:
        asked.append(workers)
        return make(workers, **settings)

    monkeypatch.setattr(loky, "ProcessPoolExecutor", watched)
    assert parallel(write, [(tmp_path, "a"), (tmp_path, "b")], 1000) == [None, None]
    assert parallel(write, [], 1000) == []
    assert asked == [2]


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize("sent", ["SIGINT", "SIGKILL"])
def test_no_process_outlives_the_first(tmp_path: Path, sent: str) -> None:
    code = (
        "import sys, time; from pathlib import Path; from vo_lib.runs.parallel import parallel\n"
        "sys.path.insert(0, sys.argv[2]); from test_parallel import linger\n"
        "parallel(linger, [Path(sys.argv[1]) / str(i) for i in range(4)], 2)"
    )
    command = [sys.executable, "-c", code, str(tmp_path), str(Path(__file__).parent)]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)
    try:
        while len([path for path in tmp_path.iterdir() if path.stat().st_size]) < 2:
            assert process.poll() is None
            time.sleep(0.05)
        if sent == "SIGINT":
            os.killpg(process.pid, signal.SIGINT)  # as a terminal does
        else:
            process.kill()
        _, error = process.communicate(timeout=60)
    finally:
        process.kill()
    assert sent == "SIGKILL" or error.splitlines()[-1] == "KeyboardInterrupt"
    workers = [int(path.read_text(encoding="utf-8")) for path in tmp_path.iterdir()]
    assert len(workers) == 2
    given_up = time.monotonic() + 10.0
    while any(map(is_alive, workers)):
        assert time.monotonic() < given_up
        time.sleep(0.1)


def linger(path: Path) -> None:
    """Say who works, and take long."""
    path.write_text(str(os.getpid()), encoding="utf-8")
    time.sleep(600)


def is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    # A zombie, whose parent is gone and which nobody waits for, has ended too.
    stat = Path(f"/proc/{process}/stat")
    return not (stat.exists() and stat.read_text().rpartition(")")[2].split()[0] == "Z")


def test_a_scheduler_that_is_not_there_is_bad_input(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr("vo_lib.runs.parallel.CONNECT", 0.5)
    with pytest.raises(DataError, match="no scheduler answers there"):
        parallel(write, [(Path(), "a")], scheduler="tcp://127.0.0.1:1")
    with pytest.raises(DataError, match="expected an address such as tcp://"):
        parallel(write, [(Path(), "a")], scheduler="somewhere")
