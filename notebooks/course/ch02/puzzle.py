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
AT_PLACE_PX = 0.5  # … and this near to the place where its stereo depth and the good solution put it


@dataclass(frozen=True, eq=False)
class Puzzle:
    """Five matches of a frame, their solutions, and a sixth match.

    Attributes
    ----------
    five : (5,) indices of the matches.
    E : (M, 3, 3) all solutions, the one with the smallest image error first.
    sixth : index of a right match on the line of the first solution and far from the lines of the others.
    draws : number of random sets until this one.
    """

    five: Index
    E: Array
    sixth: int
    draws: int


def off_place(E: Array, five: Index, points: Points) -> Array:
    """Distances (N,) of matches from their places by E and their stereo depths, normalised units.

    A line says nothing about errors along it. The stereo depth does: it puts the point X_p at one place of the
    current image. The length of t is the median over the matches of stereo depth / depth by E. Infinite where E
    has the point behind a camera, and where its place is behind the current camera.
    """
    motion = library.choose_motion(library.four_motions(E), points.x_p[five], points.x_c[five])
    d_p, d_c = library.two_depths(motion, points.x_p, points.x_c)
    in_front = (d_p > 0) & (d_c > 0) & np.isfinite(d_p) & np.isfinite(d_c)
    away = np.full(len(d_p), np.inf)
    if not in_front.any():
        return away
    length = float(np.median(points.X_p[in_front, 2] / d_p[in_front]))
    X_c = points.X_p @ motion[:, :3].T + length * motion[:, 3]
    seen = in_front & (X_c[:, 2] > 0)
    away[seen] = np.linalg.norm(X_c[seen, :2] / X_c[seen, 2:] - points.x_c[seen], axis=1)
    return away


def find_puzzle(points: Points, focal: float) -> Puzzle:
    """Draw sets of five until one has a good solution, and a right match that separates the solutions.

    No truth is used. Where no set of `SETS` is good enough, the result is the one that separates best. Raises
    ValueError if no set has a solution.

    focal : focal length, pixels.
    """
    sets = draw_sets(np.random.default_rng(0), len(points.x_p), SETS)
    solved = five_point(points.x_p[sets], points.x_c[sets])
    errors = truncated_errors(solved.E, points.x_p, points.x_c, GOOD_PX / focal)
    best: Puzzle | None = None
    largest = -1.0
    for number, five in enumerate(sets):
        members = np.flatnonzero(solved.set_index == number)
        has_enough = len(members) >= LEAST_SOLUTIONS
        is_first = best is None and len(members) > 0  # with few solutions, but better than none
        if not has_enough and not is_first:
            continue
        E = solved.E[members[np.argsort(errors[members])]]
        sixth, separation, is_good = _sixth_match(E, five, points, focal)
        puzzle = Puzzle(five, E, sixth, number + 1)
        if has_enough and is_good and separation > OFF_LINE_PX:
            return puzzle
        quality = separation if is_good and np.isfinite(separation) else 0.0
        if quality > largest:
            best = puzzle
            largest = quality
    if best is None:
        raise ValueError("no five of the matches determine an essential matrix: the camera may stand still")
    return best


def _sixth_match(E: Array, five: Index, points: Points, focal: float) -> tuple[int, float, bool]:
    """The match on the line of the first solution that is farthest from the lines of all others.

    Such a match is often a wrong one that is on its line by accident; so its place must agree with its stereo depth.

    Parameters
    ----------
    E : (M, 3, 3) the solutions of a set, the one with the smallest image error first. five : (5,) the set.

    Returns
    -------
    The index of the match, its distance from the nearest of the other lines, pixels, and whether most matches are
    near the lines of the first solution.
    """
    distances = focal * np.array([library.distances(each, points.x_p, points.x_c) for each in E])
    nearest_other = distances[1:].min(axis=0, initial=np.inf)
    nearest_other[five] = 0.0
    nearest_other[distances[0] > ON_LINE_PX] = 0.0
    nearest_other[focal * off_place(E[0], five, points) > AT_PLACE_PX] = 0.0
    sixth = int(np.argmax(nearest_other))
    is_good = bool(np.mean(distances[0] < GOOD_PX) > GOOD_SHARE)
    return sixth, float(nearest_other[sixth]), is_good
