"""The ideas of variant `kit`, the changes that turn off each idea, and the tables of the effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vo_lib.data.catalogue import SYNTHETIC
from vo_lib.geometry.symmetric import FULL
from vo_lib.geometry.types import Array
from vo_lib.kit import rig
from vo_lib.kit.klt import NO_MATCHES, next_motion
from vo_lib.kit.surface import fit_surface
from vo_lib.paper.matching import LoopMatcher, is_stereo
from vo_lib.paper.settings import FeatureConfig, MatchingConfig, TranslationConfig
from vo_lib.paper.translation import solve_translation
from vo_lib.report.page import ReportTable

PROPOSAL, MOVING = "feature_selection", "moving_selection"
KLT, ALIGN, ODO, RIG = (f"vo_lib.kit.{name}" for name in ("klt", "alignment", "kit_odometry", "rig"))
FRONT_END = ("matching.", "vo_lib.runs.front_end", KLT, ALIGN)
KEY = ("idea", "method", "sequence")
# Titles of the tables, and their quantities.
CHANGES = {
    "Change of TE, %,": "te",
    "Change of RE, %,": "re",
    "Change of the length, percentage points,": "length",
}
COLUMNS = (*KEY, "lines", "seeds", "te", "te_sd", "re", "re_sd", "length", "length_sd", "ms")


@dataclass(frozen=True)
class Idea:
    """An idea of variant `kit`.

    Attributes
    ----------
    name : name of the idea in the table. lines : number of code lines of the idea.
    off : names of settings (dotted), functions or constants (full), with values that turn off the idea.
    method : the method in which the idea is turned off.
    stays : reason to keep an idea that does not reduce the errors.
    """

    name: str
    lines: int
    off: dict[str, Any]
    method: str = PROPOSAL
    stays: str = ""

    @property
    def finds_matches(self) -> bool:
        """Whether turning the idea off changes the matches."""
        return any(name.startswith(FRONT_END) for name in self.off)


# All ideas turned on; the time of ideas of the front end includes the matching.
WHOLE = (
    Idea("", 0, {}),
    Idea("", 0, {}, MOVING),
    Idea("with matching", 0, {f"{KLT}.NO_MATCHES": NO_MATCHES}),
)


def from_last_place(self: Any, before: Any, features: Any, pair: Any) -> Any:
    """Replacement for `KltMatcher._follow` that makes no prediction."""
    positions = features.left, features.right
    result = self._close_loop(before, pair, features, positions, self.config.search_levels)
    self._motion, _ = next_motion(self.camera, result[0], self._motion)
    return result


def searched_once(self: Any, before: Any, features: Any, pair: Any) -> Any:
    """Replacement for `KltMatcher._follow` that does not search again after a failed prediction."""
    if self._motion is None:
        return from_last_place(self, before, features, pair)
    R, t = self._motion
    guess = self.camera.project(self.camera.triangulate(features.left, features.right) @ R.T + t)
    result = self._close_loop(before, pair, features, guess, self.config.levels)
    self._motion, _ = next_motion(self.camera, result[0], self._motion)
    return result


def square_in_stereo(slope: Array) -> Array:
    """Replacement for `stereo_warp` that leaves windows square."""
    return np.tile(np.eye(2), (len(slope), 1, 1))


def square_over_time(camera: Any, uv: Array, *_: Any) -> Array:
    """Replacement for `motion_warp` that leaves windows square."""
    return square_in_stereo(uv)


def coarse_over_time(
    camera: Any, before: Any, pair: Any, previous: Any, slope: Any, start: Any, *_: Any
) -> Any:
    """Replacement for `refine_over_time` that does not change the positions."""
    return (*start, np.ones(len(slope), np.bool_))


def coarse_in_stereo(pair: Any, coarse: Any, left: Array, right: Array, config: Any) -> Any:
    """Replacement for `refine_stereo` that does not change the positions."""
    surface = fit_surface(coarse, left, left[:, 0] - right[:, 0])
    ok = np.abs(left[:, 0] - right[:, 0] - surface.disparity) <= config.surface_tolerance
    return right, surface.slope, ok & (surface.share >= config.surface_share) & is_stereo(left, right, config)


def papers_translation(camera: Any, matches: Any, R_cp: Array, config: Any) -> Any:
    """Replacement for `robust_translation`: the paper's `solve_translation`."""
    solved = solve_translation(camera, matches, R_cp, TranslationConfig())
    return solved and (solved[0], np.where(solved[1], 0.0, np.inf))


def least_squares(system: Any, limit: float) -> Array:
    """Replacement for `robust_start`: least squares over all features."""
    return np.asarray(np.linalg.solve(system.W.sum(axis=1)[FULL], system.right_sides().sum(axis=1)))


def as_estimated(self: Any, estimate: Array, covariance: Array) -> None:
    """Replacement for `Rig.set_estimate` that does not shrink the estimate."""
    self.estimate, self.covariance, self.errors = estimate, covariance, estimate.copy()


def without(*names: str) -> dict[str, Any]:
    """The change that fixes at zero the calibration errors whose names begin with one of `names`."""
    share = np.where([name.startswith(names) for name in rig.ERROR_NAMES], 1e-4, 1.0)
    prior = rig.prior_covariance() * np.outer(share, share)
    return {f"{RIG}.prior_covariance": lambda: prior}


def without_faults(*names: str) -> dict[str, Any]:
    """The change that removes the faults of the rig whose names begin with one of `names`."""
    faults = {name: fault for name, fault in rig.RIG_FAULTS.items() if not name.startswith(names)}
    return {f"{RIG}.RIG_FAULTS": faults}


IDEAS = (
    Idea(
        "front end (turned off: the paper's)",
        600,
        {"vo_lib.runs.front_end.make_front_end": lambda *_: LoopMatcher(FeatureConfig(), MatchingConfig())},
    ),
    Idea("prediction of the search", 22, {f"{KLT}.KltMatcher._follow": from_last_place}),
    Idea(
        "second search at the old positions",
        16,
        {f"{KLT}.KltMatcher._follow": searched_once},
        stays="without it, the end of disturbed drives is 83 m farther from the truth",
    ),
    Idea(
        "equal exposure for the second search",
        14,
        {f"{KLT}.lit_like": lambda image, target: image},
        stays="without it, the end of a drive with flicker is 14 m farther from the truth",
    ),
    Idea("windows warped in stereo", 10, {f"{ALIGN}.stereo_warp": square_in_stereo}),
    Idea("windows warped between frames", 40, {f"{ALIGN}.motion_warp": square_over_time}),
    Idea(
        "features on a smooth surface",
        14,
        {"matching.surface_share": 0.0, "matching.surface_tolerance": 10.0},
    ),
    Idea(
        "sub-pixel fit between frames",
        45,
        {f"{KLT}.refine_over_time": coarse_over_time, "matching.loop_tolerance": 10.0},
    ),
    Idea("sub-pixel fit in stereo", 35, {f"{KLT}.refine_stereo": coarse_in_stereo}),
    Idea("windows of equal brightness", 24, {f"{ALIGN}.brightness_change": lambda *_: (1.0, 0.0)}),
    Idea("fewer five-point sets", 12, {f"{ODO}.CLEAN_SETS": 1e9}, stays="it saves 2 ms per frame"),
    Idea("prior", 6, {"selection.prior": False}, stays="it is part of the paper's method"),
    Idea(
        "dropping of the prior",
        35,
        {"selection.prior_rejection_ratio": 1000.0},
        stays="it is part of chapter 3",
    ),
    Idea("refinement of the winner", 100, {"selection.mode": "literal"}),
    Idea("translation (turned off: the paper's)", 190, {f"{ODO}.robust_translation": papers_translation}),
    Idea(
        "robust start of the translation",
        26,
        {"vo_lib.kit.weighted_translation.robust_start": least_squares},
        stays="without it, steps of 01 are 12 % too short with coarse matches",
    ),
    Idea("robust steps after the first step", 8, {"translation.iterations": 1}),
    Idea("calibration", 460, {"calibration.estimate": False}),
    Idea("field", 70, without("disparity", "row")),
    Idea("field: all terms except the constant", 60, without("disparity x", "disparity y", "row x", "row y")),
    Idea(
        "field: remaining errors of the undistortion",
        5,
        without_faults("columns", "rows"),
        stays="drives that were not used to choose the settings need it",
    ),
    Idea("focal length", 2, without_faults("focal length")),
    Idea("lens", 30, without("p1", "p2", "k1", "k2")),
    Idea("calibration from row differences", 24, {f"{RIG}.Rig.update_from_rows": lambda self, matches: None}),
    Idea("drift of the calibration", 8, {"calibration.drift": 0.0}),
    Idea("inflated noise", 6, {"calibration.noise_inflation": 1.0}),
    Idea("shrinking", 20, {f"{RIG}.Rig.set_estimate": as_estimated}),
    Idea(
        "vehicle check",
        45,
        {"vehicle.check": False},
        stays="without it, a frame with a wrong zoom disturbs the calibration and causes an error of 3.9 m",
    ),
    Idea("boxes: rule `all` (turned off: `none`)", 80, {"filter.rule": "none"}),
    Idea("boxes: rule `moving` (turned off: `all`)", 290, {"filter.rule": "all"}, MOVING),
    Idea("boxes: removal of disagreeing features", 8, {"filter.moving.agreement": 1000.0}, MOVING),
    Idea(
        "boxes: mean of the moving features",
        12,
        {"vo_lib.kit.moving.MIN_MOVED_SHARE": 2.0},
        MOVING,
        stays="without it, the rule misses a car that crosses in front of a background",
    ),
)


def tables(rows: Sequence[Sequence[str]]) -> list[ReportTable]:
    """Tables of the changes of TE, RE and length when an idea is turned off, from rows of the CSV file."""
    records = [dict(zip(COLUMNS, row, strict=True)) for row in rows]
    baselines = {(r["method"], r["sequence"]): r for r in records if not r["idea"]}
    sequences = sorted(
        dict.fromkeys(r["sequence"] for r in records), key=lambda name: name.startswith(SYNTHETIC)
    )
    stays = {idea.name: idea.stays for idea in IDEAS}
    names = sorted(
        dict.fromkeys(r["idea"] for r in records if r["lines"]), key=lambda name: name not in stays
    )
    lines: dict[str, list[list[str]]] = {title: [] for title in CHANGES}
    for name in names:
        cells = {r["sequence"]: r for r in records if r["idea"] == name}
        for title, kind in CHANGES.items():
            row = [name]
            if kind == "te":
                ms = np.mean([float(r["ms"]) for r in cells.values()])
                row += [next(iter(cells.values()))["lines"], f"{ms:+.1f}"]
            for sequence in sequences:
                r = cells.get(sequence)
                row.append("–" if r is None else _cell(r, kind, baselines[r["method"], sequence]))
            lines[title].append(row)
    head = (
        "In each row, one idea is turned off in the complete kit; a positive change is an increase. The "
        "cells are means ± standard deviations over five seeds. The errors are over sub-sequences of 20, 50 "
        "and 100 m that start at every frame. Drawn scenes have 100 frames; TE of drive_0013 is computed "
        "with the pitch and yaw that minimise TE. The method is `moving_selection` for ideas of the rule "
        "`moving`, and `feature_selection` for all other ideas. The column `lines` has the approximate lines "
        "of code, and `ms` the mean change of the processor time per frame. A dash is a change that was not "
        "measured."
    )
    reasons = "; ".join(f"{name} ({stays[name]})" for name in names if stays.get(name))
    notes = [
        f"Ideas that hardly change the errors but stay in the kit, each with the reason: {reasons}.",
        f"Ideas that were removed from the kit after a measurement with two seeds: "
        f"{', '.join(name for name in names if name not in stays)}.",
    ]
    short = [name.rpartition("/")[2] for name in sequences]
    return [
        ReportTable(
            f"{title} without an idea of the kit",
            ["without", *(["lines", "ms"] if kind == "te" else []), *short],
            lines[title],
            notes if kind == "te" else [],
            [head] if kind == "te" else [],
        )
        for title, kind in CHANGES.items()
    ]


def _cell(row: dict[str, str], kind: str, baselines: dict[str, str]) -> str:
    """Text of a change ± standard deviation, in % of the error with all ideas (length: percentage points)."""
    scale, digits = (1.0, 2) if kind == "length" else (100.0 / float(baselines[kind]), 1)
    change, spread = (f"{scale * float(row[key]):.{digits}f}" for key in (kind, f"{kind}_sd"))
    signed = change if change.startswith("-") else f"+{change}"
    return signed + (f" ± {spread}" if float(spread) else "")
