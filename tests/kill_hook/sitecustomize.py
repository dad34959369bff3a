"""Sends a signal to its own process group at one moment of a command; see `test_kills.py`.

Python imports a module of this name at its start, so the worker processes of a command have it, too. The
variable KILL_AT has the signal's number, how often the moment is passed in a process until it counts, and a
pattern for the name under which a file appears, or `image` for each image that OpenCV reads or writes.
"""

import os
import sys
import time
from collections.abc import Callable
from fnmatch import fnmatchcase
from typing import Any

number, count, pattern = os.environ["KILL_AT"].split()
left = int(count)


def pass_by(name: str) -> None:
    """Send the signal if the name is that of the moment."""
    global left
    if fnmatchcase(name, pattern):
        left -= 1
        if left == 0:
            os.killpg(0, int(number))
            time.sleep(1)  # in a thread or a worker: the main thread has time to end the command


def see_event(event: str, arguments: tuple[Any, ...]) -> None:
    """Python calls this before a file is renamed, with its old and new name."""
    if event == "os.rename":
        pass_by(os.fsdecode(arguments[1]))


def passing(function: Callable[..., Any]) -> Callable[..., Any]:
    def passed(*arguments: Any) -> Any:
        pass_by("image")
        return function(*arguments)

    return passed


sys.addaudithook(see_event)
if pattern == "image":
    import cv2

    for name in ("imread", "imdecode", "imwrite", "imencode"):
        setattr(cv2, name, passing(getattr(cv2, name)))
