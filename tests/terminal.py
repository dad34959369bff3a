"""A command in a terminal of some width, as a person sees it."""

from __future__ import annotations

import fcntl
import os
import re
import struct
import subprocess
import sys
import termios
from collections.abc import Iterable

ESCAPES = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]|\r(?!\n)")


def shown_in_terminal(words: Iterable[str], columns: int = 80, code: str = "") -> list[str]:
    """The lines that `vo` with these arguments shows, without the progress bars' control sequences.

    code : Python code that runs instead of `vo`.
    """
    program = ["-c", code] if code else ["-m", "vo_lib"]
    keeper, terminal = os.openpty()
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
    environment = {name: value for name, value in os.environ.items() if name not in ("COLUMNS", "LINES")}
    environment["TERM"] = "dumb"
    process = subprocess.Popen(
        [sys.executable, *program, *words], stdout=terminal, stderr=terminal, env=environment
    )
    os.close(terminal)
    shown = b""
    while True:
        try:
            piece = os.read(keeper, 65536)
        except OSError:  # Linux's way to say that the other end is closed
            break
        if not piece:
            break
        shown += piece
    os.close(keeper)
    process.wait()
    return ESCAPES.sub("", shown.decode()).replace("\r\n", "\n").splitlines()
