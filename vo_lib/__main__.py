"""`vo`, also as `python -m vo_lib`."""

import os
import sys

# Messages of OpenCV and its FFmpeg would stand beside the one line of an error.
os.environ |= {"OPENCV_LOG_LEVEL": "FATAL", "OPENCV_FFMPEG_LOGLEVEL": "-8"} | os.environ

from .commands.cli import main

if __name__ == "__main__":
    sys.exit(main())
