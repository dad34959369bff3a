"""Chapter 7: what a threshold is worth over forty frames, on matches that are found once and kept."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np

from vo_lib.config import METHODS, VARIANTS, Config, PublishedConfig, change, preset
from vo_lib.core import settings
from vo_lib.core.errors import DataError
from vo_lib.core.settings import Checked, setting
from vo_lib.core.types import Array, Progress
from vo_lib.data.sequence import Sequence
from vo_lib.evaluation.ate_rpe import relative_error
from vo_lib.evaluation.kitti import SHORT_MEASURE, kitti_errors
from vo_lib.runs.match_cache import CachedMatches
from vo_lib.runs.runner import TimedMatches, run_methods
from vo_lib.tables.table1 import VARIANT_WORDS

from ..controls import Control
from ..drawing import figure, stack
from ..facts import Fact
from ..frames import Memory, opened
from ..panel import Drawing, Panel, State
from .figures import methods_chart, steps_figure

FRAMES, SEEDS = 40, 3
PATIENCE = 0.6  # seconds that a run may take without a bar
STEPS_HEIGHT, DOTS_HEIGHT = 240, 220

_matches: Memory[list[TimedMatches]] = Memory(4)
_runs: Memory[Array] = Memory(400)


@dataclass(frozen=True)
class ExploreView(Checked):
    """Which method the sliders change."""

    method: str = setting("feature_selection", "the method that follows the sliders", choices=tuple(METHODS))
    variant: str = setting(
        "kit",
        "the paper as published, or the kit's way; what is the kit's own it refuses",
        choices=tuple(VARIANTS),
    )


class ExplorePanel(Panel):
    """A method with changed settings beside its preset, on the first frames of a sequence."""

    title = f"One threshold at a time, on the first {FRAMES} frames"
    view = ExploreView
    start = preset("feature_selection")
    height = STEPS_HEIGHT + DOTS_HEIGHT
    long_job = f"All methods, {SEEDS} seeds"
    controls = (
        Control("view.method", "method"),
        Control("view.variant", "variant"),
        Control("selection.sets", "five-point sets", high=400),
        Control("selection.threshold", "inlier threshold", high=5, step=0.05),
        Control("selection.refine_scale", "refinement width", high=10, step=0.1),
        Control("selection.mode", "mode"),
        Control("buckets.features", "features a bucket", high=20),
        Control("filter.margin", "margin of boxes", step=0.05),
        Control("translation.max_depth", "farthest feature", high=200, step=5),
    )

    def draw(self, state: State) -> Drawing:
        changed = changes(self.start, state.config, tuple(self.knobs))
        method, sequence = state.view.method, state.sequence
        base = preset(method, variant=state.view.variant)
        truth = _truth(sequence)
        estimates = {
            "preset": poses_of(sequence, base),
            "with these settings": poses_of(sequence, with_changes(base, changed)),
        }
        rpe = {name: relative_error(truth, poses) for name, poses in estimates.items()}
        words = ", ".join(f"{name} = {_short(value)}" for name, value in changed.items()) or "nothing changed"
        steps = steps_figure(rpe, state.frame, method, STEPS_HEIGHT)
        dots, axes = figure(DOTS_HEIGHT, 2)
        for axis, rotation in zip(axes, (False, True), strict=True):
            methods_chart(axis, _known_errors(sequence, state.view.variant, changed, rotation), rotation)
        te, re = errors_of(truth, estimates["with these settings"])
        te_preset, re_preset = errors_of(truth, estimates["preset"])
        here, at = rpe["with these settings"], min(state.frame, len(sequence) - 1) - 1
        facts = (
            Fact("TE", te, "%", 4),
            Fact("TE of the preset", te_preset, "%", 4),
            Fact("RE", re, "deg/100 m", 4),
            Fact("RE of the preset", re_preset, "deg/100 m", 4),
            Fact("five-point sets", state.config.selection.sets),
            Fact("rotation error here", float(np.degrees(here.rotation[at])), "deg", 4),
            Fact("translation error here", 1e3 * float(here.translation[at]), "mm", 1),
        )
        sentence = (
            f"{method}, {VARIANT_WORDS[state.view.variant]}, seed 0, {len(sequence)} frames; "
            f"TE and RE over {SHORT_MEASURE.words}, as far as it "
            f"goes. Changed: {words}. Below: grey is the preset; methods not drawn have not been run."
        )
        return Drawing(stack([steps, dots], self.height), sentence, facts)

    def work(self, state: State, progress: Progress) -> Drawing:
        changed = changes(self.start, state.config, tuple(self.knobs))
        wanted = [
            config
            for base in VARIANTS[state.view.variant].values()
            for seed in range(SEEDS)
            for config in (_seeded(base, seed, {}), _seeded(base, seed, changed))
        ]
        run_all(state.sequence, wanted, progress)
        return self.draw(state)

    def set(self, **values: Any) -> None:
        """As for every panel; what has to be run for it is run before this returns."""
        super().set(**values)
        self.wait()

    def redraw(self, _: Any = None) -> None:
        """Draw what has been run; what has not is run first, in a job that the next change supersedes."""
        if self._quiet or self._sequence is None:
            return
        try:
            state = self.state()
            base = preset(state.view.method, variant=state.view.variant)
            changed = with_changes(base, changes(self.start, state.config, tuple(self.knobs)))
        except DataError as error:
            self._fail(error)
            return
        wanted = [each for each in (base, changed) if known_poses(state.sequence, each) is None]
        if not wanted:
            super().redraw()
            return

        def run(report: Progress) -> None:
            self._message.value = ""  # of the run before, which this one ended
            run_all(state.sequence, wanted, report)

        # Drawn is what the controls say by then.
        self.job.start(f"running {state.view.method}", run, self.redraw, self._fail, after=PATIENCE)

    def _open(self, name: str) -> None:
        """The first frames of a sequence with their matches: seconds the first time, so always a job."""

        def prepare(report: Progress) -> Sequence:
            whole = opened(name, report)
            sequence = whole.part(0, min(FRAMES, len(whole)))
            _truth(sequence)
            matches_of(sequence, self.start, report)
            return sequence

        self.job.start(f"matching {FRAMES} frames of {name}", prepare, self._use, self._fail)


def changes(start: Config, config: Config, names: tuple[str, ...]) -> dict[str, object]:
    """Settings that differ from those a panel began with, by dotted name."""
    found = {}
    for item in settings.declared(Config):
        if item.name in names:
            value = _value(config, item.name)
            if value != _value(start, item.name):
                found[item.name] = value
    return found


def with_changes(config: PublishedConfig, changed: dict[str, object]) -> PublishedConfig:
    """A configuration with some settings replaced; `DataError` where it has no such setting."""
    for name, value in changed.items():
        config = change(config, name, value)
    return config


def matches_of(
    sequence: Sequence, config: PublishedConfig, progress: Progress | None = None
) -> list[TimedMatches]:
    """Matches of all frames, from the match cache on disk, kept here as well."""

    def find() -> list[TimedMatches]:
        found = []
        for frame in CachedMatches(sequence, config.features, config.matching):
            found.append(frame)
            if progress is not None:
                progress(len(found), len(sequence))
        return found

    key = sequence.folder, sequence.frames[0], len(sequence), config.features, config.matching
    return _matches.get(key, find)


def poses_of(sequence: Sequence, config: PublishedConfig, progress: Progress | None = None) -> Array:
    """Poses (N, 4, 4) of a configuration on the kept matches: the back end alone."""

    def run() -> Array:
        matches = matches_of(sequence, config)
        return run_methods(sequence, {"": config}, progress, matches)[""].poses

    return _runs.get(_key(sequence, config), run)


def run_all(sequence: Sequence, configs: list[PublishedConfig], progress: Progress) -> None:
    """`poses_of` several configurations, to be had from `known_poses`; one progress for all."""
    total = len(configs) * len(sequence)
    for number, config in enumerate(configs):
        before = number * len(sequence)
        progress(before, total)
        poses_of(sequence, config, lambda done, _, b=before: progress(b + done, total))  # type: ignore[misc]


def known_poses(sequence: Sequence, config: PublishedConfig) -> Array | None:
    """Poses that `poses_of` has found before, or None."""
    key = _key(sequence, config)
    return _runs.get(key, lambda: np.zeros(0)) if key in _runs else None


def errors_of(truth: Array, poses: Array) -> tuple[float, float]:
    """TE in % and RE in deg/100 m over short sub-sequences; NaN where the path holds none."""
    errors = kitti_errors(truth, poses, SHORT_MEASURE.lengths, SHORT_MEASURE.step)
    nothing = float("nan")
    return (nothing if errors.te is None else errors.te), (nothing if errors.re is None else errors.re)


def _known_errors(
    sequence: Sequence, variant: str, changed: dict[str, object], rotation: bool
) -> dict[str, tuple[Array, Array]]:
    """TE or RE of the seeds that have been run, by method: of the preset, and with changed settings."""

    def of(base: PublishedConfig, changed: dict[str, object]) -> Array:
        configs = [_seeded(base, seed, changed) for seed in range(SEEDS)]
        runs = [poses for config in configs if (poses := known_poses(sequence, config)) is not None]
        return np.array([errors_of(_truth(sequence), poses)[int(rotation)] for poses in runs])

    return {method: (of(base, {}), of(base, changed)) for method, base in VARIANTS[variant].items()}


def _key(sequence: Sequence, config: PublishedConfig) -> tuple[object, ...]:
    return sequence.folder, sequence.frames[0], len(sequence), sequence.labels, config


def _seeded(base: PublishedConfig, seed: int, changed: dict[str, object]) -> PublishedConfig:
    return dataclasses.replace(with_changes(base, changed), seed=seed)


def _truth(sequence: Sequence) -> Array:
    if sequence.truth is None:
        raise DataError(f"{sequence.name} has no ground truth to compare with")
    return sequence.truth


def _short(value: object) -> str:
    """A setting as a person writes it: a slider's 0.05 may be 0.04999999999999999."""
    return f"{value:g}" if isinstance(value, float) else str(value)


def _value(config: Config, name: str) -> object:
    value: object = config
    for part in name.split("."):
        value = getattr(value, part)
    return value
