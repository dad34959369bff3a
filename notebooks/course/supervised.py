"""A command whose processes all end with it, also those that left its session.

    python supervised.py COMMAND …

On Linux, a process whose parent has ended becomes a child of this process, so every process that the command started
can be found below it. On other POSIX systems, only the processes in the command's session end. SIGTERM ends them all
at once.
"""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from types import FrameType

PR_SET_CHILD_SUBREAPER = 36  # of prctl(2)
AT_MOST_S = 10.0  # a command that starts processes faster than they are ended is left after this time


class Stopped(BaseException):
    """SIGTERM has arrived."""


def main(command: list[str]) -> int:
    """Run the command, end what it leaves, and return its exit status (128 and the number, for a signal)."""
    linux = sys.platform == "linux"
    if linux:
        ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    signal.signal(signal.SIGTERM, _stop)
    process = None
    try:
        process = subprocess.Popen(command, start_new_session=True)
        status = process.wait()
    except Stopped:
        status = -signal.SIGTERM
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        if linux:
            _end_descendants()
        elif process is not None:
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(process.pid, signal.SIGKILL)
    return status if status >= 0 else 128 - status


def _stop(number: int, frame: FrameType | None) -> None:
    raise Stopped


def _end_descendants() -> None:
    """End the processes below this one until none is left."""
    until = time.monotonic() + AT_MOST_S
    while time.monotonic() < until:
        below = _descendants()
        for pid in below:
            _kill(pid)
        with suppress(ChildProcessError):
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass
        if not below:
            return
        time.sleep(0.01)


def _descendants() -> set[int]:
    """The processes below this one, at this moment."""
    parents = dict[int, int]()
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            parents[int(folder.name)] = _parent(int(folder.name))
    below = {os.getpid()}
    while more := {pid for pid, parent in parents.items() if parent in below} - below:
        below |= more
    return below - {os.getpid()}


def _parent(pid: int) -> int:
    """The parent of a process; 0 for a process that is gone."""
    with suppress(OSError):
        # The name of the program, in brackets, may contain anything.
        return int(Path(f"/proc/{pid}/stat").read_bytes().rpartition(b")")[2].split()[1])
    return 0


def _kill(pid: int) -> None:
    """End a process below this one. Its number may belong to another process by now, which is never ended."""
    with suppress(OSError):
        handle = os.pidfd_open(pid)
        try:
            if pid in _descendants():  # seen after the handle was taken, so the handle is this process
                signal.pidfd_send_signal(handle, signal.SIGKILL)
        finally:
            os.close(handle)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
