"""Exercises of chapter 5: letterbox inverse, cells, overlap, suppression, features in boxes, rule."""

from __future__ import annotations

import numpy as np

from vo_lib.core.boxes import overlap
from vo_lib.core.types import Array, Mask
from vo_lib.detection.yolo_layout import Letterbox, letterbox, yolox_cells

from ..checker import Case, Exercise

SIZE, NET = (1241, 376), (640, 640)  # width and height of an image, and of a network's with wide borders
WIDTH, HEIGHT = 800, 256  # of the network whose cells are counted
# The second overlaps the first much, the third both a little, the fourth none; the last is inside the first.
A, B, SIDE = [100.0, 100.0, 200.0, 180.0], [110.0, 104.0, 212.0, 184.0], [185.0, 110.0, 290.0, 190.0]
CORNERS = np.array([A, B, SIDE, [400.0, 90.0, 450.0, 130.0], [130.0, 120.0, 160.0, 150.0]])
SCORES = np.array([0.7, 0.9, 0.6, 0.3, 0.8])
KEPT, LOST = "on moving things, kept", "on standing things, removed"


def net_boxes() -> list[Case]:
    """Two boxes inside the image, one over its edge, and all three."""
    xyxy = np.array([[10.0, 240, 90.5, 300], [320, 280, 470, 360], [600, 250, 655, 420]])
    plan = letterbox(*SIZE, *NET)
    return [(boxes, plan.scale, plan.left, plan.top, *SIZE) for boxes in (xyxy[:2], xyxy[2:], xyxy)]


def in_image(xyxy: Array, scale: float, left: int, top: int, width: int, height: int) -> Array:
    """Boxes (K, 4) of the network's image in the image, cut at its edges."""
    return Letterbox(*NET, scale, left, top).to_image(xyxy, width, height)


def uncut(xyxy: Array, scale: float, left: int, top: int, *size: int) -> Array:
    """The same boxes as they hang over the edges."""
    return np.asarray((xyxy - (left, top) * 2) / scale - 0.5)


def common(a: Array, b: Array, least: float = 0.0) -> float:
    """Area that two boxes share; sides are at least `least`."""
    return float(np.prod(np.maximum(np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2]), least)))


def area(box: Array) -> float:
    """Area of a box x0, y0, x1, y1."""
    return float(np.prod(box[2:] - box[:2]))


def shared(a: Array, b: Array, least: float = 0.0) -> float:
    """Intersection over union of two boxes."""
    return common(a, b, least) / (area(a) + area(b) - common(a, b, least))


def pairs() -> list[Case]:
    """Two boxes on one car, two far apart, two apart in both directions, and one with itself."""
    a, b, far = CORNERS[[0, 1, 3]]
    return [(a, b), (a, far), (np.array([0.0, 0, 10, 10]), np.array([20.0, 20, 30, 30])), (a, a.copy())]


def suppressed(corners: Array, scores: Array, most: float, against_kept: bool = True) -> list[int]:
    """Indices that greedy suppression keeps, best first; or those free of all better boxes, kept or not."""
    order = np.argsort(-scores, kind="stable").tolist()
    shares = overlap(corners, corners)
    kept: list[int] = []
    for place, k in enumerate(order):
        if all(shares[k, better] <= most for better in (kept if against_kept else order[:place])):
            kept.append(k)
    return kept


def heaps() -> list[Case]:
    """Five boxes, and twenty random heaps with thresholds of their own."""
    cases: list[Case] = [(CORNERS, SCORES, 0.5)]
    for seed in range(20):
        rng = np.random.default_rng(seed)
        corner = rng.uniform(0, 100, (15, 2))
        boxes = np.concatenate([corner, corner + rng.uniform(20, 60, (15, 2))], axis=1)
        cases.append((boxes, rng.permutation(15) / 15.0, float(rng.uniform(0.1, 0.7))))
    return cases


def features() -> list[Case]:
    """Points of 300 matches with boxes in both images; and without any."""
    rng = np.random.default_rng(9)
    uv_p = rng.uniform((0, 60), (500, 220), (300, 2))
    uv_c = uv_p + rng.uniform(-25, 25, (300, 2))
    return [(uv_p, uv_c, CORNERS[[0, 2, 3]], CORNERS[[1, 2]] + 6.0), (uv_p, uv_c, *np.zeros((2, 0, 4)))]


def inside(uv: Array, boxes: Array) -> Mask:
    """Which points (N, 2) lie in any box."""
    sides: Mask = (uv[:, None] >= boxes[:, :2]) & (uv[:, None] <= boxes[:, 2:])
    found: Mask = np.logical_and.reduce(sides, axis=2)
    return np.asarray(np.logical_or.reduce(found, axis=1))


def outside(uv_p: Array, uv_c: Array, boxes_p: Array, boxes_c: Array) -> Mask:
    """Which matches lie in a box in neither image."""
    return ~(inside(uv_p, boxes_p) | inside(uv_c, boxes_c))


to_image = Exercise("ch05.to_image", in_image, net_boxes, atol=1e-6)

cells = Exercise("ch05.cells", yolox_cells(WIDTH, HEIGHT))

iou = Exercise("ch05.iou", lambda a, b: shared(a, b), pairs)

suppress = Exercise("ch05.suppress", lambda corners, scores, most: suppressed(corners, scores, most), heaps)

keep_outside = Exercise("ch05.keep_outside", outside, features)


sparing_rule = Exercise("ch05.sparing_rule", {"removed": 40.0, KEPT: 1.0, LOST: 15.0})
