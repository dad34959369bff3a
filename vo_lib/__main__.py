"""Entry point of the `vo` command and of `python -m vo_lib`."""

import os
import sys

# Log messages of OpenCV and FFmpeg would appear next to the one-line errors of `vo`.
os.environ |= {"OPENCV_LOG_LEVEL": "FATAL", "OPENCV_FFMPEG_LOGLEVEL": "-8"} | os.environ

from .commands.cli import main

if __name__ == "__main__":
    sys.exit(main())
