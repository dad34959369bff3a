"""Pictures of scenes for a person: one frame with its boxes, and all scenes on one sheet."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from .blur import smear
from .render import Renderer
from .scenes import SCENES, SceneConfig, scene_config
from .sensor import expose, exposures
from .truth_files import visible_boxes
from .world import make_world

Picture = NDArray[np.uint8]


def preview(config: SceneConfig, share: float = 0.4, boxes: bool = True) -> Picture:
    """The left picture (H, W, 3) of the frame at a share of the drive; boxes round what is labelled."""
    world = make_world(config)
    frame = round(share * (len(world.drive.times) - 1))
    view = Renderer(world).view(frame)
    exposure = float(exposures(config, world.drive.times)[frame])
    grey = expose(smear(world, frame, view, right=False), config, exposure, frame, right=False)
    picture = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
    moving = world.moving()[frame]
    for box in visible_boxes(world, frame, view) if boxes else []:
        colour = (0, 94, 213) if moving[box.vehicle] else (233, 180, 86)
        cv2.rectangle(picture, (box.left, box.top), (box.right, box.bottom), colour, 2)
    return np.asarray(picture, np.uint8)


def contact_sheet(
    names: Sequence[str] = tuple(SCENES), width: int = 620, columns: int = 2, boxes: bool = True
) -> Picture:
    """One picture of each scene with its name; moving vehicles in orange boxes, standing ones in blue.

    Parameters
    ----------
    names : of scenes. width : of one picture, pixels. columns : pictures side by side.
    """
    tiles = []
    for name in names:
        picture = preview(scene_config(name), boxes=boxes)
        height = round(width * picture.shape[0] / picture.shape[1])
        tile = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
        cv2.rectangle(tile, (0, 0), (16 + 11 * len(name), 24), (30, 30, 30), -1)
        cv2.putText(tile, name, (8, 17), cv2.FONT_HERSHEY_SIMPLEX, 0.55, (255, 255, 255), 1, cv2.LINE_AA)
        tiles.append(cv2.copyMakeBorder(tile, 2, 2, 2, 2, cv2.BORDER_CONSTANT, value=(255, 255, 255)))
    while len(tiles) % columns:
        tiles.append(np.full_like(tiles[0], 255))
    rows = [np.hstack(tiles[k : k + columns]) for k in range(0, len(tiles), columns)]
    return np.asarray(np.vstack(rows), np.uint8)
