"""Appendix: a rig with given faults, their effect on the length of a step, and the estimate of variant `kit`."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping
from dataclasses import astuple, dataclass
from functools import partial
from typing import NamedTuple

import cv2
import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure

from course.simulation.tracks import SimulatedFrame, TrackConfig, simulate_tracks
from vo_lib.data.sequence import Sequence
from vo_lib.errors import DataError
from vo_lib.geometry.camera import StereoCamera
from vo_lib.geometry.matches import StereoMatches
from vo_lib.geometry.motion import rigid
from vo_lib.geometry.types import Array, Image
from vo_lib.kit.calibration import describe_errors
from vo_lib.kit.rig import (
    DISPARITY_TERMS,
    ERROR_COUNT,
    ERROR_NAMES,
    LENS_PX,
    RIG_FAULTS,
    Rig,
    field_at,
    lens_shapes,
)
from vo_lib.kit.settings import CalibrationConfig, KitTranslationConfig
from vo_lib.kit.weighted_translation import robust_translation
from vo_lib.paper.settings import TranslationConfig
from vo_lib.paper.translation import PairBefore, solve_translation
from vo_lib.settings import Checked, setting

from ..ch04.figures import lengths_figure
from ..colours import GOOD, PALE
from ..drawing import DPI, WIDTH, caption, photo, room
from ..frames import key_of, stereo
from ..memory import Memory
from ..panel import Control, Drawing, Fact, Panel, State
from ..perturbed_path import block_tour

# Approximate faults of the rig in sequence 01 of KITTI: sizes of `RIG_FAULTS`, pixels.
KITTI_01 = {
    "shift along the rows": -0.6,
    "roll": -0.3,
    "tilt about the vertical": 0.5,
    "decentering along the rows": 6.3,
    "columns, y²": 0.0,
    "columns, x⁴": -3.5,
}
TERMS = {"all": DISPARITY_TERMS, "1 and x²": ("1", "x²"), "1 alone": ("1",)}
FRAMES = 40  # of the estimation
LAST = 15  # frames at its end whose step lengths are evaluated
REST = 0.05  # metres; shorter steps are not evaluated
MAP_HEIGHT = 150
CHART_HEIGHT = 200
BANDS = 10  # colours from no error to the largest
_tracks: Memory[list[SimulatedFrame]] = Memory(8)


class Learnt(NamedTuple):
    """The estimated rig, and the ratios of step lengths to true step lengths, by name, a frame each (N,).

    The names are "as measured" and "corrected"; a ratio is NaN if the camera rests.
    """

    rig: Rig
    lengths: dict[str, Array]


_learnt: Memory[Learnt] = Memory(200)


def rig(faults: dict[str, float]) -> Array:
    """Errors (ERROR_COUNT,), pixels, of a rig with perfect lenses and `RIG_FAULTS` of the given sizes."""
    errors = np.zeros(ERROR_COUNT)
    for fault, size in faults.items():
        columns, rows, _ = RIG_FAULTS[fault]
        for kind, shape in (("disparity", columns), ("row", rows)):
            for term, factor in shape.items():
                errors[ERROR_NAMES.index(f"{kind} {term}")] += size * factor
    return errors


# The disparity error, pixels, that fits KITTI's drives of three days alike.
_DRIVES = {"x²": 0.8, "xy": 0.8, "y²": 6.3, "x²y": 1.5, "x⁴": -4.0}
_DRIVES_FAULTS = {"shift along the rows": -0.2} | {f"columns, {term}": px for term, px in _DRIVES.items()}
DRIVES_FIELD = rig(_DRIVES_FAULTS)


def learn(
    camera: StereoCamera, tracks: list[SimulatedFrame], true: Array, terms: tuple[str, ...] = DISPARITY_TERMS
) -> Learnt:
    """Add errors `true` (ERROR_COUNT,) to matches; estimate the row terms and the disparity terms in `terms`."""
    *_, last = learn_by_frame(camera, tracks, true, terms)
    return last()


def learn_by_frame(
    camera: StereoCamera, tracks: list[SimulatedFrame], true: Array, terms: tuple[str, ...] = DISPARITY_TERMS
) -> Iterator[Callable[[], Learnt]]:
    """As `learn`; yields after each frame a function that returns the result so far.

    The result is valid until the next frame; the ratios of later frames are NaN.
    """
    learnt = Rig(camera, CalibrationConfig(drift=0.0))
    if terms != DISPARITY_TERMS:
        # The other terms are set to zero; the rows, which are learnt separately, do not affect them.
        other_terms = [terms[0]] * (ERROR_COUNT - len(DISPARITY_TERMS))
        free = np.isin([*DISPARITY_TERMS, *other_terms], terms)
        deviations = np.diag(learnt.covariance) * np.where(free, 1.0, 1e-8)
        learnt.set_estimate(learnt.estimate, np.diag(deviations))
    ratios = np.full((2, len(tracks)), np.nan)

    def so_far() -> Learnt:
        return Learnt(learnt, dict(zip(("as measured", "corrected"), ratios.copy(), strict=True)))

    for number, frame in enumerate(tracks):
        R_cp = frame.T_cp[:3, :3]
        true_length = float(np.linalg.norm(frame.T_cp[:3, 3]))
        spoiled = learnt.correct(frame.matches, -true)
        learnt.update_from_rows(spoiled)
        better = learnt.correct(spoiled)
        t_spoiled = _translation(camera, spoiled, R_cp, default=frame.T_cp[:3, 3])
        t_better = _translation(camera, better, R_cp, default=t_spoiled)
        learnt.update(better, R_cp, t_better)
        if true_length > REST:
            ratios[0, number] = float(np.linalg.norm(t_spoiled)) / true_length
            ratios[1, number] = float(np.linalg.norm(t_better)) / true_length
        yield so_far


def _translation(camera: StereoCamera, matches: StereoMatches, R_cp: Array, default: Array) -> Array:
    """Robust translation (3,), metres, or the default without a solution."""
    solved = robust_translation(camera, matches, R_cp, KitTranslationConfig())
    return default if solved is None else solved[0]


def third_frame(
    camera: StereoCamera, tracks: list[SimulatedFrame], true: Array, config: TranslationConfig
) -> dict[str, Array]:
    """Ratios (N,) of estimated to true step lengths of variant `published`, with two and with three frames.

    `true` : errors (ERROR_COUNT,) of the rig. The rotations of the steps are true.
    """
    shares: dict[str, list[float]] = {"two frames": [], "three frames": []}
    before: dict[str, PairBefore | None] = dict.fromkeys(shares)
    learnt = Rig(camera, CalibrationConfig())
    for frame in tracks:
        matches = learnt.correct(frame.matches, -true)
        R_cp = frame.T_cp[:3, :3]
        for name in shares:
            solved = solve_translation(camera, matches, R_cp, config, before[name])
            if solved is None:
                raise DataError(
                    "a frame of these tracks gives no translation: use more points, or smaller errors"
                )
            shares[name].append(float(np.linalg.norm(solved[0]) / np.linalg.norm(frame.T_cp[:3, 3])))
            if name == "three frames":
                before[name] = PairBefore(matches, rigid(R_cp, solved[0]))
    return {name: np.array(values) for name, values in shares.items()}


def too_long(shares: Array) -> float:
    """Mean excess length of the last `LAST` steps, %; NaN for a camera at rest."""
    judged = shares[np.isfinite(shares)][-LAST:]
    return 100.0 * float(np.mean(judged) - 1.0) if len(judged) else np.nan


def image_grid(camera: StereoCamera, columns: int = 13, rows: int = 5) -> Array:
    """Normalised positions (rows · columns, 2) of a grid over the left image."""
    u, v = np.meshgrid(np.linspace(0, camera.width, columns), np.linspace(0, camera.height, rows))
    return camera.normalise(np.stack([u, v], axis=-1).reshape(-1, 2))


def field_maps(image: Image, camera: StereoCamera, fields: dict[str, Array]) -> Image:
    """Maps of errors (ERROR_COUNT,) by name: disparities on top, rows below; red: above 0, blue: below 0."""
    grid = image_grid(camera, 41, 13).T
    errors = {name: field_at(c, *grid).reshape(2, 13, 41) for name, c in fields.items()}
    limit = room(max(float(np.abs(error).max()) for error in errors.values()), least=0.1)
    light = 0.55 + 0.45 * photo(image, WIDTH // len(errors)) / 255.0

    def one(words: str, error: Array) -> Image:
        share = np.round(BANDS * cv2.resize(error / limit, light.shape[1::-1])) / BANDS
        map_ = np.asarray(255 * light * colormaps["RdBu_r"](0.5 + 0.5 * share)[:, :, 2::-1], np.uint8)
        words = f"{words}: {error.min():.2f} to {error.max():.2f} px"
        return caption(photo(map_, light.shape[1], MAP_HEIGHT), words)

    disparities = [one(f"disparities, {name}", error[0]) for name, error in errors.items()]
    rows = [one(f"rows, {name}", error[1]) for name, error in errors.items()]
    return np.vstack([np.hstack(disparities), np.hstack(rows)])


def arrows_figure(camera: StereoCamera, moved: dict[str, tuple[Array, ...]]) -> Figure:
    """A chart per title: displacements (2, N) of the `image_grid` as arrows, the last array in blue."""
    points = image_grid(camera)
    width = min(len(moved), 4)
    lines = -(-len(moved) // 4)  # rounded up
    made = Figure(figsize=(WIDTH / DPI, lines * 130 / DPI), dpi=DPI, layout="constrained")
    for axis, (title, parts) in zip(made.subplots(lines, width).flat, moved.items(), strict=True):
        axis.plot(*points.T, ".", color=PALE, markersize=1.5)
        for arrows, colour in zip(parts, (PALE, GOOD)[-len(parts) :], strict=True):
            scale = {"scale_units": "xy", "scale": 6.0 * np.abs(parts[0]).max()}
            axis.quiver(*points.T, *arrows, color=colour, angles="xy", width=0.006, **scale)
        axis.set(xlim=(-1.1, 1.1), ylim=(0.46, -0.46), xticks=[], yticks=[], aspect="equal")
        axis.set_title(title, fontsize=8, loc="left")
    return made


def faults_figure(camera: StereoCamera) -> Figure:
    """Displacements of the points in the right image, one chart per fault."""
    moved: dict[str, tuple[Array, ...]] = {}
    for name, (columns, rows, _) in RIG_FAULTS.items():
        if not name.startswith(("columns", "rows")):  # those are single terms
            title = f"{name}\ndisparity: {_terms(columns)}; row: {_terms(rows)}"
            moved[title] = (-field_at(rig({name: 1.0}), *image_grid(camera).T),)
    return arrows_figure(camera, moved)


def _terms(shape: Mapping[str, float]) -> str:
    """The terms of a shape with their signs, or "none"."""
    signed = [f"−{term}" if factor < 0 else term for term, factor in shape.items()]
    return " ".join(signed) or "none"


def lens_figure(camera: StereoCamera) -> Figure:
    """Displacements by Brown's p1, p2, k1, k2; blue: component across epipolar lines of a straight drive."""
    points = image_grid(camera).T
    across = points[::-1] * [[1], [-1]] / np.maximum(np.linalg.norm(points, axis=0), 1e-6)
    moved: dict[str, tuple[Array, ...]] = {}
    for name, shape in zip(LENS_PX, lens_shapes(points), strict=True):
        part = across * np.sum(across * shape, axis=0)
        share = np.linalg.norm(part, axis=0).max() / np.linalg.norm(shape, axis=0).max()
        moved[f"{name}: {share:.0%} of the largest arrow across"] = shape, part
    return arrows_figure(camera, moved)


@dataclass(frozen=True)
class CalibrationView(Checked):
    """Sizes of the faults in the order of `KITTI_01`, and the estimated terms."""

    shift: float = setting(-0.6, "yaw: changes all disparities equally", unit="px", low=-2, high=2)
    roll: float = setting(-0.3, "changes disparities by y and rows by -x", unit="px", low=-2, high=2)
    tilt: float = setting(0.5, "changes disparities by x² and rows by xy", unit="px", low=-8, high=8)
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
        learnt, lengths = learnt_so_far()
        image = stereo(state.sequence, state.frame)[0]
        maps = field_maps(image, camera, {"the rig's": true, "learnt": learnt.errors})
        remaining = np.abs(field_at(true - learnt.errors, *image_grid(camera).T)).max(axis=1)
        facts = [Fact(f"error of length, {name}", too_long(share), "%", 2) for name, share in lengths.items()]
        facts.append(Fact("disparities still wrong by up to", float(remaining[0]), "px", 2))
        facts.append(Fact("rows still wrong by up to", float(remaining[1]), "px", 2))
        words = describe_errors(learnt.errors, learnt.covariance, camera)
        frames = f"{len(tracks)} frames" if done is None else f"the first {done} of {len(tracks)} frames"
        sentence = f"Learnt in {frames}, away from the edges of the image: {words}."
        chart = lengths_figure(lengths, CHART_HEIGHT)
        chart.axes[0].set_xlim(0, len(tracks) + 1)  # also if only the first ratios are known
        return Drawing([maps, chart], sentence, tuple(facts))


def _key(state: State) -> tuple[Hashable, ...]:
    """All that the estimate depends on."""
    return (*key_of(state.sequence, state.frame), state.view)


def _rig_of(state: State) -> tuple[StereoCamera, list[SimulatedFrame], Array, tuple[str, ...]]:
    """The arguments of `learn` for a state of the panel."""
    *sizes, terms = astuple(state.view)
    true = rig(dict(zip(KITTI_01, sizes, strict=True)))
    return state.sequence.camera, tracks_of(state.sequence, state.frame), true, TERMS[terms]


def tracks_of(sequence: Sequence, frame: int) -> list[SimulatedFrame]:
    """Simulated matches along `FRAMES` frames of the true path; without truth, along a straight path."""
    poses = block_tour(1) if sequence.truth is None else sequence.truth
    first = max(min(frame, len(poses) - FRAMES) - 1, 0)

    def make() -> list[SimulatedFrame]:
        part = poses[first : first + FRAMES + 1]
        return list(simulate_tracks(part, sequence.camera, TrackConfig(points=150), seed=0))

    return _tracks.get(key_of(sequence, first), make)
