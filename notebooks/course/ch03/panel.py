"""Chapter 3: the winner among about a thousand solutions, with the prior and without the prior."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vo_lib.config import preset
from vo_lib.data.sequence import Sequence
from vo_lib.geometry.motion import essential_angle, essential_vector, rigid, rotation_from_vector, transform
from vo_lib.geometry.types import Array, BoolArray
from vo_lib.paper.five_point import Candidates
from vo_lib.paper.selection import candidates_near_prior, truncated_errors
from vo_lib.paper.settings import MethodConfig, SelectionConfig
from vo_lib.settings import Checked, setting

from ..candidates import candidates_of, motion_of, winner_of
from ..ch02.figures import pixels
from ..drawing import PHOTO_HEIGHT
from ..frames import Points, frame_points, key_of, stereo
from ..memory import Memory
from ..panel import Control, Drawing, Fact, Panel, State
from ..rotation_errors import angle_between, reference_rotation, rotation_errors
from ..simulation.mismatches import shifts
from .figures import ScoredCandidates, candidates_figure, features_picture

CHART_HEIGHT = 252
PRIOR_SETS = 200  # for the essential vector of the previous frame
# The slanted wall: WALL · X = WALL_M, metres, and the noise of its points.
WALL = np.array([0.35, -0.2, 1.0])
WALL_M = 12.0
WALL_NOISE_PX = 0.3
# Motion of the bus from frame to frame: the bus turns into the street of the camera.
STEP = np.array([0.5, 0.0, 0.3])
TURN = rotation_from_vector(np.radians([0.0, 2.0, 0.0]))


@dataclass(frozen=True)
class SelectionView(Checked):
    """Disturbance of the frame's matches in the panel of chapter 3."""

    moving: float = setting(0.0, "share of the matches on one moving object, a turning bus", low=0, high=0.9)
    wrong: float = setting(
        0.0, "share of the matches with a wrong position in the current image", low=0, high=0.9
    )
    draw: int = setting(0, "seed of the sets and of the disturbed matches", low=0, high=999)
    plane: bool = setting(False, "all points are on one slanted wall that fills the view")


_candidates: Memory[Candidates] = Memory(12)
_priors: Memory[Array] = Memory(24)


def disturbed_frame(
    sequence: Sequence, frame: int, config: MethodConfig, view: SelectionView
) -> tuple[Points, BoolArray]:
    """A frame's points with added motion and mismatches, and a mask (N,) of the changed matches.

    The leftmost matches move together and turn about their middle; a wrong match is shifted by 4 to 40 px.
    """
    points = frame_points(sequence, frame, config)
    focal = sequence.camera.f
    T_cp = _camera_motion(sequence, frame, points)
    rng = np.random.default_rng([4, view.draw])
    if view.plane:
        points = _on_wall(points, T_cp, focal, rng)
    count = len(points.x_p)
    moving = round(view.moving * count)
    touched = moving + round(view.wrong * count)
    order = np.argsort(points.x_p[:, 0])  # from left to right
    order[moving:] = rng.permutation(order[moving:])
    on_bus = order[:moving]
    mismatched = order[moving:touched]
    x_c = points.x_c.copy()
    if moving:
        x_c[on_bus] = _on_bus(points.X_p[on_bus], points.x_c[on_bus], T_cp, focal)
    x_c[mismatched] += shifts(rng, len(mismatched)) / focal
    return replace(points, x_c=x_c), np.isin(np.arange(count), order[:touched])


def _camera_motion(sequence: Sequence, frame: int, points: Points) -> Array:
    """The true T_cp (4, 4); without truth, the rotation from the matches and the median change of the points."""
    if points.T_cp is not None:
        return points.T_cp
    R_cp = reference_rotation(sequence, frame, points)
    X_c = sequence.camera.triangulate(points.matches.cur_left, points.matches.cur_right)
    return rigid(R_cp, np.nanmedian(X_c - points.X_p @ R_cp.T, axis=0))


def _on_wall(points: Points, T_cp: Array, focal: float, rng: np.random.Generator) -> Points:
    """The points moved along their rays onto the wall, with new measurements in the current image."""
    rays = np.concatenate([points.x_p, np.ones((len(points.x_p), 1))], axis=1)
    X_p = rays * (WALL_M / np.maximum(rays @ WALL, 0.1))[:, None]
    noise = rng.normal(0.0, WALL_NOISE_PX / focal, points.x_c.shape)
    return replace(points, X_p=X_p, x_c=_projected(transform(T_cp, X_p)) + noise)


def _on_bus(X_p: Array, x_c: Array, T_cp: Array, focal: float) -> Array:
    """Current places (n, 2) of points X_p (n, 3) of the bus, with the errors of the measured places x_c (n, 2).

    An error counts up to one pixel: a larger one is a mismatch, or a motion of the thing in the image.
    """
    middle = np.median(X_p, axis=0)
    errors = np.clip(x_c - _projected(transform(T_cp, X_p)), -1.0 / focal, 1.0 / focal)
    return _projected(transform(T_cp, (X_p - middle) @ TURN.T + middle + STEP)) + errors


def _projected(X: Array) -> Array:
    """Normalised image points (N, 2) of X (N, 3); points behind the camera count as half a metre ahead."""
    return np.asarray(X[:, :2] / np.maximum(X[:, 2:], 0.5))


def previous_vector(sequence: Sequence, frame: int, config: MethodConfig) -> Array | None:
    """The previous frame's essential vector, by consensus; None for the first pair."""
    if frame < 2:
        return None
    # Whatever the panel has: it must not estimate this vector again when the number of sets moves.
    selection = replace(config.selection, sets=PRIOR_SETS, top_k=1, prior=False)

    def estimate() -> Array:
        points = frame_points(sequence, frame - 1, config)
        focal = sequence.camera.f
        candidates = candidates_of(points, selection.sets, 0)
        scored = scored_candidates(candidates, points, None, None, selection, focal)
        return motion_of(candidates.E[scored.selected], points, selection, focal)[1]

    key = (*key_of(sequence, frame - 1), config.features, config.matching, config.buckets, selection)
    return _priors.get(key, estimate)


def scored_candidates(
    candidates: Candidates,
    points: Points,
    e_prev: Array | None,
    R_true: Array | None,
    config: SelectionConfig,
    focal: float,
) -> ScoredCandidates:
    """Angles, errors and winners of a frame's candidates; without a true rotation, the rotation errors are NaN."""
    nothing = np.full(len(candidates.E), np.nan)
    angle = nothing if e_prev is None else np.degrees(essential_angle(essential_vector(candidates.E), e_prev))
    errors = truncated_errors(candidates.E, points.x_p, points.x_c, config.threshold / focal)
    consensus, _ = winner_of(candidates, errors, None, config)
    selected, dropped = winner_of(candidates, errors, e_prev, config)
    wrong = nothing if R_true is None else rotation_errors(candidates.E, R_true)
    return ScoredCandidates(
        angle, errors, wrong, candidates_near_prior(*candidates, e_prev, config), consensus, selected, dropped
    )


class SelectionPanel(Panel):
    """All candidates of a frame, the candidates near the prior, and the winners."""

    title = "A thousand solutions, one winner"
    view = SelectionView
    kit = preset("solution_selection", variant="kit")
    height = PHOTO_HEIGHT + CHART_HEIGHT
    controls = (
        Control("selection.sets", "n: sets", low=10, high=1000, step=10),
        Control("selection.top_k", "k: kept of a set"),
        Control("selection.threshold", step=0.05, high=5),
        Control("view.moving", "moving share", step=0.05),
        Control("view.wrong", "wrong share", step=0.05),
        Control("selection.mode", "winner"),
        Control("selection.prior", "use the previous vector"),
        Control("view.draw", "draw again", button=True),
        Control("view.plane", "one plane"),
    )

    def idle(self, state: State) -> set[str]:
        return set() if state.config.selection.prior and state.frame > 1 else {"selection.top_k"}

    def draw(self, state: State) -> Drawing:
        sequence = state.sequence
        camera = sequence.camera
        selection = state.config.selection
        points, touched = disturbed_frame(sequence, state.frame, state.config, state.view)
        R_true = None if points.T_cp is None else points.T_cp[:3, :3]
        key = (*points.key, selection.sets, state.view.draw)
        candidates = _candidates.get(key, lambda: candidates_of(points, selection.sets, state.view.draw))
        e_prev = previous_vector(sequence, state.frame, state.config)
        scored = scored_candidates(candidates, points, e_prev, R_true, selection, camera.f)
        R, _, inliers = motion_of(candidates.E[scored.selected], points, selection, camera.f)
        R_consensus, _, _ = motion_of(candidates.E[scored.consensus], points, selection, camera.f)
        error = angle_between(R, R_true)

        words = f"frame {state.frame}: the winner's inliers blue, outliers orange, disturbed matches in rings"
        image = stereo(sequence, state.frame)[0]
        start = pixels(points.x_p, camera)
        end = pixels(points.x_c, camera)
        picture = features_picture(image, start, end, inliers, words, touched)
        chart = candidates_figure(scored, error, CHART_HEIGHT)

        same = "also" if scored.selected == scored.consensus else "not"
        sentence = (
            f"Of {len(candidates.E)} solutions of {selection.sets} sets, {np.count_nonzero(scored.kept)} may "
            f"compete. The winner is {same} the winner of consensus."
        )
        if e_prev is None:
            sentence += " The first pair has no previous essential vector."
        if R_true is None:
            sentence += " The sequence has no ground truth."
        if scored.dropped:
            sentence += " The prior was dropped: its best solution scored clearly worse."
        facts = (
            Fact("error by selection", error, "°", 3),
            Fact("error by consensus", angle_between(R_consensus, R_true), "°", 3),
            Fact("between the two", angle_between(R, R_consensus), "°", 3),
            Fact("angle to the previous vector", float(scored.angle[scored.selected]), "°", 2),
            Fact("inliers", int(np.count_nonzero(inliers))),
            Fact("disturbed", int(np.count_nonzero(touched))),
        )
        return Drawing([picture, chart], sentence, facts)
