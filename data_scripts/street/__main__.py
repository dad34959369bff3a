"""A helper process of `write_scene`: `python -m street FOLDER FIRST STEP` draws its share."""

import sys
from pathlib import Path

from .folder import draw_share

draw_share(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
