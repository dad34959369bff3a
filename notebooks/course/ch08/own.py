"""Chapter 8: the student's functions of all chapters, and in the place of a missing one the library's."""

from __future__ import annotations

import html
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from vo_lib import preset
from vo_lib.data.sequence import Sequence
from vo_lib.geometry.motion import inverse
from vo_lib.geometry.types import Array, Image
from vo_lib.report.film import Film, shown_frames
from vo_lib.runs.drive import run_methods
from vo_lib.runs.matches import CachedMatches

from ..keep import NAME, load
from ..marks import asked

# The functions in the order of the loop.
STAGES = (
    "keep_outside",
    "buckets",
    "solve_five",
    "truncated_error",
    "select",
    "rows_of_one",
    "translation_of_all",
    "weights",
    "chain",
    "all_errors",
)


@dataclass(frozen=True)
class Joined:
    """The stages as attributes: `mine.select(…)`. `whose` tells by name whether one is yours, or why not."""

    functions: Mapping[str, Any]
    whose: Mapping[str, str]

    def __getattr__(self, name: str) -> Any:
        if name not in STAGES:
            raise AttributeError(f"no stage is called {name}; there are {', '.join(STAGES)}")
        return self.functions[name]

    @property
    def facts(self) -> dict[str, float]:
        """How many stages are borrowed, for the check."""
        return {"borrowed": float(sum(words != "yours" for words in self.whose.values()))}

    @property
    def name(self) -> str:
        """What an odometry of these stages may be called: yours only where all of them are."""
        own = len(STAGES) - int(self.facts["borrowed"])
        return "yours" if own == len(STAGES) else f"{own} of {len(STAGES)} stages yours"

    def _repr_html_(self) -> str:
        numbers = {name: number for name, (number, _) in asked().items()}
        rows = "".join(
            f"<tr><td>{numbers[name]}</td><td><code>{name}</code></td><td>{html.escape(words)}</td></tr>"
            for name, words in self.whose.items()
        )
        return f"<table><tr><th>exercise</th><th>stage</th><th>whose</th></tr>{rows}</table>"


def join(**given: Any) -> Joined:
    """Every stage: a function given here or that of `my_vo.py`, where that passes; or the library's."""
    written, exercises = {**load(Path(NAME)), **given}, asked()
    functions, whose = {}, {}
    for name in STAGES:
        own, (_, exercise) = written.get(name), exercises[name]
        verdict = exercise.judge(own) if callable(own) else None
        passed = verdict is not None and verdict.passed
        functions[name] = own if passed else exercise.right
        why = f"yours fails its check: {verdict.message}" if verdict is not None else f"not in {NAME} yet"
        whose[name] = "yours" if passed else f"the library's: {why}"
    return Joined(functions, whose)


def residuals(M: Array, c: Array, t: Array) -> Array:
    """What rows M (N, 8, 6) and c (N, 8) of N features leave under t (3,), each with its best Q, (N,)."""
    A, d = M[..., :3], c - M[..., 3:] @ t
    left = d[..., None] - A @ (np.linalg.pinv(A) @ d[..., None])
    return np.asarray(np.linalg.norm(left[..., 0], axis=1))


def film(path: Path, sequence: Sequence, poses: Array) -> Image:
    """Write a film of poses (N, 4, 4) over the kit's matches and what boxes leave of them; its last picture, BGR."""
    config = preset("feature_selection", variant="kit")
    matches = list(CachedMatches(sequence, config))
    run = replace(run_methods(sequence, {"": config}, matches=matches)[""], poses=poses)
    with Film(path, run, "your path, the kit's matches") as made:
        for shown in shown_frames(run, matches):
            T_cp = inverse(poses[shown.index]) @ poses[shown.index - 1]
            made.add(replace(shown, motion=replace(shown.motion, T_cp=T_cp)))
    return made.picture(shown)
