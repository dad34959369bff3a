"""Appendix: a panel with a rig of given faults, and the estimate of variant `kit`."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from dataclasses import astuple, dataclass
from functools import partial

import numpy as np

from vo_lib.data.sequence import Sequence
from vo_lib.geometry.camera import StereoCamera
from vo_lib.geometry.types import Array
from vo_lib.kit.calibration import describe_errors
from vo_lib.kit.rig import field_at
from vo_lib.settings import Checked, setting

from ..ch04.figures import lengths_figure
from ..frames import stereo
from ..memory import Memory
from ..panel import Control, Drawing, Fact, Panel, State
from ..perturbed_path import block_tour
from ..simulation.tracks import SimulatedFrame, TrackConfig, simulate_tracks
from .figures import MAP_HEIGHT, field_maps, image_grid
from .rig_estimate import KITTI_01, TERMS, Learnt, errors_of_rig, learn, learn_by_frame, too_long

FRAMES = 40  # of the estimation
CHART_HEIGHT = 200

_tracks: Memory[list[SimulatedFrame]] = Memory(8)
_learnt: Memory[Learnt] = Memory(200)


@dataclass(frozen=True)
class CalibrationView(Checked):
    """Sizes of the faults in the order of `KITTI_01`, and the estimated terms."""

    shift: float = setting(
        -0.6, "shift along the rows: changes all disparities equally", unit="px", low=-2, high=2
    )
    roll: float = setting(-0.3, "changes disparities by y and rows by -x", unit="px", low=-2, high=2)
    tilt: float = setting(
        0.5,
        "tilt about the vertical (with the shift: a yaw): changes disparities by x² and rows by xy",
        unit="px",
        low=-8,
        high=8,
    )
    decentering: float = setting(6.3, "changes disparities by y² and rows by -xy", unit="px", low=-8, high=8)
    y2: float = setting(0.0, "changes disparities by y²", unit="px", low=-4, high=4)
    x4: float = setting(-3.5, "changes disparities by x⁴", unit="px", low=-6, high=6)
    terms: str = setting("all", "estimated terms of the disparity errors", choices=tuple(TERMS))


class CalibrationPanel(Panel):
    """The error field of a rig over the image, the estimated field, and the lengths of the steps."""

    title = "Faults of a rig, and their estimate from 40 simulated frames"
    view = CalibrationView
    height = 2 * MAP_HEIGHT + CHART_HEIGHT
    controls = (
        *(Control(f"view.{name}", step=0.1) for name in ("shift", "roll", "tilt", "decentering")),
        Control("view.y2", "y² alone", step=0.1),
        Control("view.x4", "x⁴ alone", step=0.1),
        Control("view.terms", "terms learnt"),
    )

    def steps(self, state: State) -> Iterator[Callable[[], Drawing]]:
        key = _key(state)
        if key in _learnt:
            return
        learnt = learn_by_frame(*_rig_of(state))
        for done, learnt_so_far in enumerate(learnt, start=1):
            yield partial(self._drawing, state, learnt_so_far, done)
        _learnt.get(key, learnt_so_far)

    def draw(self, state: State) -> Drawing:
        return self._drawing(state, lambda: _learnt.get(_key(state), lambda: learn(*_rig_of(state))))

    def _drawing(self, state: State, learnt_so_far: Callable[[], Learnt], done: int | None = None) -> Drawing:
        """The picture of what was learnt in the first `done` frames; None: in all frames."""
        camera, tracks, true, _ = _rig_of(state)
        learnt, ratios = learnt_so_far()
        image = stereo(state.sequence, state.frame)[0]
        maps = field_maps(image, camera, {"the rig's": true, "learnt": learnt.errors})
        remaining = np.abs(field_at(true - learnt.errors, *image_grid(camera).T)).max(axis=1)
        facts = [
            Fact(f"error of length, {name}", too_long(values), "%", 2) for name, values in ratios.items()
        ]
        facts.append(Fact("disparities still wrong by up to", float(remaining[0]), "px", 2))
        facts.append(Fact("rows still wrong by up to", float(remaining[1]), "px", 2))
        words = describe_errors(learnt.errors, learnt.covariance, camera)
        frames = f"{len(tracks)} frames" if done is None else f"the first {done} of {len(tracks)} frames"
        sentence = f"Learnt in {frames}, away from the edges of the image: {words}."
        chart = lengths_figure(ratios, CHART_HEIGHT)
        chart.axes[0].set_xlim(0, len(tracks) + 1)  # also if only the first ratios are known
        return Drawing([maps, chart], sentence, tuple(facts))


def _key(state: State) -> tuple[Hashable, ...]:
    """All that the estimate depends on."""
    sequence = state.sequence
    return sequence.camera, _path_of(sequence, state.frame).tobytes(), state.view


def _rig_of(state: State) -> tuple[StereoCamera, list[SimulatedFrame], Array, tuple[str, ...]]:
    """The arguments of `learn` for a state of the panel."""
    *sizes, terms = astuple(state.view)
    true = errors_of_rig(dict(zip(KITTI_01, sizes, strict=True)))
    return state.sequence.camera, tracks_of(state.sequence, state.frame), true, TERMS[terms]


def tracks_of(sequence: Sequence, frame: int) -> list[SimulatedFrame]:
    """Simulated matches along the path of a frame."""
    path = _path_of(sequence, frame)

    def make() -> list[SimulatedFrame]:
        return list(simulate_tracks(path, sequence.camera, TrackConfig(points=150), seed=0))

    return _tracks.get((sequence.camera, path.tobytes()), make)


def _path_of(sequence: Sequence, frame: int) -> Array:
    """True poses (`FRAMES` + 1, 4, 4) from the frame before on; without truth, of `block_tour`.

    Near the end of the sequence, its last poses; of a short one, all that it has.
    """
    poses = block_tour(1) if sequence.truth is None else sequence.truth
    first = max(min(frame, len(poses) - FRAMES) - 1, 0)
    return poses[first : first + FRAMES + 1]
