"""All scenes on one sheet for a person: a frame of each with its boxes."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from vo_lib.data.scenes import SCENES

from .render import Renderer
from .sensor import photograph
from .truth_files import visible_boxes
from .world import make_world

Picture = NDArray[np.uint8]
WIDTH, COLUMNS = 620, 2  # pixels of one picture, and pictures side by side
WHEN = 0.4  # of the drive
MOVING, STANDING, WHITE = (0, 94, 213), (233, 180, 86), (255, 255, 255)  # BGR


def contact_sheet() -> Picture:
    """One picture of each scene with its name; moving vehicles in orange boxes, standing ones in blue."""
    tiles = []
    for name, config in SCENES.items():
        world = make_world(config)
        frame = round(WHEN * (len(world.drive.times) - 1))
        view, grey = photograph(Renderer(world), frame)
        picture, moving = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), world.moving()[frame]
        for box in visible_boxes(world, frame, view):
            colour = MOVING if moving[box.vehicle] else STANDING
            cv2.rectangle(picture, (box.left, box.top), (box.right, box.bottom), colour, 2)
        height = round(WIDTH * picture.shape[0] / picture.shape[1])
        tile = cv2.resize(picture, (WIDTH, height), interpolation=cv2.INTER_AREA)
        cv2.rectangle(tile, (0, 0), (16 + 11 * len(name), 24), (30, 30, 30), -1)
        cv2.putText(tile, name, (8, 17), cv2.FONT_HERSHEY_SIMPLEX, 0.55, WHITE, 1, cv2.LINE_AA)
        tiles.append(cv2.copyMakeBorder(tile, 2, 2, 2, 2, cv2.BORDER_CONSTANT, value=WHITE))
    rows = [np.hstack(tiles[k : k + COLUMNS]) for k in range(0, len(tiles), COLUMNS)]
    return np.asarray(np.vstack(rows), np.uint8)
