"""`vo`, also as `python -m vo_lib`: what must be right before the first second, that of imports, is over."""

from __future__ import annotations

import os
import signal
import sys
import warnings


def main() -> int:
    """The exit code of the command, 130 where Ctrl-C ends it, at any moment."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed by the shell: >&-
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115  (for the whole program)
    ignored = signal.getsignal(signal.SIGINT) is signal.SIG_IGN  # by nohup
    if not ignored:
        signal.signal(signal.SIGINT, _stop)
    if not sys.warnoptions:  # what overflows is seen and said by the kit itself, here and in its processes
        warnings.simplefilter("ignore", RuntimeWarning)
        os.environ["PYTHONWARNINGS"] = "ignore::RuntimeWarning"
    # What OpenCV and its FFmpeg say of a full disk or a damaged film would stand beside the kit's own line.
    os.environ |= {"OPENCV_LOG_LEVEL": "FATAL", "OPENCV_FFMPEG_LOGLEVEL": "-8"} | os.environ
    from .commands.cli import main as command

    if not ignored:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        return command()
    finally:
        if not ignored:
            signal.signal(signal.SIGINT, _stop)  # while Python tidies up


def _stop(*details: object) -> None:
    """End at once: nothing is begun, or all is done."""
    os.write(2, b"vo: interrupted\n")
    os._exit(130)


if __name__ == "__main__":
    sys.exit(main())
