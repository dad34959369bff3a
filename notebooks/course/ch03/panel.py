"""Chapter 3: which of a thousand solutions wins, with the previous frame's help and without."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from vo_lib.config import preset
from vo_lib.data.sequence import Sequence
from vo_lib.errors import DataError
from vo_lib.geometry.camera import StereoCamera
from vo_lib.geometry.motion import (
    essential_angle,
    essential_vector,
    rigid,
    rotation_angle,
    rotation_from_vector,
    transform,
)
from vo_lib.geometry.types import Array, BoolArray, Image, Progress
from vo_lib.kit.selection import choose, motion_of_winner, sample_sets
from vo_lib.kit.settings import KitConfig, KitSelectionConfig
from vo_lib.paper.five_point import Candidates, five_point
from vo_lib.paper.selection import nearest_to_prior, truncated_errors
from vo_lib.settings import Checked, setting

from ..ch02.figures import draw_flow
from ..ch02.panel import reference_rotation, rotation_errors
from ..colours import BAD, FIFTH, GOOD, bgr
from ..controls import Control
from ..drawing import WIDTH, caption, photo, stack
from ..frames import Memory, Points, frame_points, key_of, stereo
from ..panel import Drawing, Panel, State
from ..results import Fact
from .figures import Field, errors_figure, field_figure

PHOTO_HEIGHT, CHART_HEIGHT = 298, 260
FRAMES = 30  # of the long job
WALL = np.array([0.35, -0.2, 1.0])  # its normal: WALL · X = 12 m
# How the thing moves from frame to frame that the matches are put on: a bus that turns into our street.
STEP, TURN = np.array([0.5, 0.0, 0.3]), rotation_from_vector(np.radians([0.0, 2.0, 0.0]))


@dataclass(frozen=True)
class SelectionView(Checked):
    """What the panel of chapter 3 does to the matches of the frame."""

    moving: float = setting(0.0, "share of the matches put on one thing that moves", low=0, high=0.9)
    wrong: float = setting(0.0, "share of the matches that end at a wrong place", low=0, high=0.9)
    draw: int = setting(0, "draws other sets, and other matches to disturb", low=0, high=999)
    plane: bool = setting(False, "all points on one slanting wall, which fills the view")


_candidates: Memory[Candidates] = Memory(12)
_priors: Memory[Array] = Memory(24)


def disturbed(
    points: Points, T_cp: Array, camera: StereoCamera, view: SelectionView
) -> tuple[Points, BoolArray]:
    """The points with some matches moving together and some wrong, and which ones, (N,).

    The moving ones are those furthest left and turn about their middle; a wrong one ends 4 to 40 px away.
    """
    rng, count = np.random.default_rng([4, view.draw]), len(points.x_p)
    if view.plane:
        rays = np.concatenate([points.x_p, np.ones((count, 1))], axis=1)
        X_p = rays * (12.0 / np.maximum(rays @ WALL, 0.1))[:, None]
        seen = _view(transform(T_cp, X_p)) + rng.normal(0.0, 0.3 / camera.f, (count, 2))
        points = replace(points, X_p=X_p, x_c=seen)
    moving, wrong = round(view.moving * count), round(view.wrong * count)
    order = np.argsort(points.x_p[:, 0])
    order[moving:] = rng.permutation(order[moving:])
    x_c = points.x_c.copy()
    on_object = order[:moving]
    if moving:
        middle = np.median(points.X_p[on_object], axis=0)
        Y = transform(T_cp, (points.X_p[on_object] - middle) @ TURN.T + middle + STEP)
        noise = x_c[on_object] - _view(transform(T_cp, points.X_p[on_object]))
        x_c[on_object] = _view(Y) + np.clip(noise, -1.0 / camera.f, 1.0 / camera.f)
    lying = order[moving : moving + wrong]
    angle, length = rng.uniform(0, 2 * np.pi, len(lying)), rng.uniform(4.0, 40.0, len(lying)) / camera.f
    x_c[lying] += length[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    touched = np.zeros(count, np.bool_)
    touched[order[: moving + wrong]] = True
    return replace(points, x_c=x_c), touched


def _view(X: Array) -> Array:
    """Normalised image points of X (N, 3)."""
    return np.asarray(X[:, :2] / np.maximum(X[:, 2:], 0.5))


def disturbed_frame(
    sequence: Sequence, frame: int, config: KitConfig, view: SelectionView
) -> tuple[Points, BoolArray, Array]:
    """A frame's disturbed points, which were touched, and the rotation (3, 3) that they are judged by.

    Without truth the matches' own rotation and the median change of the points stand for the true motion.
    """
    points = frame_points(sequence, frame, config)
    R_true, T_cp = reference_rotation(sequence, frame, points), points.T_cp
    if T_cp is None:
        X_c = sequence.camera.triangulate(points.matches.cur_left, points.matches.cur_right)
        T_cp = rigid(R_true, np.nanmedian(X_c - points.X_p @ R_true.T, axis=0))
    return *disturbed(points, T_cp, sequence.camera, view), R_true


def previous_vector(sequence: Sequence, frame: int, config: KitConfig) -> Array | None:
    """The essential vector of the frame before, by consensus, refined; None for the first pair."""
    if frame < 2:
        return None

    def estimate() -> Array:
        points, focal = frame_points(sequence, frame - 1, config), sequence.camera.f
        E, usual = _solve(points, 200, 0).E, KitSelectionConfig()
        errors = truncated_errors(E, points.x_p, points.x_c, usual.threshold / focal)
        return judged(E[np.argmin(errors)], points, np.eye(3), usual, focal)[1]

    key = (*key_of(sequence, frame - 1), config.features, config.matching, config.buckets)
    return _priors.get(key, estimate)


def _solve(points: Points, sets: int, draw: int) -> Candidates:
    chosen = sample_sets(np.random.default_rng([5, draw]), len(points.x_p), sets)
    found = five_point(points.x_p[chosen], points.x_c[chosen])
    if len(found.E) == 0:
        raise DataError("no five of the matches determine an essential matrix: the camera may stand still")
    return found


def field_of(
    found: Candidates,
    points: Points,
    e_prev: Array | None,
    R_true: Array,
    config: KitSelectionConfig,
    focal: float,
) -> Field:
    """Angles, errors and winners of a frame's candidates."""
    nothing = np.full(len(found.E), np.nan)
    angle = nothing if e_prev is None else np.degrees(essential_angle(essential_vector(found.E), e_prev))
    kept = np.ones(len(found.E), np.bool_)
    if e_prev is not None and config.prior:
        kept = nearest_to_prior(found.E, found.set_index, e_prev, config.keep)
    errors = truncated_errors(found.E, points.x_p, points.x_c, config.threshold / focal)
    consensus, _ = choose(*found, points.x_p, points.x_c, None, config, focal)
    selected, dropped = choose(*found, points.x_p, points.x_c, e_prev, config, focal)
    return Field(angle, errors, rotation_errors(found.E, R_true), kept, consensus, selected, dropped)


def judged(
    E: Array, points: Points, R_true: Array, config: KitSelectionConfig, focal: float
) -> tuple[float, Array, BoolArray]:
    """Of a winner E (3, 3): its rotation's error, degrees, the essential vector it leaves, its inliers (N,)."""
    R, _, best, inliers = motion_of_winner(E, points.x_p, points.x_c, points.X_p, config, focal)
    return float(np.degrees(rotation_angle(R.T @ R_true))), essential_vector(best), inliers


class SelectionPanel(Panel):
    """All candidates of a frame, the prior's choice among them, and the winners."""

    start = preset("solution_selection", variant="kit")
    title = "A thousand solutions, one winner"
    view = SelectionView
    height = PHOTO_HEIGHT + CHART_HEIGHT
    long_job = f"Compare over {FRAMES} frames"
    controls = (
        Control("selection.sets", "n: sets", low=10, high=1000, step=10),
        Control("selection.keep", "k: kept of a set"),
        Control("selection.threshold", step=0.05, high=5),
        Control("view.moving", "moving share", step=0.05),
        Control("view.wrong", "wrong share", step=0.05),
        Control("selection.mode", "winner"),
        Control("selection.prior", "use the previous essential vector"),
        Control("view.draw", "draw again", button=True),
        Control("view.plane", "one plane"),
    )

    def draw(self, state: State) -> Drawing:
        selection, view, focal = state.kit.selection, state.view, state.sequence.camera.f
        points, touched, R_true = disturbed_frame(state.sequence, state.frame, state.kit, view)
        key = (*key_of(state.sequence, state.frame), selection.sets, view)
        found = _candidates.get(key, lambda: _solve(points, selection.sets, view.draw))
        e_prev = previous_vector(state.sequence, state.frame, state.kit)
        field = field_of(found, points, e_prev, R_true, selection, focal)
        by_consensus, _, _ = judged(found.E[field.consensus], points, R_true, selection, focal)
        error, _, inliers = judged(found.E[field.selected], points, R_true, selection, focal)
        chart = field_figure(field, error, CHART_HEIGHT)
        picture = stack([self._picture(state, points, inliers, touched), chart], self.height)
        same = "the same as" if field.selected == field.consensus else "another than"
        sentence = (
            f"Of {len(found.E)} solutions of {selection.sets} sets {np.count_nonzero(field.kept)} may "
            f"compete. The winner, {same} that of consensus, gives a rotation that is {error:.3f}° wrong "
            f"({selection.mode}; thin line)."
            + (" The prior was dropped: its best solution scored clearly worse." if field.dropped else "")
        )
        facts = (
            Fact("error by selection", error, "°", 3),
            Fact("error by consensus", by_consensus, "°", 3),
            Fact("angle to the previous vector", float(field.angle[field.selected]), "°", 2),
            Fact("solutions kept", int(np.count_nonzero(field.kept))),
            Fact("inliers", int(np.count_nonzero(inliers))),
            Fact("matches", len(points.x_p)),
            Fact("disturbed", int(np.count_nonzero(touched))),
        )
        return Drawing(picture, sentence, facts)

    def work(self, state: State, progress: Progress) -> Drawing:
        """Both ways over the next frames, each with its own previous vector."""
        selection, frames = state.kit.selection, range(state.frame, len(state.sequence))[:FRAMES]
        prior, focal = replace(selection, prior=True), state.sequence.camera.f
        ways = {
            "consensus": replace(selection, prior=False),
            f"selection, k = {selection.keep}": prior,
            "k = 1, prior never dropped": replace(prior, keep=1, prior_rejection_ratio=1000.0),
        }
        e_prev: dict[str, Array | None] = dict.fromkeys(ways)
        errors = {name: np.zeros(len(frames)) for name in ways}
        for done, frame in enumerate(frames):
            progress(done, len(frames))
            view = replace(state.view, draw=(state.view.draw + frame) % 1000)
            points, _, R_true = disturbed_frame(state.sequence, frame, state.kit, view)
            found = _solve(points, selection.sets, view.draw)
            for name, way in ways.items():
                winner, _ = choose(*found, points.x_p, points.x_c, e_prev[name], way, focal)
                errors[name][done], e_prev[name], _ = judged(found.E[winner], points, R_true, way, focal)
        sentence = f"Rotation error of frames {frames[0]} to {frames[-1]}; move a control to come back."
        facts = tuple(Fact(f"median, {name}", float(np.median(v)), "°", 3) for name, v in errors.items())
        chart = errors_figure(errors, frames, height=self.height)
        return Drawing(stack([chart], self.height), sentence, facts)

    def _picture(self, state: State, points: Points, inliers: BoolArray, touched: BoolArray) -> Image:
        camera = state.sequence.camera
        picture = photo(stereo(state.sequence, state.frame)[0], camera.width)
        centre = np.array([camera.cx, camera.cy])
        starts, ends = points.x_p * camera.f + centre, points.x_c * camera.f + centre
        for place in np.rint(16 * ends[touched]).astype(int).tolist():
            cv2.circle(picture, place, 5 * 16, bgr(FIFTH), 1, cv2.LINE_AA, shift=4)
        draw_flow(picture, starts, ends, np.where(inliers, GOOD, BAD).tolist(), 2)
        words = f"frame {state.frame}: inliers of the winner blue, outliers orange, disturbed ones in rings"
        return caption(photo(picture, WIDTH, PHOTO_HEIGHT), words)
