"""Entry point of the `vo` command and of `python -m vo_lib`."""

import os
import sys

# Log messages of OpenCV and FFmpeg would appear next to the one-line errors of `vo`. The variables count only
# if they are set before the import; those that the caller has set stay.
os.environ.setdefault("OPENCV_LOG_LEVEL", "FATAL")
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")

from .commands.cli import main

if __name__ == "__main__":
    sys.exit(main())
