"""The truth of a drawn street: depth, instances, objects and boxes, and the formats of their files.

Depth is a 16-bit PNG with the rounded code 1 + 65534 · ln(z / 0.25 m) / ln(3000 m / 0.25 m), or 0 for the
sky; a code step is 1.4e-4 of the depth. Instances are an 8-bit PNG (16-bit for many instances): 0 for street
and sky, k + 1 for vehicle k, K + k + 1 for its shadow.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vo_lib.geometry.boxes import Boxes
from vo_lib.geometry.motion import inverse, transform
from vo_lib.geometry.types import Array

from .render import NEAR, View
from .world import World

MIN_CODED_DEPTH_M = 0.25  # of the first code
MAX_CODED_DEPTH_M = 3000.0  # of the last code
LOG_DEPTH_RANGE = np.log(MAX_CODED_DEPTH_M / MIN_CODED_DEPTH_M)
# The smallest visible vehicle with a box: its pixels, the height of the box, and the visible share.
MIN_PIXELS = 100
MIN_HEIGHT = 12
MIN_SHARE = 0.2


def encode_depth(inverse_depth: NDArray[np.float32]) -> NDArray[np.uint16]:
    """Depth codes (H, W) of 1/Z (H, W) in 1/metre; code 0 is the sky."""
    visible = inverse_depth > 0
    z = 1.0 / np.where(visible, inverse_depth, 1.0)
    share = np.log(np.clip(z, MIN_CODED_DEPTH_M, MAX_CODED_DEPTH_M) / MIN_CODED_DEPTH_M) / LOG_DEPTH_RANGE
    return np.asarray(np.where(visible, 1.5 + 65534.0 * share, 0.0), np.uint16)


def decode_depth(code: NDArray[np.uint16]) -> Array:
    """Depth (H, W), metres, of depth codes (H, W); infinite for the sky."""
    z = MIN_CODED_DEPTH_M * np.exp((code.astype(np.float64) - 1.0) / 65534.0 * LOG_DEPTH_RANGE)
    return np.asarray(np.where(code > 0, z, np.inf))


def visible_boxes(
    world: World,
    frame: int,
    view: View,
    min_pixels: int = MIN_PIXELS,
    min_height: int = MIN_HEIGHT,
) -> Boxes:
    """Boxes around the visible part of each vehicle in the left image, with COCO's class numbers.

    A box ends at the outer borders of its first and its last pixel. A vehicle is skipped if it has fewer than
    `min_pixels` visible pixels, if the height of its box is under `min_height` pixels, or if less than
    `MIN_SHARE` of its outline within the image is visible.
    """
    count = len(world.vehicles)
    corners = []
    kinds = []
    pixels = np.bincount(view.instance.ravel(), minlength=count + 1)
    for number in range(1, count + 1):
        area = int(pixels[number])
        if area < min_pixels:
            continue
        mask = view.instance == number
        rows = np.flatnonzero(mask.any(axis=1))
        columns = np.flatnonzero(mask.any(axis=0))
        tall_enough = rows[-1] - rows[0] + 1 >= min_height
        if tall_enough and area >= MIN_SHARE * outline_area(world, number - 1, frame):
            corners.append((columns[0] - 0.5, rows[0] - 0.5, columns[-1] + 0.5, rows[-1] + 0.5))
            kinds.append(world.vehicles[number - 1].model.shape.kind)
    xyxy = np.array(corners, np.float64).reshape(-1, 4)
    return Boxes(xyxy, np.array(kinds, np.int64), np.ones(len(kinds)))


def outline_area(world: World, vehicle: int, frame: int) -> float:
    """Numbers of visible and hidden pixels inside the convex outline of a vehicle in the left image."""
    camera = world.config.camera
    one = world.vehicles[vehicle]
    T_c_o = inverse(world.drive.poses[frame]) @ one.poses[frame]
    corners = transform(T_c_o, one.model.faces.corners.reshape(-1, 3))
    corners = corners[corners[:, 2] > NEAR]
    if len(corners) < 3:
        return 0.0
    hull = cv2.convexHull(camera.project(corners)[0].astype(np.float32))
    width = camera.width
    height = camera.height
    # The outer corners of the image: pixel centres are at integers.
    borders = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32) - np.float32(0.5)
    area, _ = cv2.intersectConvexConvex(hull, borders)
    return float(area)


def write_objects(world: World, path: Path) -> None:
    """Write an npz file with the poses T_w_o (N, K, 4, 4) and the COCO classes (K,) of all vehicles."""
    T_w_s = inverse(world.drive.poses[0])
    poses = np.zeros((len(world.drive.times), len(world.vehicles), 4, 4))
    for k, vehicle in enumerate(world.vehicles):
        poses[:, k] = T_w_s @ vehicle.poses
    kinds = [vehicle.model.shape.kind for vehicle in world.vehicles]
    np.savez_compressed(path, kind=np.array(kinds, np.int64), poses=poses)
