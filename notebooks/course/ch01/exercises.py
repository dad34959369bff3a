"""Exercises of chapter 1: maxima of a response, the match of descriptors, the stereo check, the loop, a step
of Lucas-Kanade, buckets; under More corner strength and a peak between pixels.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from vo_lib.geometry.types import Array, BoolArray, Index, IntArray
from vo_lib.paper.buckets import select_by_bucket
from vo_lib.paper.settings import BucketConfig

from ..checker import Case, Condition, Exercise, in_order

SEED = 2  # of descriptors whose best match depends on the measure
TINY = 1e-9  # moves a limit, so that a value exactly at the limit is on its other side


def sorted_rows(rows: Array) -> Array:
    """The same rows (N, 2), sorted by their first number, then by their second."""
    return rows[np.lexsort(rows.T[::-1])] if rows.ndim == 2 else rows


def responses() -> list[Case]:
    """Responses with several maxima, some at the border, some equal; two sides of the square, two limits."""
    rng = np.random.default_rng(3)
    small = np.zeros((7, 9))
    small[3, 6] = 90.0
    small[1, 1] = 60.0
    small[5, 2] = 50.0  # equal to the limit
    small[4, 4] = 70.0  # a neighbour of a larger response
    twins = rng.integers(-99, 60, (14, 20)).astype(float)
    twins[6, 3] = 95.0
    twins[6, 5] = 95.0
    large = rng.normal(size=(16, 24)) * 60.0
    large[0, 7] = 400.0
    large[15, 23] = 300.0
    return [(small, 5, 50.0), (twins, 5, 50.0), (large, 7, 80.0), (large, 3, 100.0)]


def largest_in_squares(
    response: Array, cell: int, least: float, *, half: int | None = None, short: int = 0, edge: int = 0
) -> Array:
    """Pixels (N, 2) above `least` whose response is the largest of the square around them.

    half : reach of the square, (cell - 1) / 2 if None; `short` rows and columns are missing at its end; pixels
    nearer than `edge` to the border are left out.
    """
    reach = (cell - 1) // 2 if half is None else half
    found = []
    rows, columns = response.shape
    for v in range(edge, rows - edge):
        for u in range(edge, columns - edge):
            top = max(v - reach, 0)
            left = max(u - reach, 0)
            square = response[top : v + reach + 1 - short, left : u + reach + 1 - short]
            if response[v, u] > least and response[v, u] >= square.max(initial=-np.inf):
                found.append((u, v))
    return np.array(found, np.float64).reshape(-1, 2)


def alone(response: Array, cell: int, least: float) -> Array:
    """Wrong answer: pixels whose response is larger than all others of their square, so no equal ones."""
    reach = (cell - 1) // 2
    kept = []
    for u, v in largest_in_squares(response, cell, least).astype(int).tolist():
        square = response[max(v - reach, 0) : v + reach + 1, max(u - reach, 0) : u + reach + 1]
        if np.count_nonzero(square == response[v, u]) == 1:
            kept.append((u, v))
    return np.array(kept).reshape(-1, 2)


def without_border(response: Array, cell: int, least: float) -> Array:
    """Wrong answer: squares whose slice would start below zero are empty to numpy, and give no maximum."""
    reach = (cell - 1) // 2
    found = largest_in_squares(response, cell, least)
    return found[(found >= reach).all(axis=1)]


def as_mask(response: Array, cell: int, least: float) -> BoolArray:
    """Wrong answer: a mask of the image."""
    mask = np.zeros(response.shape, np.bool_)
    u, v = largest_in_squares(response, cell, least).astype(int).T
    mask[v, u] = True
    return mask


def descriptors() -> list[Case]:
    """Descriptors, first with all candidates possible, then with some, with one, and with none.

    The most similar candidate by the sum of absolute differences differs from that by other measures.
    """
    rng = np.random.default_rng(SEED)
    cases: list[Case] = []
    for share in (1.0, 0.7, 0.7, 0.6):
        own = rng.integers(-20, 20, 6).astype(float)
        others = own + rng.integers(-9, 10, (8, 6))
        cases.append((own, others, rng.uniform(size=8) < share))
    own, others, _ = cases[0]
    return [*cases, (own, others, np.arange(8) == 5), (own, others, np.zeros(8, np.bool_))]


def most_similar(descriptor: Array, others: Array, possible: BoolArray) -> int:
    """Index of the possible descriptor with the smallest sum of absolute differences; -1 without one."""
    difference = np.where(possible, np.abs(others - descriptor).sum(axis=1), np.inf)
    return int(np.argmin(difference)) if possible.any() else -1


def similar(
    measure: Callable[..., Any] = np.abs, best: Callable[..., Any] = np.argmin, none: int | None = -1
) -> Callable[[Array, Array, BoolArray], int | None]:
    """Answer for the match of descriptors, by the sum of measured differences; `none` if nothing is possible."""

    def match(descriptor: Array, others: Array, possible: BoolArray) -> int | None:
        index = np.flatnonzero(possible)
        if len(index) == 0:
            return none
        return int(index[best(measure(others[index] - descriptor).sum(axis=1))])

    return match


def among_possible(descriptor: Array, others: Array, possible: BoolArray) -> int:
    """Wrong answer: the index counts only the possible candidates."""
    if not possible.any():
        return -1
    return int(np.argmin(np.abs(others[possible] - descriptor).sum(axis=1)))


def patches() -> list[Case]:
    """Windows of a smooth image at two places a fraction of a pixel apart, and the gradients of the first."""
    rows, columns = np.mgrid[-4:5, -4:5].astype(float)

    def cut_out(dx: float, dy: float, turn: float) -> Array:
        x = columns + dx
        y = rows + dy
        waves = np.sin(0.7 * x + turn) * np.cos(0.5 * y)
        return np.asarray(100.0 + 9 * x - 4 * y + 2.0 * waves * (5 + x + 2 * y))

    cases: list[Case] = []
    for turn, dx, dy in ((0.0, 0.4, 0.0), (1.0, 0.0, -0.3), (2.0, 0.3, 0.6)):
        window = cut_out(dx, dy, turn)
        gy, gx = np.gradient(window)
        cases.append((window, cut_out(0.0, 0.0, turn), gx, gy))
    return cases


def shift(window: Array, there: Array, gx: Array, gy: Array) -> Array:
    """The least-squares step (2,) from the window `there` to the place of `window`."""
    g = np.stack([gx.ravel(), gy.ravel()])
    return np.asarray(np.linalg.solve(g @ g.T, g @ (window - there).ravel()))


def by_axis(window: Array, there: Array, gx: Array, gy: Array) -> Array:
    """Wrong answer: each direction alone, as if Σ gx gy were zero."""
    rest = window - there
    return np.array([np.sum(gx * rest) / np.sum(gx * gx), np.sum(gy * rest) / np.sum(gy * gy)])


def right_side(window: Array, there: Array, gx: Array, gy: Array) -> Array:
    """Wrong answer: the right-hand side of the equation, not its solution."""
    return np.array([np.sum(gx * (window - there)), np.sum(gy * (window - there))])


def multiplied(window: Array, there: Array, gx: Array, gy: Array) -> Array:
    """Wrong answer: the matrix times the right-hand side, without the inverse."""
    g = np.stack([gx.ravel(), gy.ravel()])
    return np.asarray(g @ g.T @ g @ (window - there).ravel())


def of_sums(window: Array, there: Array, gx: Array, gy: Array) -> Array:
    """Wrong answer: the quotients of the sums of differences and gradients, without products."""
    rest = window - there
    return np.array([rest.sum() / gx.sum(), rest.sum() / gy.sum()])


def windows() -> list[Case]:
    """Gradients of a corner and of edges in many directions; rounding makes some eigenvalues negative."""
    rng = np.random.default_rng(0)
    across = rng.normal(size=(2, 20))  # directions of the edges
    size = rng.normal(size=(20, 5, 5))
    edges = [(across[0, i] * size[i], across[1, i] * size[i]) for i in range(20)]
    corner = rng.normal(size=(2, 5, 5))
    upright = rng.normal(size=(5, 5))
    return [(corner[0], corner[1]), (upright, np.zeros((5, 5))), *edges]


def eigenvalues(gx: Array, gy: Array, total: Callable[..., Any] = np.sum) -> Array:
    """Eigenvalues (2,) of the structure tensor, the smaller eigenvalue first."""
    return np.linalg.eigvalsh([[total(gx * gx), total(gx * gy)], [total(gx * gy), total(gy * gy)]])


def strength(gx: Array, gy: Array, total: Callable[..., Any] = np.sum) -> Any:
    """The square root of the smaller eigenvalue."""
    return np.sqrt(max(eigenvalues(gx, gy, total)[0], 0.0))


def unsorted(gx: Array, gy: Array) -> Any:
    """Wrong answer: the square root of the first eigenvalue of `np.linalg.eig`, not always the smaller eigenvalue."""
    M = [[np.sum(gx * gx), np.sum(gx * gy)], [np.sum(gx * gy), np.sum(gy * gy)]]
    return np.sqrt(max(np.linalg.eig(M)[0][0], 0.0))


def stereo_pairs() -> list[Case]:
    """Cases of three matches, two of them equal and good; then cases of six matches, with several limits."""
    left = np.tile([100.0, 50.0], (6, 1))
    right = np.array([[90.0, 50.4], [99.5, 51.0], [90.0, 52.0], [99.8, 50.0], [110.0, 50.0], [90.0, 48.0]])
    some = [(left[[0, 0, i]], right[[0, 0, i]], 1.0, 0.5) for i in (0, 2, 3, 4, 5)]
    return [*some, (left, right, 1.0, 0.5), (left, right, 2.5, 0.1), (left, right, 0.25, 9.0)]


def chains() -> list[Case]:
    """Cases of best matches of 12 features in four images; some chains are closed, others open or wrong."""
    cases = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        forward = [rng.permutation(12) for _ in range(3)]
        back = np.empty(12, np.intp)
        back[forward[2][forward[1][forward[0]]]] = np.arange(12)
        for chain in (*forward, back):
            chain[rng.integers(12, size=2)] = -1
            chain[rng.integers(12)] = rng.integers(12)
        cases.append((*forward, back))
    return cases


def follow(*steps: Index) -> tuple[Index, Any]:
    """The end of each feature's chain of matches, and whether the chain is complete."""
    at = np.arange(len(steps[0]))
    complete = np.ones(len(steps[0]), np.bool_)
    for step in steps:
        at = step[at]
        complete &= at >= 0
    return at, complete


def closed_loops(*steps: Index) -> Index:
    """Indices of the features whose chain returns to its start."""
    at, complete = follow(*steps)
    return np.flatnonzero(complete & returns(at))


def returns(end: Index) -> BoolArray:
    """Whether each feature's chain ends where it began."""
    return np.asarray(end == np.arange(len(end)))


def missing_at_the_start(*steps: Index) -> list[int]:
    """Wrong answer: closed loops of the features whose own number has a match in each list."""
    loops = []
    for i in closed_loops(*steps):
        if min(step[i] for step in steps) >= 0:
            loops.append(int(i))
    return loops


def positive_only(*steps: Index) -> Index:
    """Wrong answer: 0 counts as a missing match, as -1 does."""
    at = np.arange(len(steps[0]))
    complete = np.ones(len(at), np.bool_)
    for step in steps:
        at = step[at]
        complete &= at > 0
    return np.flatnonzero(complete & returns(at))


def crowd() -> list[Case]:
    """80 features with ages and strengths, and two grids of buckets; some squares have few features."""
    rng = np.random.default_rng(11)
    uv = rng.uniform(0, 1, (80, 2)) * np.array([300.0, 150.0])
    age = rng.integers(1, 4, 80)
    strength = rng.uniform(1, 9, 80)
    return [(uv, age, strength, 50, 3), (uv, age, strength, 70, 1)]


def stereo_check(
    row: Callable[..., Any] = np.abs,
    disparity: Callable[..., Any] = np.positive,
    limits: Callable[..., tuple[float, float]] = lambda most, least: (most, least),
) -> Callable[..., Any]:
    """Answer for the stereo check, which compares functions of the row difference and of the disparity.

    limits : the limits (most, least) that the answer uses, from those that it is given.
    """

    def check(left: Array, right: Array, row_tolerance: float, min_disparity: float) -> Any:
        most, least = limits(row_tolerance, min_disparity)
        difference = left - right
        return (row(difference[:, 1]) <= most) & (disparity(difference[:, 0]) >= least)

    return check


is_good = stereo_check()


def one_condition_is_enough(
    left: Array, right: Array, row_tolerance: float, min_disparity: float
) -> BoolArray:
    """Wrong answer: equal rows or a sufficient disparity."""
    difference = left - right
    return np.asarray((np.abs(difference[:, 1]) <= row_tolerance) | (difference[:, 0] >= min_disparity))


def parabolas() -> list[Case]:
    """Cases with the values of a parabola at -1, 0 and 1; its top is between them."""
    cases = []
    for place, height, curve in ((0.3, 5.0, -2.0), (-0.45, 1.0, -0.5), (0.0, 2.0, -1.0)):
        cases.append(tuple(height + curve * (x - place) ** 2 for x in (-1.0, 0.0, 1.0)))
    return cases


def place_of_top(left: float, middle: float, right: float) -> float:
    """The position of the maximum of the parabola through three values."""
    return (left - right) / 2 / (left - 2 * middle + right)


def height_of_top(left: float, middle: float, right: float) -> float:
    """Wrong answer: the height of the maximum, not its position."""
    return middle - (left - right) / 4 * place_of_top(left, middle, right)


def best_of_buckets(age_factor: int = 1, strength_factor: int = 1) -> Callable[..., Index]:
    """Answer for the buckets, with ages and strengths times a factor: -1 prefers small ones, 0 ignores them."""

    def best(uv: Array, age: IntArray, strength: Array, size: int, count: int) -> Index:
        config = BucketConfig(size=size, features=count)
        return select_by_bucket(uv, age_factor * age, strength_factor * strength, config)

    return best


kept = best_of_buckets()


def in_columns(uv: Array, age: Array, strength: Array, size: int, count: int) -> Index:
    """Wrong answer: the buckets are whole columns of the image."""
    u_alone = np.stack([uv[:, 0], np.zeros(len(uv))], axis=1)
    return kept(u_alone, age, strength, size, count)


def in_rows(uv: Array, age: Array, strength: Array, size: int, count: int) -> Index:
    """Wrong answer: the buckets are whole rows of the image."""
    v_alone = np.stack([np.zeros(len(uv)), uv[:, 1]], axis=1)
    return kept(v_alone, age, strength, size, count)


def in_sorted_list(uv: Array, age: Array, strength: Array, size: int, count: int) -> Index:
    """Wrong answer: positions of the selected features in the sorted list, not their indices."""
    order = np.lexsort((-strength, -age))
    return np.flatnonzero(np.isin(order, kept(uv, age, strength, size, count)))


def in_full_squares(uv: Array, age: Array, strength: Array, size: int, count: int) -> Index:
    """Wrong answer: squares with fewer than `count` features keep none."""
    index = kept(uv, age, strength, size, count)
    squares = uv[index] // size
    same_square = (squares[:, None] == squares).all(axis=2)
    is_full = same_square.sum(axis=1) == count
    return np.asarray(index[is_full])


def overfull(got: Array, uv: Array, age: Array, strength: Array, size: int, count: int) -> bool:
    """Whether a square has more than `count` of the features that an answer keeps."""
    squares = uv[got.astype(int)] // size
    _, counts = np.unique(squares, axis=0, return_counts=True)
    return bool(counts.max() > count)


maxima = Exercise(
    largest_in_squares,
    responses,
    form=sorted_rows,
    praise="blobs and corners are such places: the responses around them are smaller.",
    hint="for each pixel (u, v) with a response above `least`: cut out the square and compare with its `max()`.",
    line="square = response[max(v - half, 0) : v + half + 1, max(u - half, 0) : u + half + 1]",
    library=("describe",),
    slips={"columns": "this is (row, column); a pixel is (u, v), its column first."},
    mistakes={
        "minima are included: a minimum is a maximum of `-response`, and is searched there.": (
            lambda response, cell, least: largest_in_squares(np.abs(response), cell, least)
        ),
        "responses of at most `least` are included.": (
            lambda response, cell, least: largest_in_squares(response, cell, -np.inf),
            lambda response, cell, least: largest_in_squares(response, cell, least - TINY),
        ),
        "these are the minima of the response.": lambda response, cell, least: largest_in_squares(
            -response, cell, least
        ),
        "this is a mask of the image; return its pixels (u, v).": as_mask,
        "this is only the largest response of the whole image; each square has its own.": (
            lambda response, cell, least: np.argwhere(response == response.max())[:, ::-1],
            lambda response, cell, least: np.argwhere(response == response.max())[:1, ::-1],
        ),
        "maxima near the upper and left border are missing: there a slice would start below zero, which numpy "
        "counts from the end; begin it at `max(v - half, 0)`.": without_border,
        "every response above `least` is included: keep those that are the largest of their square.": (
            lambda response, cell, least: largest_in_squares(response, 1, least)
        ),
        "the square is too large: `cell` is its whole side, so it reaches (cell - 1) / 2 pixels to each side.": (
            lambda response, cell, least: largest_in_squares(response, cell, least, half=cell),
            lambda response, cell, least: largest_in_squares(response, cell, least, half=(cell + 1) // 2),
        ),
        "the square lacks its last row and column: a slice ends before its end.": (
            lambda response, cell, least: largest_in_squares(response, cell, least, short=1)
        ),
        "the maxima near the border are missing: there the square is cut off.": (
            lambda response, cell, least: largest_in_squares(response, cell, least, edge=(cell - 1) // 2),
            lambda response, cell, least: largest_in_squares(response, cell, least, edge=1),
        ),
        "`cell` is hard-coded: use the argument.": (
            lambda response, cell, least: largest_in_squares(response, 3, least),
            lambda response, cell, least: largest_in_squares(response, 5, least),
            lambda response, cell, least: largest_in_squares(response, 19, least),
        ),
        "`least` is hard-coded: use the argument.": (
            lambda response, cell, least: largest_in_squares(response, cell, 50.0)
        ),
        "of two equal responses in a square, none is found; compare with `>=` or `==`.": alone,
    },
)

best_match = Exercise(
    most_similar,
    descriptors,
    praise="this is the sum of absolute differences, and the comparison is over all possible candidates.",
    hint="subtract the descriptor from all rows of `others`, sum the absolute values of each row, and take the "
    "smallest sum among the possible ones.",
    line="np.argmin(np.where(possible, np.abs(others - descriptor).sum(axis=1), np.inf))",
    library=("best_matches", "stereo_matches"),
    mistakes={
        "this compares sums of squares: one large difference then outweighs many middling ones.": (
            similar(np.square)
        ),
        "`possible` is not used: the most similar candidate may be of another kind, or too far away.": (
            lambda descriptor, others, possible: most_similar(
                descriptor, others, np.ones(len(others), np.bool_)
            )
        ),
        "the index counts only the possible candidates; return the index in `others`.": among_possible,
        "without a possible candidate the result is -1.": (
            similar(none=0),
            similar(none=7),
            similar(none=None),
        ),
        "a product with the mask makes the sums of impossible candidates zero, the smallest of all; make them "
        "infinite with `np.where`.": lambda descriptor, others, possible: (
            int(np.argmin(np.abs(others - descriptor).sum(axis=1) * possible)) if possible.any() else -1
        ),
        "this is the least similar candidate.": similar(best=np.argmax),
        "positive and negative differences cancel: take absolute values before the sum.": (
            similar(np.positive),
            similar(np.negative),
            similar(np.positive, lambda sums: np.argmin(np.abs(sums))),
        ),
        "the smallest of all differences is not enough: sum over all numbers of a descriptor.": (
            similar(lambda d: np.abs(d).min(axis=1, keepdims=True)),
            similar(lambda d: np.abs(d).max(axis=1, keepdims=True)),
        ),
        "this is the smallest sum; the task asks for the index of the candidate.": (
            lambda descriptor, others, possible: np.min(
                np.abs(others - descriptor).sum(axis=1), initial=np.inf, where=possible
            )
        ),
    },
)

lucas_kanade_step = Exercise(
    shift,
    patches,
    praise="a step of ({got[0]:.3f}, {got[1]:.3f}) px in the first case. The next cell repeats it.",
    hint="the equation has two unknowns: build the 2×2 matrix of the sums Σ gx², Σ gx gy, Σ gy² and the two sums "
    "Σ gx (window - there), Σ gy (window - there), then solve.",
    line="np.linalg.solve(g @ g.T, g @ (window - there).ravel()), where g = np.stack([gx.ravel(), gy.ravel()])",
    library=("calcOpticalFlowPyrLK", "track"),
    slips={
        "sign": "the sign is wrong: the difference is window - there.",
    },
    mistakes={
        "without Σ gx gy the two directions are separate, which is right only for windows whose gradients are "
        "uncorrelated.": by_axis,
        "one side of the equation has means and the other has sums.": (
            lambda window, *others: shift(window, *others) * window.size,
            lambda window, *others: shift(window, *others) / window.size,
        ),
        "this is the right-hand side; the equation still has to be solved.": right_side,
        "this multiplies by the matrix; solve with it.": multiplied,
        "the sums have products, pixel by pixel: gx times the difference, and gx times gx.": of_sums,
        "the two numbers are exchanged: δ is (along u, along v), and `gx` belongs to u.": lambda window, there, gx, gy: (
            shift(window, there, gy, gx)
        ),
    },
)

corner_strength = Exercise(
    strength,
    windows,
    atol=1e-3,  # single precision leaves 2e-4 on an exact edge, where the strongest corner has several units
    praise="0 on an edge, large on a corner. The library computes this strength for all pixels at once.",
    hint="M is 2×2: sum gx², gx gy and gy² over the window; then take the root of the smaller eigenvalue.",
    line="M = [[np.sum(gx * gx), np.sum(gx * gy)], [np.sum(gx * gy), np.sum(gy * gy)]]; np.linalg.eigvalsh(M)",
    library=("corner_strength",),
    slips={"square": "this is correct except for the square root."},
    mistakes={
        "this is the larger eigenvalue; it is large on an edge.": lambda *g: np.sqrt(eigenvalues(*g)[1]),
        "`np.linalg.eig` gives the eigenvalues in no order, and the first is not always the smaller; "
        "`np.linalg.eigvalsh` sorts them.": unsorted,
        "both eigenvalues are returned; return only the smaller one.": eigenvalues,
        "this takes means over the window; M is a sum.": lambda gx, gy: strength(gx, gy, np.mean),
        "without Σ gx gy, a slanting edge looks like a corner.": lambda gx, gy: np.sqrt(
            min(np.sum(gx * gx), np.sum(gy * gy))
        ),
        "this is a matrix product of the windows; multiply each pixel's gx by its own gy: `gx * gy`.": (
            lambda gx, gy: np.sqrt(max(np.linalg.eigvalsh(gx @ gy.T)[0], 0.0)),
            lambda gx, gy: strength(gx, gy, lambda products: products),
        ),
        "NaN on an edge: rounding can make an eigenvalue -1e-17, and the root of a negative number is NaN.": Condition(
            lambda got, *case: np.isnan(got) and eigenvalues(*case)[0] < 1e-9
        ),
    },
)

is_stereo = Exercise(
    is_good,
    stereo_pairs,
    praise="every good match has equal rows and a sufficient disparity.",
    hint="each match has two conditions, one on its rows and one on its columns; the mask is True where both hold.",
    line="(np.abs(left[:, 1] - right[:, 1]) <= row_tolerance) & (left[:, 0] - right[:, 0] >= min_disparity)",
    mistakes={
        "rows and columns are exchanged: a point is (u, v), its column first.": (
            lambda left, right, *limits: is_good(left[:, ::-1], right[:, ::-1], *limits)
        ),
        "one of the two conditions is enough here; join both masks by `&`.": one_condition_is_enough,
        "the two limits are exchanged.": stereo_check(limits=lambda most, least: (least, most)),
        "1 and 0.5 are hard-coded: use the limits given.": stereo_check(
            limits=lambda most, least: (1.0, 0.5)
        ),
        "a match exactly at a limit is good: use <= and >=.": (
            stereo_check(limits=lambda most, least: (most - TINY, least + TINY)),
            stereo_check(limits=lambda most, least: (most - TINY, least)),
            stereo_check(limits=lambda most, least: (most, least + TINY)),
        ),
        "the match whose rows differ by two is judged good.": (
            stereo_check(row=np.zeros_like),
            stereo_check(row=np.zeros_like, disparity=np.abs),
        ),
        "a disparity of 0.2 px is judged good.": stereo_check(limits=lambda most, least: (most, -np.inf)),
        "the match with a negative disparity is judged good.": stereo_check(disparity=np.abs),
        "the row difference needs an absolute value.": (stereo_check(np.positive), stereo_check(np.negative)),
        "the disparity is left column minus right column.": stereo_check(disparity=np.negative),
        "matches with a small disparity are judged good, and matches with a sufficient disparity bad.": stereo_check(
            disparity=np.negative, limits=lambda most, least: (most, -least)
        ),
    },
)

loop_closes = Exercise(
    lambda pl_pr, pr_cr, cr_cl, cl_pl: closed_loops(pl_pr, pr_cr, cr_cl, cl_pl),
    chains,
    form=in_order,
    praise="the loop has four matches and one condition, and few wrong matches pass.",
    hint="follow feature i: pl_pr[i] is its number in the next image, and its index in the next list.",
    line="at = step[at]; alive &= at >= 0",
    mistakes={
        "a match of -1 was followed: to numpy, index -1 is the last element.": Condition(
            lambda got, *chain: set(closed_loops(*chain)) < set(got) and len(got) < len(chain[0])
        ),
        "these reach the current left image; the loop has to end at its first feature.": lambda *chain: (
            np.flatnonzero(follow(*chain[:3])[1])
        ),
        "this tests for -1 at i in each list, but the feature's number changes with every step.": (
            missing_at_the_start,
            lambda *chain: np.flatnonzero(np.min(chain, axis=0) >= 0),
            lambda *chain: np.flatnonzero((np.min(chain, axis=0) >= 0) & returns(follow(*chain)[0])),
        ),
        "the four lists are applied in the reverse order.": lambda *chain: closed_loops(*chain[::-1]),
        "loops through a feature 0 are missing: 0 is the number of a feature, and only -1 marks a missing match.": (
            lambda *chain: [i for i in closed_loops(*chain) if i > 0],
            positive_only,
        ),
        "a search is left out: the loop has four steps, and each result is the index into the next list.": (
            lambda pl_pr, pr_cr, cr_cl, cl_pl: closed_loops(pl_pr, pr_cr, cl_pl),
            lambda pl_pr, pr_cr, cr_cl, cl_pl: closed_loops(pl_pr, cr_cl, cl_pl),
            lambda pl_pr, pr_cr, cr_cl, cl_pl: closed_loops(pr_cr, cr_cl, cl_pl),
            lambda pl_pr, pr_cr, cr_cl, cl_pl: closed_loops(pl_pr, pr_cr, cr_cl),
            lambda pl_pr, pr_cr, cr_cl, cl_pl: np.flatnonzero(returns(cl_pl[pr_cr[pl_pr]])),
            lambda pl_pr, pr_cr, cr_cl, cl_pl: np.flatnonzero(returns(cl_pl[cr_cl[pl_pr]])),
            lambda pl_pr, pr_cr, cr_cl, cl_pl: np.flatnonzero(returns(cl_pl[cr_cl[pr_cr]])),
            lambda pl_pr, pr_cr, cr_cl, cl_pl: np.flatnonzero(returns(cr_cl[pr_cr[pl_pr]])),
        ),
        "these are indices into the previous right image.": lambda *chain: chain[0][closed_loops(*chain)],
    },
)

peak = Exercise(
    place_of_top,
    parabolas,
    praise="three values determine a parabola; its top is between the pixels.",
    hint="put x = -1 and x = 1 into f(x) = middle + b x + a x² and solve for a and b; the slope is 0 at x = -b / (2a).",
    line="(left - right) / 2 / (left - 2 * middle + right)",
    mistakes={
        "this is the height of the top, not its position.": height_of_top,
    },
    slips={
        "sign": "the sign is wrong: the top is on the side of the larger neighbour.",
        "one more": "this is counted from the left value; count from the middle value.",
    },
)

buckets = Exercise(
    kept,
    crowd,
    form=in_order,
    praise="the features are spread over the image, and the oldest come first.",
    hint="sort all features, the best first; keep each feature whose square is not yet full.",
    line="for i in np.lexsort((-strength, -age)): square = tuple(uv[i] // size)",
    library=("select_by_bucket",),
    mistakes={
        "age comes first; strength decides among features of the same age.": best_of_buckets(age_factor=0),
        "the youngest and weakest are kept: in `np.lexsort`, both keys need a minus.": best_of_buckets(
            -1, -1
        ),
        "the youngest are kept; the oldest come first.": best_of_buckets(age_factor=-1),
        "of features of the same age the weakest are kept.": best_of_buckets(strength_factor=-1),
        "`size` is hard-coded: use the argument.": lambda *case: kept(*case[:3], 50, case[4]),
        "`count` is hard-coded: use the argument.": lambda *case: kept(*case[:4], 3),
        "these are ranks in the sorted list; return the indices of the features, `order[rank]`.": in_sorted_list,
        "a square is overfull; the square of a feature is `uv // size`, column and row.": Condition(overfull),
        "the ages are right, but among features of the same age strength is not used.": Condition(
            lambda got, uv, age, *more: sorted(age[got]) == sorted(age[kept(uv, age, *more)])
        ),
        "neither age nor strength is used.": best_of_buckets(0, 0),
        "only `count` features in all are kept; keep `count` in each square.": (
            lambda uv, age, strength, size, count: np.lexsort((-strength, -age))[:count],
        ),
        "squares with fewer than `count` features are empty; such a square keeps all its features.": (
            in_full_squares
        ),
        "a square keeps one feature more than `count`.": lambda *case: kept(*case[:4], case[4] + 1),
        "the image is cut into strips, not squares: a square is a column and a row of the grid.": (
            in_columns,
            in_rows,
        ),
    },
)

too_strict = Exercise(
    {"right ones dropped": 140.0, "wrong among the kept": 9.0},
    praise="{right ones dropped:.0f} correct matches are dropped, and {wrong among the kept:.0f} wrong matches are "
    "still kept. A strict check is not a safe check.",
    mistakes={
        "this sequence has no truth for single matches: choose a drawn sequence.": lambda now: np.isnan(
            now["right ones dropped"]
        ),
        "only {right ones dropped:.0f} correct matches are dropped. Set one tolerance below the accuracy of the "
        "matches.": lambda now: not now["right ones dropped"] > 100,
    },
)
