"""Chapter 1: what becomes of each feature in one step of a front end, repeated with one more check each time."""

from __future__ import annotations

import copy
import dataclasses
import functools
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vo_lib.data.sequence import Sequence
from vo_lib.geometry.matches import StereoMatches, empty_matches
from vo_lib.geometry.types import Array, Index
from vo_lib.paper.buckets import select_by_bucket
from vo_lib.paper.features import best_matches
from vo_lib.paper.matching import DescribedPair, close_loop
from vo_lib.paper.settings import MethodConfig, PublishedConfig, StereoLimits
from vo_lib.runs.drive import single_threaded

from ..frames import before_step, key_of
from ..memory import Memory

# For each check of a match: the fate of a match that fails it, and the loosest values of the settings of the check. A
# match that fails a check even with these counts as `LOST`.
CHECKS: dict[str, dict[str, Any]] = {
    "looks different": {"max_difference": 255.0},
    "rows, disparity": {"row_tolerance": 10.0, "min_disparity": 0.05},
    "off its surface": {"surface_tolerance": 10.0, "surface_share": 0.0},
    "two ways differ": {"loop_tolerance": 10.0},
}
OPEN = "loop stays open"
LOST = "not found again"
SURPLUS = "bucket is full"
CHOSEN = "kept"

_histories: Memory[tuple[Any, Any]] = Memory(16)  # of 4 MB each; a drag goes back and forth
_steps: Memory[StereoMatches] = Memory(48)
_loops: Memory[tuple[Index, ...]] = Memory(16)


@dataclass(frozen=True, eq=False)
class Trace:
    """N features of the previous pair, each with a stereo match there, and their fates.

    Attributes
    ----------
    id : (N,) numbers of the features.
    fates : possible fates of a feature, in the order of the steps; fate : (N,) fate of each feature.
    matches : the M features that are matched with the loosest checks; index : (M,) their indices in `id`.
    checked : matches that pass all checks; chosen : those of them that the buckets select.
    lost : matches of closed loops in whole pixels that are lost in the refinement (not found again by Lucas-Kanade, or
        beyond the loosest limits); none for the kit.
    """

    id: NDArray[np.int64]
    fates: tuple[str, ...]
    fate: NDArray[np.str_]
    matches: StereoMatches
    index: NDArray[np.int64]
    checked: StereoMatches
    chosen: StereoMatches
    lost: StereoMatches


def trace(sequence: Sequence, frame: int, config: MethodConfig) -> Trace:
    """Fates of the features of the previous pair of `frame`, for the configuration's front end.

    Earlier pairs are matched with the default checks: the settings of the matching apply to this step only.
    """
    usual = dataclasses.replace(config, matching=type(config.matching)())
    key = (*key_of(sequence, frame), usual.features, usual.matching)
    before, pair = _histories.get(key, lambda: before_step(sequence, frame, usual))
    checks = _checks_of(config)
    results = _results_by_check(before, pair, _with_checks(config, checks), key)
    passing = functools.reduce(np.intersect1d, [each.id for each in results])
    last = results[-1]
    checked = last[np.isin(last.id, passing)]
    in_buckets = select_by_bucket(checked.cur_left, checked.age, checked.strength, config.buckets)
    chosen = checked[in_buckets]
    fates: tuple[str, ...] = (LOST, *checks, SURPLUS, CHOSEN)
    passed = [each.id for each in (*results, chosen)]  # numbers of the features that pass each step
    lost = empty_matches()
    if isinstance(config, PublishedConfig):
        # The paper's front end keeps the previous pair with its features (`DescribedPair`), and in `_id` the
        # numbers of the left ones.
        previous = before._previous
        ids = before._id
        number = ids[previous.to_right >= 0]
        radius = config.matching.search_radius
        loops = _loops.get((*key, radius), lambda: close_loop(previous, pair, radius))
        prev_left, *_ = loops  # the features of closed loops, as indices in each image
        in_loops = ids[prev_left]
        fates = (OPEN, *fates)
        passed = [in_loops, *passed]
        lost = whole_pixels(previous, pair, *loops)[~np.isin(in_loops, results[0].id)]
    else:
        # The kit's keeps a tuple: the previous pair, and its features, which have their numbers with them.
        _, features = before._previous
        number = features.id
    # How many steps in a row each feature passes, from the first on; its fate is the name of the step where it stops.
    steps_passed = np.cumprod([np.isin(number, each) for each in passed], axis=0).sum(axis=0)
    fate = np.array(fates)[steps_passed]
    order = np.argsort(number)
    index = order[np.searchsorted(number, results[0].id, sorter=order)]
    return Trace(number, fates, fate, results[0], index, checked, chosen, lost)


def _checks_of(config: MethodConfig) -> dict[str, dict[str, Any]]:
    """Those of the checks that the configuration's front end has: the paper's has some of them."""
    checks = {}
    for name, loosest in CHECKS.items():
        if all(hasattr(config.matching, setting) for setting in loosest):
            checks[name] = loosest
    return checks


def _with_checks(config: MethodConfig, checks: dict[str, dict[str, Any]]) -> list[StereoLimits]:
    """The settings of the matching with the loosest checks, then with one more of the checks that are set each time."""
    stages = []
    for on in range(len(checks) + 1):
        loosest: dict[str, Any] = {}
        for values in list(checks.values())[on:]:
            loosest |= values
        stages.append(dataclasses.replace(config.matching, **loosest))
    return stages


def _results_by_check(
    before: Any, pair: Any, stages: list[StereoLimits], key: tuple[Any, ...]
) -> list[StereoMatches]:
    """The matches of the same step with the settings of each stage.

    before : the front end that has processed the earlier pairs. pair : the prepared pair of the step. key : of the
    step in the memory.
    """

    def step(stage: StereoLimits) -> StereoMatches:
        def make() -> StereoMatches:
            # A step replaces the attributes of the front end and changes none in place: a shallow copy is enough.
            front_end = copy.copy(before)
            front_end.config = stage
            matches: StereoMatches = front_end.step(pair)
            return matches

        return _steps.get((*key, stage), make)

    with ThreadPoolExecutor(max_workers=2) as pool, single_threaded():
        return list(pool.map(step, stages))


def whole_pixels(
    before: DescribedPair,
    now: DescribedPair,
    prev_left: Index,
    prev_right: Index,
    cur_left: Index,
    cur_right: Index,
) -> StereoMatches:
    """Whole-pixel positions of N loops, from the indices (N,) of their features in each image.

    The numbers of the matches are the indices of the previous left features.
    """
    return StereoMatches(
        before.in_left.uv[prev_left],
        before.in_right.uv[prev_right],
        now.in_left.uv[cur_left],
        now.in_right.uv[cur_right],
        np.ones(len(prev_left), np.int64),
        before.in_left.strength[prev_left],
        prev_left,
    )


def open_loops(before: DescribedPair, now: DescribedPair, radius: int) -> tuple[StereoMatches, Array]:
    """Matches whose loop is complete but ends at another feature, and the places (N, 2) where it ends."""
    start = np.flatnonzero(before.to_right >= 0)
    prev_right = before.to_right[start]
    cur_right = best_matches(before.in_right, now.in_right, radius)[prev_right]
    cur_left = np.where(cur_right >= 0, now.to_left[cur_right], -1)
    end = np.where(cur_left >= 0, best_matches(now.in_left, before.in_left, radius)[cur_left], -1)
    astray = (end >= 0) & (end != start)
    loops = whole_pixels(before, now, start[astray], prev_right[astray], cur_left[astray], cur_right[astray])
    return loops, before.in_left.uv[end[astray]]
