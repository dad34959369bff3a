"""Exercises of chapter 5: letterbox inverse, cells, overlap, suppression, features in boxes, rule."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ...beyond.box_filter import static_matches
from ...beyond.box_tracks import overlap
from ...config import FilterConfig
from ...core.boxes import Boxes
from ...core.matches import StereoMatches
from ...core.types import Array
from ...detection.yolo_layout import letterbox, yolox_cells
from .verdict import Wrong, as_array, as_number, differs, exercise

SIZE, NET = (1241, 376), (640, 640)  # width and height of an image, and of a network's with wide borders
CELLS = 800, 256
# The second overlaps the first much, the third both a little, the fourth none; the last is inside the first.
CORNERS = np.array(
    [
        [100.0, 100.0, 200.0, 180.0],
        [110.0, 104.0, 212.0, 184.0],
        [185.0, 110.0, 290.0, 190.0],
        [400.0, 90.0, 450.0, 130.0],
        [130.0, 120.0, 160.0, 150.0],
    ]
)
SCORES = np.array([0.7, 0.9, 0.6, 0.3, 0.8])


@exercise
def to_image(function: Callable[..., Any]) -> str:
    """A function (xyxy (K, 4), scale, left, top, width, height) -> boxes (K, 4) in the image, pixels."""
    plan = letterbox(*SIZE, *NET)
    net = np.array([[10.0, 240.0, 90.5, 300.0], [320.0, 280.0, 470.0, 360.0], [600.0, 250.0, 655.0, 420.0]])
    moved = (net - (plan.left, plan.top) * 2) / plan.scale
    expected = plan.to_image(net, *SIZE)
    got = as_array(function(net.copy(), plan.scale, plan.left, plan.top, *SIZE), (3, 4), "the array of boxes")
    if not differs(got, expected, 1e-6):
        return "the library's `Letterbox.to_image`: network and image name the same places again."
    whole, inside = np.array(SIZE * 2, np.float64), np.s_[:2]
    late = np.clip(moved - 0.5, 0.0, whole - 1)
    if not differs(got[inside], expected[inside], 1e-6):
        if not differs(got, moved - 0.5, 1e-6):
            raise Wrong(
                "the last box still hangs over the edge of the image.",
                "cut to 0 … width and 0 … height with np.clip, before the half pixel is taken off.",
            )
        if not differs(got, late, 1e-6):
            raise Wrong(
                "the cut is half a pixel too early: the image's outer edge is width - 0.5.",
                "np.clip to 0 … width first, then - 0.5.",
            )
        raise Wrong("boxes inside are right, one over the edge is not.", "np.clip to 0 … width and height.")
    if not differs(got[inside], (expected + 0.5)[inside], 1e-6):
        raise Wrong(
            "everything is half a pixel too far to the right and down.",
            "the network counts from a pixel's outer edge, the kit from its centre: - 0.5.",
        )
    if not differs(got[inside], (expected + 1.0)[inside], 1e-6):
        raise Wrong("the half pixel goes the other way.", "u = (…) / scale - 0.5.")
    if not differs(got[inside], (net / plan.scale - 0.5)[inside], 0.6):
        raise Wrong("the border is forgotten.", "take left from the x and top from the y before dividing.")
    wrong_order = net / plan.scale - (plan.left, plan.top) * 2
    if not differs(got[inside], wrong_order[inside], 0.6):
        raise Wrong(
            "first the scale and then the border is the wrong order.",
            "the border was added last, in the network's pixels, so it goes first.",
        )
    if not differs(got[inside], ((net - (plan.top, plan.left) * 2) / plan.scale)[inside], 0.6):
        raise Wrong("left and top are exchanged.", "columns are x, y, x, y: subtract left, top, left, top.")
    if not differs(got[inside], ((net - (plan.left, plan.top) * 2) * plan.scale)[inside], 0.6):
        raise Wrong("multiplied by the scale: this makes boxes smaller still.", "divide by it.")
    raise Wrong(
        f"the first box is {got[0].round(1)}, expected {expected[0].round(1)}.",
        "solve u_net = scale (u + 0.5) + left for u.",
    )


@exercise
def cells(answer: Any) -> str:
    """How many cells a network with strides 8, 16, 32 has for 800 × 256 px."""
    value, (width, height) = as_number(answer), CELLS
    right = yolox_cells(width, height)
    if value == width * height // 64:
        raise Wrong("these are the cells of stride 8 alone.", "add those of strides 16 and 32.")
    if value == width // 8 + width // 16 + width // 32:
        raise Wrong("this is one row of each grid.", "columns times rows: (800 / 8) · (256 / 8) + …")
    if value == width * height:
        raise Wrong("these are the pixels.", "a cell of stride 8 covers 8 × 8 of them.")
    if value != right:
        raise Wrong(f"{value:g} is not it.", "(800 / 8) · (256 / 8), and the same with 16 and with 32.")
    return f"{right} candidates, for an image with a dozen vehicles: most cells must say no."


@exercise
def iou(function: Callable[..., Any]) -> str:
    """A function (a (4,), b (4,)) -> intersection over union of two boxes x0, y0, x1, y1."""
    a, b, far = CORNERS[0], CORNERS[1], CORNERS[3]
    apart = as_number(function(a.copy(), far.copy()))
    # Below and to the right of each other: both sides of the common part are negative.
    diagonal = as_number(function(np.array([0.0, 0, 10, 10]), np.array([20.0, 20, 30, 30])))
    got, expected = as_number(function(a.copy(), b.copy())), float(overlap(a[None], b[None])[0, 0])
    common = float(np.prod(np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2])))
    areas = [float(np.prod(x[2:] - x[:2])) for x in (a, b)]
    if abs(got - common) < 1e-6:
        raise Wrong("this is the common area, in pixels.", "divide by the area that both cover together.")
    if abs(got - common / sum(areas)) < 1e-9:
        raise Wrong("the common part is counted twice below the line.", "union = area a + area b - common.")
    if min(abs(got - common / area) for area in (*areas, min(areas), max(areas))) < 1e-9:
        raise Wrong("divided by the area of one box.", "union = area a + area b - common.")
    if abs(got - expected) > 1e-9:
        raise Wrong(
            f"got {got:.3f} for two boxes with {expected:.3f}.",
            "common from max of the left and upper sides to min of the right and lower ones.",
        )
    if abs(apart) > 1e-12 or abs(diagonal) > 1e-12:
        raise Wrong(
            f"two boxes that do not touch have {apart if abs(apart) > 1e-12 else diagonal:.2f}, not 0.",
            "a negative width or height of the common part counts as 0; two of them multiply to more than 0.",
        )
    own = as_number(function(a.copy(), a.copy()))
    if abs(own - 1.0) > 1e-9:
        raise Wrong(f"a box with itself has {own:.3f}, not 1.", "intersection and union are then the same.")
    return f"{got:.3f} for two boxes 10 px apart; 1 with itself; 0 where nothing is shared."


def suppressed(corners: Array, scores: Array, most: float) -> list[int]:
    """Indices that greedy suppression keeps, best first: the reference of the exercise."""
    left, kept = np.argsort(-scores, kind="stable").tolist(), []
    shared = overlap(corners, corners)
    while left:
        best = left.pop(0)
        kept.append(best)
        left = [k for k in left if shared[best, k] <= most]
    return kept


@exercise
def suppress(function: Callable[..., Any]) -> str:
    """A function (corners (N, 4), scores (N,), most) -> indices kept by suppression, best first."""
    expected = suppressed(CORNERS, SCORES, 0.5)
    answer = function(CORNERS.copy(), SCORES.copy(), 0.5)
    if answer is None or answer is Ellipsis:
        raise Wrong("the function gives back nothing.", "collect indices in a list and return it.")
    got = [int(k) for k in np.ravel(np.asarray(answer))]
    if got == expected:
        for seed in range(20):
            rng = np.random.default_rng(seed)
            corner = rng.uniform(0, 100, (15, 2))
            many = np.concatenate([corner, corner + rng.uniform(20, 60, (15, 2))], axis=1)
            marks, most = rng.permutation(15) / 15.0, float(rng.uniform(0.1, 0.7))
            more = [int(k) for k in np.ravel(np.asarray(function(many.copy(), marks.copy(), most)))]
            if more != suppressed(many, marks, most):
                raise Wrong(
                    "right for five boxes, wrong for other boxes or another threshold.",
                    "compare with the boxes kept, not with all better ones, and use `most`, not 0.5.",
                )
        return f"of {len(SCORES)} candidates {len(got)} stay, best first, also in 20 random heaps."
    if sorted(got) == sorted(expected):
        raise Wrong("the right boxes in another order.", "go through them by descending score.")
    if len(got) == len(SCORES):
        raise Wrong("nothing is suppressed.", "drop what overlaps a kept box by more than `most`.")
    if 0 in got and 1 not in got:
        raise Wrong("the worse of two boxes on one car stays.", "np.argsort(-scores): the best comes first.")
    if 4 not in got or 2 not in got:
        raise Wrong(
            "boxes that overlap only a little go, too.",
            "a box goes when its IoU is above `most`, not above 0.",
        )
    raise Wrong(f"kept {got}, expected {expected}.", "take the best, drop what overlaps it, repeat.")


@exercise
def keep_outside(function: Callable[..., Any]) -> str:
    """A function (uv_p (N, 2), uv_c (N, 2), boxes_p (K, 4), boxes_c (L, 4)) -> matches to keep, (N,) bool."""
    rng = np.random.default_rng(9)
    uv_p = rng.uniform((0, 60), (500, 220), (300, 2))
    uv_c = uv_p + rng.uniform(-25, 25, (300, 2))
    boxes_p, boxes_c = CORNERS[[0, 2, 3]], CORNERS[[1, 2]] + 6.0

    def reference(left_p: Array, left_c: Array, in_p: Array, in_c: Array) -> Array:
        ones = np.ones(len(left_p))
        matches = StereoMatches(
            left_p, left_p, left_c, left_c, ones.astype(np.int64), ones, np.arange(len(ones))
        )
        labels = [Boxes(xyxy, np.full(len(xyxy), 2), np.ones(len(xyxy))) for xyxy in (in_p, in_c)]
        config = FilterConfig(min_matches=0, min_share=0.0)
        return np.asarray(static_matches(matches, labels[0], labels[1], config)[0], np.float64)

    nothing = np.zeros((0, 4))
    expected = reference(uv_p, uv_c, boxes_p, boxes_c)
    got = as_array(function(uv_p.copy(), uv_c.copy(), boxes_p.copy(), boxes_c.copy()), (300,), "the mask")
    if not differs(got, expected, 0):
        empty = as_array(function(uv_p.copy(), uv_c.copy(), nothing, nothing), (300,), "the mask")
        if not empty.all():
            raise Wrong("without any box some matches go.", "with no box nothing lies in one: .any(axis=1).")
        return f"{int(got.sum())} of 300 stay, the same as `static_matches` keeps."
    if not differs(got, 1.0 - expected, 0):
        raise Wrong("the mask is upside down: it marks those to be removed.", "return ~removed.")
    before, now = (reference(uv_p, uv_c, *pair) for pair in ((boxes_p, nothing), (nothing, boxes_c)))
    if not differs(got, before, 0):
        raise Wrong(
            "the current image is not asked.", "a match goes when either of its two points is in a box."
        )
    if not differs(got, now, 0):
        raise Wrong(
            "the previous image is not asked.", "a match goes when either of its two points is in a box."
        )
    if not differs(got, np.maximum(before, now), 0):
        raise Wrong("a match goes only when both points are in a box.", "the paper's rule: either, so `|`.")
    swapped = reference(uv_p, uv_c, boxes_c, boxes_p)
    if not differs(got, swapped, 0):
        raise Wrong("the boxes of the two images are exchanged.", "uv_p with boxes_p, uv_c with boxes_c.")
    count = int(np.count_nonzero(got != expected))
    raise Wrong(
        f"{count} of 300 matches are judged differently.",
        "inside: x0 <= u <= x1 and y0 <= v <= y1 of any one box.",
    )


@exercise
def sparing_rule(facts: Mapping[str, float]) -> str:
    """The panel removes most features on moving things, and few on standing ones."""
    kept = facts.get("on moving things, kept", np.nan)
    lost = facts.get("on standing things, removed", np.nan)
    if not np.isfinite(kept + lost):
        raise Wrong("in this sequence nobody knows what moves.", "choose a drawn scene: synthetic/traffic.")
    if facts.get("removed", 0) == 0:
        raise Wrong("nothing is removed.", "choose another rule than `none`, and a score below 1.")
    if kept > 2:
        raise Wrong(
            f"{kept:.0f} features on moving things stay.",
            "lower the score, or let the boxes grow a little: which of them is too tight?",
        )
    if lost > 20:
        raise Wrong(
            f"{lost:.0f} features on standing things go.",
            "houses in a box's corner and parked cars need not go: which rule looks at motion?",
        )
    return f"{kept:.0f} on moving things stay, {lost:.0f} on standing things go."
