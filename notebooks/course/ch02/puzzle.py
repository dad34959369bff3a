"""The five matches of chapter 2's puzzle: all their solutions, and a sixth match that tells them apart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vo_lib.geometry.types import Array, Index
from vo_lib.paper.five_point import five_point
from vo_lib.paper.selection import draw_sets, truncated_errors

from ..frames import Points
from . import library

SETS = 400  # random sets that are tried
LEAST_SOLUTIONS = 3
GOOD_PX = 1.0  # a good solution passes within this distance of most matches
GOOD_SHARE = 0.8
ON_LINE_PX = 0.5  # the sixth match is this near to the line of the good solution …
OFF_LINE_PX = 10.0  # … and this far from all other lines


@dataclass(frozen=True, eq=False)
class Puzzle:
    """Five matches of a frame, their solutions, and a sixth match.

    Attributes
    ----------
    five : (5,) indices of the matches.
    E : (M, 3, 3) all solutions, the one with the smallest image error first.
    sixth : index of a match on the line of the first solution and far from the lines of the others.
    draws : number of random sets until this one.
    """

    five: Index
    E: Array
    sixth: int
    draws: int


def find_puzzle(points: Points, focal: float) -> Puzzle:
    """Draw sets of five until one has a good solution, and a match that separates the solutions.

    No truth is used. Where no set of `SETS` is good enough, the result is the one that separates best.
    """
    sets = draw_sets(np.random.default_rng(0), len(points.x_p), SETS)
    solved = five_point(points.x_p[sets], points.x_c[sets])
    errors = truncated_errors(solved.E, points.x_p, points.x_c, GOOD_PX / focal)
    best: Puzzle | None = None
    largest = -1.0
    for number, five in enumerate(sets):
        members = np.flatnonzero(solved.set_index == number)
        if len(members) < LEAST_SOLUTIONS and not (best is None and len(members)):
            continue
        E = solved.E[members[np.argsort(errors[members])]]
        far = focal * np.array([library.distances(each, points.x_p, points.x_c) for each in E])
        nearest_other = far[1:].min(axis=0, initial=np.inf)
        nearest_other[five] = 0.0
        nearest_other[far[0] > ON_LINE_PX] = 0.0
        sixth = int(np.argmax(nearest_other))
        separation = float(nearest_other[sixth])
        good = bool(np.mean(far[0] < GOOD_PX) > GOOD_SHARE)
        if len(E) >= LEAST_SOLUTIONS and good and separation > OFF_LINE_PX:
            return Puzzle(five, E, sixth, number + 1)
        quality = separation if good and np.isfinite(separation) else 0.0
        if quality > largest:
            best = Puzzle(five, E, sixth, number + 1)
            largest = quality
    if best is None:
        raise ValueError("no five of the matches determine an essential matrix: the camera may stand still")
    return best
