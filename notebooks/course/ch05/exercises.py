"""Exercises of chapter 5: features in boxes, label rows, cells, overlap, suppression, precision, moving boxes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from vo_lib.detection.network_image import Letterbox, fit_letterbox, yolox_cells
from vo_lib.geometry.boxes import overlap
from vo_lib.geometry.motion import rigid, rotation_from_vector
from vo_lib.geometry.types import Array, BoolArray
from vo_lib.paper.box_removal import inside

from ..checker import Case, Condition, Exercise

SIZE = (1241, 376)  # width and height of an image
NET = (640, 640)  # width and height of a network's image, with wide borders
# Of the network whose cells are counted.
WIDTH = 800
HEIGHT = 256
# Five boxes x0, y0, x1, y1, and their scores.
CORNERS = np.array(
    [
        [100.0, 100.0, 200.0, 180.0],
        [110.0, 104.0, 212.0, 184.0],  # 1 overlaps 0 much
        [185.0, 110.0, 290.0, 190.0],  # 2 overlaps 0 and 1 a little
        [400.0, 90.0, 450.0, 130.0],  # 3 overlaps none
        [130.0, 120.0, 160.0, 150.0],  # 4 is inside 0
    ]
)
SCORES = np.array([0.7, 0.9, 0.6, 0.3, 0.8])
OUTWARD = np.array([-1, -1, 1, 1])  # directions of the sides of a box (x0, y0, x1, y1) from its centre
LARGEST_LOG = 8.0  # of a side, so that a wild output has no infinite box
LEAST = 0.3  # metres; a shorter step is none
# Facts of the panel.
KEPT = "on moving things, kept"
LOST = "on standing things, removed"


def net_boxes() -> list[Case]:
    """Cases: boxes inside the image, over its lower right corner, over its upper left corner; all boxes."""
    inner = [[10.0, 240, 90.5, 300], [320, 280, 470, 360]]
    low = [[600.0, 250, 655, 420]]
    high = [[-9.0, 200, 60, 300]]
    letterbox = fit_letterbox(*SIZE, *NET)
    cases: list[Case] = []
    for boxes in (inner, low, high, [*inner, *low, *high]):
        cases.append((np.array(boxes), letterbox.scale, letterbox.left, letterbox.top, *SIZE))
    return cases


def without_half_pixel(xyxy: Array, scale: float, left: int, top: int, width: int, height: int) -> Array:
    """Boxes (K, 4) in pixels of the camera's image, counted from the edge of a pixel and not cut."""
    return np.asarray((xyxy - [left, top, left, top]) / scale)


def not_cut(xyxy: Array, scale: float, left: int, top: int, width: int, height: int) -> Array:
    """Wrong answer: boxes are not cut at the edges of the image."""
    return without_half_pixel(xyxy, scale, left, top, width, height) - 0.5


def cut_at_last_pixel(xyxy: Array, scale: float, left: int, top: int, width: int, height: int) -> Array:
    """Wrong answer: boxes are cut at the centre of the last pixel."""
    whole = not_cut(xyxy, scale, left, top, width, height)
    return np.clip(whole, 0, [width - 1, height - 1, width - 1, height - 1])


def cut_after_half_pixel(xyxy: Array, scale: float, left: int, top: int, width: int, height: int) -> Array:
    """Wrong answer: boxes are cut after half a pixel was subtracted."""
    whole = not_cut(xyxy, scale, left, top, width, height)
    return np.clip(whole, 0, [width, height, width, height])


def in_image(xyxy: Array, scale: float, left: int, top: int, width: int, height: int) -> Array:
    """Boxes (K, 4) of the network's image, mapped into the camera's image and cut at its edges."""
    return Letterbox(*NET, scale, left, top).to_image(xyxy, width, height)


def common(a: Array, b: Array) -> float:
    """Area that two boxes share, pixels²."""
    return float(np.prod(np.maximum(np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2]), 0)))


def area(box: Array) -> float:
    """Area of a box (x0, y0, x1, y1), pixels²."""
    return float(np.prod(box[2:] - box[:2]))


def pair_cases() -> list[Case]:
    """Cases of two boxes: on one car; equal; disjoint in columns, rows or both, as (a, b) and as (b, a)."""
    a, b = CORNERS[:2]
    shifts = ([300.0, 10, 300, 10], [10.0, 95, 10, 95], [150.0, 95, 150, 95])
    disjoint = [a + np.array(shift) for shift in shifts]
    cases: list[Case] = [(a, b), (a, a.copy())]
    cases += [(a, far) for far in disjoint]
    cases += [(far, a) for far in disjoint]
    return cases


def label_of(box: Array, number: int, width: int, height: int) -> Array:
    """The five numbers of a label row: the class, and centre, width and height in units of the image's size."""
    x0, y0, x1, y1 = box + 0.5
    centre = ((x0 + x1) / 2 / width, (y0 + y1) / 2 / height)
    size = ((x1 - x0) / width, (y1 - y0) / height)
    return np.array([number, *centre, *size])


def labels() -> list[Case]:
    """Cases of boxes to be written as label rows."""
    return [
        (np.array([199.5, 149.5, 319.5, 199.5]), 2, *SIZE),
        (np.array([-0.5, -0.5, 1240.5, 375.5]), 0, *SIZE),
        (np.array([620.0, 180.0, 655.5, 204.0]), 7, *SIZE),
    ]


def label_of_other_size(label: Array, factor: float) -> Array:
    """A label row (5,) with width and height times a factor."""
    number, x, y, width, height = label
    return np.array([number, x, y, factor * width, factor * height])


def corners_in_shares(box: Array, number: int, width: int, height: int) -> Array:
    """Wrong answer: the class, and the two corners of a box in units of the image's size."""
    return np.hstack([number, box / [width, height, width, height]])


def label_from_upper_left(label: Array) -> Array:
    """A label row (5,) with the upper left corner in place of the centre."""
    number, x, y, width, height = label
    return np.array([number, x - width / 2, y - height / 2, width, height])


def output_cases() -> list[Case]:
    """Cases of network outputs (h, w, 5) with the size of a cell: one cell, a row, a grid of other cells."""
    rng = np.random.default_rng(4)
    by_hand = np.zeros((3, 4, 5), np.float32)
    by_hand[..., 0] = -9.0
    by_hand[1, 2] = [1.0, *np.log([2.0, 0.5, 1.0, 1.5])]
    return [
        (by_hand, 16),
        (rng.normal(0.0, 1.0, (1, 6, 5)).astype(np.float32), 16),
        (rng.normal(0.0, 1.0, (5, 3, 5)).astype(np.float32), 8),
    ]


def decoded(output: Array, stride: int) -> tuple[Array, Array]:
    """Boxes (h w, 4) and scores (h w,) of the cells of an output (h, w, 5), row by row, pixels of its image."""
    height, width = output.shape[:2]
    v, u = np.mgrid[:height, :width]
    centres = (np.stack([u, v], axis=2) + 0.5) * stride
    sides = stride * np.exp(np.clip(output[..., 1:].astype(np.float64), -LARGEST_LOG, LARGEST_LOG))
    corners = np.concatenate([centres - sides[..., :2], centres + sides[..., 2:]], axis=2)
    scores = 1 / (1 + np.exp(-output[..., 0].astype(np.float64)))
    return corners.reshape(-1, 4), scores.ravel()


def _swapped_centres(output: Array, stride: int) -> tuple[Array, Array]:
    """The result of `decoded` with rows and columns exchanged in the centres of the cells."""
    corners, scores = decoded(output, stride)
    v, u = np.mgrid[: output.shape[0], : output.shape[1]]
    shift = stride * (v - u).ravel()
    return corners + np.stack([shift, -shift, shift, -shift], axis=1), scores


def _without_exp(output: Array, stride: int) -> tuple[Array, Array]:
    """The result of `decoded` with the numbers themselves as sides, in cells."""
    corners, scores = decoded(output, stride)
    numbers = output[..., 1:].reshape(-1, 4).astype(np.float64)
    return corners + OUTWARD * stride * (numbers - np.exp(numbers)), scores


def _centre_and_size(output: Array, stride: int) -> tuple[Array, Array]:
    """The result of `decoded` with centre, width and height in place of the corners."""
    corners, scores = decoded(output, stride)
    low = corners[:, :2]
    high = corners[:, 2:]
    return np.concatenate([(low + high) / 2, high - low], axis=1), scores


def _corner_and_size(output: Array, stride: int) -> tuple[Array, Array]:
    """The result of `decoded` with the upper left corner, width and height."""
    corners, scores = decoded(output, stride)
    return np.concatenate([corners[:, :2], corners[:, 2:] - corners[:, :2]], axis=1), scores


def _in_pixels(output: Array, stride: int) -> tuple[Array, Array]:
    """The result of `decoded` with sides in pixels instead of cells."""
    corners, scores = decoded(output, stride)
    sides = np.exp(output[..., 1:].reshape(-1, 4).astype(np.float64))  # in cells
    return corners + OUTWARD * (1 - stride) * sides, scores


def suppressed(corners: Array, scores: Array, most: float, rivals: slice | None = slice(None)) -> list[int]:
    """Indices that greedy suppression keeps, best first.

    A box is compared with the kept boxes in the slice `rivals`, or with all better boxes if `rivals` is None.
    """
    order = np.argsort(-scores, kind="stable").tolist()
    shares = overlap(corners, corners)
    kept: list[int] = []
    for place, k in enumerate(order):
        others = order[:place] if rivals is None else kept[rivals]
        if not np.any(shares[k, others] > most):
            kept.append(k)
    return kept


def _places_in_order(corners: Array, scores: Array, most: float) -> list[int]:
    """The result of `suppressed` as places in the sorted list."""
    order = np.argsort(-scores, kind="stable").tolist()
    return [order.index(k) for k in suppressed(corners, scores, most)]


def _dropped(corners: Array, scores: Array, most: float) -> list[int]:
    """The indices that `suppressed` does not keep, best first."""
    kept = suppressed(corners, scores, most)
    return [k for k in np.argsort(-scores, kind="stable").tolist() if k not in kept]


def heap_cases() -> list[Case]:
    """Cases: five boxes; two boxes with exactly the allowed overlap; random groups with other limits."""
    half = np.array([[0.0, 0, 10, 10], [0.0, 0, 10, 5]])
    cases: list[Case] = [(CORNERS, SCORES, 0.5), (half, np.array([0.8, 0.9]), 0.5)]
    for seed in range(20):
        rng = np.random.default_rng(seed)
        corner = rng.uniform(0, 100, (15, 2))
        boxes = np.concatenate([corner, corner + rng.uniform(20, 60, (15, 2))], axis=1)
        cases.append((boxes, rng.permutation(15) / 15.0, float(rng.uniform(0.1, 0.7))))
    return cases


def precision_recall_of(scores: Array, right: BoolArray, wanted: int) -> tuple[Array, Array]:
    """Precision and recall (N,) of the boxes down to each score, the best box first."""
    hits = np.cumsum(right[np.argsort(-scores, kind="stable")])
    return hits / np.arange(1, len(hits) + 1), hits / wanted


def _envelope(scores: Array, right: BoolArray, wanted: int) -> tuple[Array, Array]:
    """The result of `precision_recall_of` with each precision raised to the highest one that follows."""
    precision, recall = precision_recall_of(scores, right, wanted)
    return np.maximum.accumulate(precision[::-1])[::-1], recall


def verdicts() -> list[Case]:
    """Cases of judged boxes: their scores, in any order, whether each is right, and the wanted vehicles."""
    rng = np.random.default_rng(3)
    cases: list[Case] = [(np.array([0.9, 0.8, 0.7, 0.5]), np.array([True, True, False, True]), 5)]
    cases.append((np.array([0.2, 0.9, 0.6]), np.array([True, False, True]), 2))
    for count in (1, 12, 30):
        cases.append((rng.permutation(count) / count, rng.random(count) < 0.6, count + 3))
    return cases


def features() -> list[Case]:
    """Points of 300 matches with boxes in both images, then without boxes."""
    rng = np.random.default_rng(9)
    uv_p = rng.uniform((0, 60), (500, 220), (300, 2))
    uv_c = uv_p + rng.uniform(-25, 25, (300, 2))
    none = np.zeros((0, 4))
    return [(uv_p, uv_c, CORNERS[[0, 2, 3]], CORNERS[[1, 2]] + 6.0), (uv_p, uv_c, none, none)]


def outside(uv_p: Array, uv_c: Array, boxes_p: Array, boxes_c: Array) -> BoolArray:
    """Mask (N,) of the matches that are outside all boxes in both images."""
    return np.asarray(~(inside(uv_p, boxes_p).any(axis=1) | inside(uv_c, boxes_c).any(axis=1)))


def corner_and_size_as_box(boxes: Array) -> Array:
    """Boxes (K, 4) whose numbers are taken for the upper left corner, width and height."""
    corner = boxes[:, :2]
    size = boxes[:, 2:]
    return np.hstack([corner, corner + size])


def centre_and_size_as_box(boxes: Array) -> Array:
    """Boxes (K, 4) whose numbers are taken for the centre, width and height."""
    centre = boxes[:, :2]
    size = boxes[:, 2:]
    return np.hstack([centre - size / 2, centre + size / 2])


def driven_cases() -> list[Case]:
    """Cases of parked, leading and crossing vehicles, with wrong matches, background, noise or few features.

    The camera drives a metre ahead and turns by 2°.
    """
    T_cp = rigid(rotation_from_vector(np.radians([0.0, 2.0, 0.0])), np.array([0.02, 0.0, -1.0]))

    def box(
        *step: float, behind: int = 0, wrong: int = 0, far: int = 0, count: int = 20, least: float = LEAST
    ) -> Case:
        """`count` features whose things move by a step (x, y, z), metres.

        behind : features that stand still. wrong : wrong matches. far : more metres away, with more noise.
        """
        rng = np.random.default_rng(7)
        X_p = rng.uniform((2.0, -1.0, 12.0 + far), (4.0, 1.0, 14.0 + far), (count, 3))
        X_c = X_p @ T_cp[:3, :3].T + T_cp[:3, 3]
        X_c[behind:] += step
        X_c[count - wrong :, 2] += 25.0
        X_c[:, 2] += rng.normal(0.0, 1.0 if far else 0.02, count)
        return X_p, X_c, T_cp, least

    return [
        box(0, 0, 0),
        box(0, 0, 0.9),
        box(-0.45, 0, 0),
        box(0, 0, 0, wrong=8),
        box(-0.45, 0, 0, behind=8),
        box(0, 0, 0, far=30),
        box(0, 0, 0.9, count=2),
        box(0, 0, 0.9, count=3),
        box(0.25, 0, 0.25),
        box(0.2, 0, 0.2),
        box(0, 0, 0.4, least=0.5),
    ]


def left_over(X_p: Array, X_c: Array, T_cp: Array) -> Array:
    """Displacements (N, 3) of features relative to the static scene, metres."""
    return np.asarray(X_c - X_p @ T_cp[:3, :3].T - T_cp[:3, 3])


def median_length(steps: Array) -> Any:
    """Length of the median step."""
    return np.linalg.norm(np.median(steps, axis=0))


def whether_box_moves(
    length: Callable[[Array], Any], steps: Callable[..., Array] = left_over, few: Any = None, fewest: int = 3
) -> Callable[..., Any]:
    """Answer: whether `length(steps)` exceeds `least`, or `few` if there are fewer than `fewest` features."""

    def moves(X_p: Array, X_c: Array, T_cp: Array, least: float) -> Any:
        if len(X_p) < fewest:
            return few
        return length(steps(X_p, X_c, T_cp)) > least

    return moves


to_image = Exercise(
    in_image,
    net_boxes,
    atol=1e-6,
    praise="the same boxes as the library's `Letterbox.to_image`.",
    hint="solve u_net = s (u + ½) + left for u, step by step, from the outside.",
    line="np.clip((xyxy - (left, top) * 2) / scale, 0, (width, height) * 2) - 0.5",
    library=("to_image",),
    mistakes={
        "the last box still extends beyond the edge: clip the box before the half pixel is subtracted.": (
            not_cut
        ),
        "the box is clipped at the wrong place: counted from pixel centres, the edge is at width - 0.5.": (
            cut_at_last_pixel,
            cut_after_half_pixel,
        ),
        "the boxes are half a pixel too far right and down: the kit counts from the centre of a pixel.": lambda *case: (
            in_image(*case) + 0.5
        ),
        "the border is not subtracted: left and top.": (
            lambda xyxy, scale, left, top, *size: in_image(xyxy, scale, 0, 0, *size),
            lambda xyxy, scale, *more: xyxy / scale - 0.5,
            lambda xyxy, scale, *more: xyxy / scale,
        ),
        "the border has pixels of the network: subtract it before you divide by the scale.": (
            lambda xyxy, scale, left, top, *size: in_image(xyxy, scale, scale * left, scale * top, *size)
        ),
        "width and height are exchanged.": lambda xyxy, scale, left, top, width, height: in_image(
            xyxy, scale, left, top, height, width
        ),
        "left and top are exchanged.": lambda xyxy, scale, left, top, *size: in_image(
            xyxy, scale, top, left, *size
        ),
        "the coordinates are multiplied by the scale: divide them.": lambda xyxy, scale, *more: in_image(
            xyxy, 1 / scale, *more
        ),
        "boxes inside the image are right; a box beyond the edge is wrong: clip the box on all four sides.": Condition(
            lambda got, xyxy, *case: len(xyxy) == 1
        ),
    },
)

cells = Exercise(
    yolox_cells(WIDTH, HEIGHT),
    praise="{right} candidates for an image with a dozen vehicles: most cells must have a low score.",
    hint="multiply columns by rows for each grid, and add the three products.",
    line="sum((800 // stride) * (256 // stride) for stride in (8, 16, 32))",
    mistakes={
        "these are only the cells of stride 8.": WIDTH * HEIGHT // 64,
        "this is one row of each grid.": WIDTH // 8 + WIDTH // 16 + WIDTH // 32,
        "this is the number of pixels: a cell of stride 8 covers 8 × 8 pixels.": WIDTH * HEIGHT,
    },
)

label_row = Exercise(
    label_of,
    labels,
    atol=1e-6,
    praise="`read_labels` of the library gives the same boxes back.",
    hint="count from the outer edge of the first pixel: add half a pixel to each corner. Then centre and size, "
    "each as a share of the image.",
    line="cx = ((box[0] + box[2]) / 2 + 0.5) / width",
    mistakes={
        "the half pixel is missing: the box counts from the centre of the first pixel, the row from its edge.": (
            lambda box, number, w, h: label_of(box - 0.5, number, w, h)
        ),
        "the half pixel has the wrong sign: the edge is before the centre, so each corner grows by ½.": (
            lambda box, number, w, h: label_of(box - 1.0, number, w, h)
        ),
        "these are pixels: a row has shares of the image's width and height.": (
            lambda box, number, w, h: label_of(box, number, 1, 1),
            lambda box, number, w, h: label_of(box - 0.5, number, 1, 1),
        ),
        "these are the two corners: a row has the centre, then width and height.": (
            lambda box, number, w, h: corners_in_shares(box + 0.5, number, w, h),
            corners_in_shares,
        ),
        "this begins with the upper left corner: a row begins with the centre.": (
            lambda *case: label_from_upper_left(label_of(*case))
        ),
        "width and height of the image are exchanged.": lambda box, number, w, h: label_of(box, number, h, w),
        "these are half sizes: a row has the whole width and height.": lambda *case: label_of_other_size(
            label_of(*case), 0.5
        ),
        "a pixel counts twice, on both sides of the box: its width is x1 - x0, without + 1.": (
            lambda box, number, w, h: label_of(box, number, w, h) + np.array([0, 0, 0, 1 / w, 1 / h])
        ),
        "the class is missing or at the end: it is the first number.": (
            lambda *case: label_of(*case)[1:],
            lambda *case: np.roll(label_of(*case), -1),
        ),
    },
)

decode = Exercise(
    decoded,
    output_cases,
    parts=("corners", "scores"),
    atol=1e-4,
    rtol=1e-5,
    praise="the library decodes all cells to the same boxes.",
    hint="the centre of the cell in row r and column c is stride · (c + ½, r + ½). A side is stride · exp(number) "
    "away from it.",
    line="sides = stride * np.exp(output[..., 1:]); corners = centre - sides[..., :2], centre + sides[..., 2:]",
    library=("decoded",),
    mistakes={
        "the boxes begin at the corner of a cell, not at its centre: add half a cell.": (
            lambda output, stride: (decoded(output, stride)[0] - stride / 2, decoded(output, stride)[1])
        ),
        "the distances are in pixels: exp gives cells, so multiply it by the stride.": _in_pixels,
        "the numbers are logarithms of the distances: take exp of them.": _without_exp,
        "rows and columns are exchanged: the column gives x, the row gives y.": _swapped_centres,
        "these are centre or corner, then width and height: return the corners x0, y0, x1, y1.": (
            _centre_and_size,
            _corner_and_size,
        ),
        "the score is a logit: it needs 1 / (1 + exp(-s)).": lambda output, stride: (
            decoded(output, stride)[0],
            output[..., 0].ravel(),
        ),
        "the sigmoid has the wrong sign: a large number is a high score.": lambda output, stride: (
            decoded(output, stride)[0],
            1.0 - decoded(output, stride)[1],
        ),
    },
)

precision_recall = Exercise(
    precision_recall_of,
    verdicts,
    parts=("precision", "recall"),
    praise="precision and recall after each box, the best box first: {got[0]} and {got[1]} for the first case.",
    hint="sort by score, count the right boxes so far, and divide the count by two different numbers.",
    line="hits = np.cumsum(right[np.argsort(-scores)]); return hits / np.arange(1, len(hits) + 1), hits / wanted",
    mistakes={
        "this is the envelope, each precision raised to the highest one that follows; other APs use it. Here, "
        "leave the precision as it is.": _envelope,
        "sort the boxes first, the best score first.": lambda scores, right, wanted: (
            np.cumsum(right) / np.arange(1, len(right) + 1),
            np.cumsum(right) / wanted,
        ),
        "the worst box is the first: sort by falling scores.": lambda scores, right, wanted: (
            precision_recall_of(-scores, right, wanted)
        ),
        "recall is the share of the vehicles, not of the right boxes: divide by `wanted`.": (
            lambda scores, right, wanted: precision_recall_of(scores, right, max(int(right.sum()), 1))
        ),
        "recall is the share of the vehicles, not of all boxes: divide by `wanted`.": (
            lambda scores, right, wanted: precision_recall_of(scores, right, len(scores))
        ),
        "precision is the share of right boxes among the boxes so far, not among all boxes.": (
            lambda scores, right, wanted: (
                precision_recall_of(scores, right, len(scores))[1],
                precision_recall_of(scores, right, wanted)[1],
            )
        ),
    },
)

iou = Exercise(
    lambda a, b: overlap(a[None], b[None])[0, 0],
    pair_cases,
    praise="{got:.3f} for two boxes 10 px apart, 1 for a box with itself, 0 for boxes without a common part.",
    hint="where does the common part begin, and where does it end? Divide its area by the area of the union.",
    line="sides = np.maximum(np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2]), 0)",
    library=("overlap",),
    mistakes={
        "this is the common area in pixels: divide it by the union.": common,
        "this is not divided by the union: add both areas, and subtract the common area, which was counted twice.": (
            lambda a, b: common(a, b) / (area(a) + area(b)),
            lambda a, b: common(a, b) / area(a),
            lambda a, b: common(a, b) / area(b),
        ),
        "the side of a box is x1 - x0, without + 1.": lambda a, b: overlap(
            a[None] + [0, 0, 1, 1], b[None] + [0, 0, 1, 1]
        )[0, 0],
        "two boxes that do not touch have {got:.2f}, not 0: a negative side of the common part counts as 0.": (
            Condition(lambda got, a, b: common(a, b) == 0)
        ),
        "a box with itself has {got:.3f}, not 1.": Condition(lambda got, a, b: (a == b).all()),
    },
)

suppress = Exercise(
    suppressed,
    heap_cases,
    praise="the same boxes in the same order as by greedy suppression, for 20 random groups, too.",
    hint="keep the best box, drop the boxes whose IoU with this box is above `most`, and repeat.",
    line="for k in np.argsort(-scores): if all(shared[k, other] <= most for other in kept): kept.append(k)",
    library=("best_boxes", "NMSBoxes"),
    mistakes={
        "these are places in the sorted list: return the indices of the boxes as they were given.": (
            _places_in_order
        ),
        "these are the boxes that are dropped: return those that stay.": (
            _dropped,
            lambda *case: sorted(_dropped(*case)),
        ),
        "only the best box is kept: go on with the best one that is left.": lambda corners, scores, most: (
            [int(np.argmax(scores))]
        ),
        "the worse of two boxes on one car is kept: begin with the best box.": Condition(
            lambda got, corners, *case: len(corners) == 5 and 0 in got and 1 not in got
        ),
        "boxes with a small overlap are dropped, too: compare with `most`, not with 0.": Condition(
            lambda got, corners, *case: len(corners) == 5 and not {2, 4} <= set(got.ravel())
        ),
        "a box whose IoU is exactly `most` is dropped: drop boxes with a larger IoU only.": lambda b, s, most: (
            suppressed(b, s, most - 1e-12)
        ),
        "the result is right for five boxes and wrong for another threshold: use `most`.": lambda b, s, _: (
            suppressed(b, s, 0.5)
        ),
        "each box is compared with all better boxes: a dropped box must not drop other boxes.": lambda b, s, most: (
            suppressed(b, s, most, None)
        ),
        "each box is compared with one kept box only: compare with all kept boxes.": (
            lambda b, s, most: suppressed(b, s, most, slice(-1, None)),
            lambda b, s, most: suppressed(b, s, most, slice(1)),
        ),
        "no box is dropped here: compare each box with all kept boxes.": (
            lambda corners, scores, most: np.argsort(-scores),
            Condition(lambda got, corners, *case: len(got) == len(corners) == 5),
        ),
    },
    slips={"order": "these are the right boxes in another order: the best box is the first."},
)

keep_outside = Exercise(
    outside,
    features,
    praise="`on_vehicles` of the library keeps the same matches.",
    hint="when is a point in one box, and when in any box? A match has two points.",
    line="((uv[:, None] >= boxes[:, :2]) & (uv[:, None] <= boxes[:, 2:])).all(axis=2).any(axis=1)",
    library=("inside", "in_boxes", "on_vehicles"),
    mistakes={
        "the boxes of one image are not used: a match is removed if either point is in a box.": (
            lambda uv_p, uv_c, boxes_p, boxes_c: ~inside(uv_p, boxes_p).any(axis=1),
            lambda uv_p, uv_c, boxes_p, boxes_c: ~inside(uv_c, boxes_c).any(axis=1),
        ),
        "a match is removed only if both points are in a box: one point is enough.": lambda p, c, boxes_p, boxes_c: (
            ~(inside(p, boxes_p).any(axis=1) & inside(c, boxes_c).any(axis=1))
        ),
        "the boxes of the two images are exchanged, or mixed: uv_p belongs to boxes_p alone.": (
            lambda p, c, boxes_p, boxes_c: outside(p, c, boxes_c, boxes_p),
            lambda p, c, *boxes: outside(p, c, np.concatenate(boxes), np.concatenate(boxes)),
        ),
        "a feature may be in any of the boxes, not only in the first or last.": (
            lambda p, c, boxes_p, boxes_c: outside(p, c, boxes_p[:1], boxes_c[:1]),
            lambda p, c, boxes_p, boxes_c: outside(p, c, boxes_p[-1:], boxes_c[-1:]),
        ),
        "boxes are x0, y0, x1, y1: the last two numbers are a corner, not width and height.": (
            lambda p, c, boxes_p, boxes_c: outside(
                p, c, corner_and_size_as_box(boxes_p), corner_and_size_as_box(boxes_c)
            )
        ),
        "boxes are x0, y0, x1, y1: the first two numbers are a corner, not a centre.": (
            lambda p, c, boxes_p, boxes_c: outside(
                p, c, centre_and_size_as_box(boxes_p), centre_and_size_as_box(boxes_c)
            )
        ),
        "u and v are exchanged: boxes begin with their u.": lambda p, c, *boxes: outside(
            p[:, ::-1], c[:, ::-1], *boxes
        ),
        "without any box, some matches are removed.": Condition(
            lambda got, uv_p, uv_c, *boxes: not len(boxes[0])
        ),
    },
    slips={"inverted": "the mask is inverted: True marks the matches to keep."},
)

box_moves = Exercise(
    whether_box_moves(median_length),
    driven_cases,
    praise="the answer is right for boxes of parked, leading, crossing, hidden and far vehicles.",
    hint="compute the place of each feature without its own motion. The median difference is the step of the box.",
    line="step = np.median(X_c - (X_p @ T_cp[:3, :3].T + T_cp[:3, 3]), axis=0)",
    library=("point_steps", "box_steps", "states"),
    mistakes={
        "these steps contain the motion of the camera: a static feature is at R_cp X_p + t_cp now.": (
            whether_box_moves(median_length, lambda X_p, X_c, T_cp: X_c - X_p),
            whether_box_moves(median_length, lambda X_p, X_c, T_cp: left_over(X_c, X_p, T_cp)),
            whether_box_moves(median_length, lambda X_p, X_c, T_cp: X_c - X_p @ T_cp[:3, :3].T),
        ),
        "one wrong match moves a parked box: the result depends on a mean or on a single feature.": (
            whether_box_moves(lambda steps: np.linalg.norm(steps.mean(axis=0))),
            whether_box_moves(lambda steps: np.linalg.norm(steps, axis=1).max()),
        ),
        "the length of noise is positive: compute the median of the steps first, then its length.": whether_box_moves(
            lambda steps: np.median(np.linalg.norm(steps, axis=1))
        ),
        "vehicles move to the side and ahead: a step has three coordinates.": (
            whether_box_moves(lambda steps: np.abs(np.median(steps[:, 2]))),
            whether_box_moves(lambda steps: np.abs(np.median(steps[:, 0]))),
        ),
        "the street behind the car is in its box as well: not all features need to move.": whether_box_moves(
            lambda steps: np.linalg.norm(steps, axis=1).min()
        ),
        "with two features the answer is None.": (
            whether_box_moves(median_length, few=True),
            whether_box_moves(median_length, few=False),
        ),
        "three features are enough: return None only for fewer features.": whether_box_moves(
            median_length, fewest=4
        ),
        "the length of a step is the root of the sum of the three squares.": (
            whether_box_moves(lambda steps: np.abs(np.median(steps, axis=0)).max()),
            whether_box_moves(lambda steps: np.abs(np.median(steps, axis=0)).sum()),
        ),
        "{got:.3g} is a length in metres: compare the length with `least`.": Condition(
            lambda got, *case: 0 < got != 1
        ),
        "`least` is not used.": lambda *case: whether_box_moves(median_length)(*case[:3], LEAST),
    },
)

sparing_rule = Exercise(
    {"removed": 40.0, KEPT: 1.0, LOST: 15.0},
    praise="{on moving things, kept:.0f} features on moving things remain, {on standing things, removed:.0f} on "
    "standing things are removed.",
    mistakes={
        "this sequence has no truth of moving things; choose synthetic/traffic.": lambda now: (
            not np.isfinite(now[KEPT] + now[LOST])
        ),
        "nothing is removed: choose another rule than `none`, and a score below 1.": lambda now: (
            not now["removed"] > 0
        ),
        "exactly the features on moving things are removed: this is the rule `truth`, which reads the answer from "
        "the drawn scene. Find a rule that a car on a real road could use.": lambda now: (
            now[KEPT] == now[LOST] == 0
        ),
        "{on moving things, kept:.0f} features on moving things remain. Some are on the rim of a vehicle, outside its box: "
        "let the boxes grow a little.": lambda now: now[KEPT] > 1,
        "{on standing things, removed:.0f} features on standing things are removed. Parked cars, and houses in the corner of a "
        "box, need not be removed: which rule of the kit depends on motion?": lambda now: now[LOST] > 20,
    },
)
