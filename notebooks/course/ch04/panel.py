"""Chapter 4: the translation of a frame from near and far features, with noise and wrong matches."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vo_lib.config import preset
from vo_lib.data.sequence import Sequence
from vo_lib.errors import DataError
from vo_lib.geometry.camera import StereoCamera
from vo_lib.geometry.matches import StereoMatches
from vo_lib.geometry.motion import rotation_from_vector
from vo_lib.geometry.types import Array
from vo_lib.kit.settings import KitConfig, KitTranslationConfig
from vo_lib.paper.settings import TranslationConfig, TranslationLimits
from vo_lib.paper.translation import feature_rows, solve_translation
from vo_lib.settings import Checked, setting

from ..drawing import PHOTO_HEIGHT, figure
from ..drawn_matches import features_picture
from ..frames import Points, frame_points, scene_truth, stereo
from ..panel import Control, Drawing, Fact, Panel, State
from ..rotation_errors import reference_rotation
from ..simulation.mismatches import shifts
from .figures import MILLI, ellipse_chart, residuals_chart
from .weightings import METHOD, WEIGHTINGS, Solution, alone, solve_by

CHART_HEIGHT = 224
GROUPS = 10  # of features that are solved separately
TRUE = "the truth"
RECORDED = "the recorded truth"
ESTIMATE = "the published estimate"
ABOUT = {
    RECORDED: " In one frame an error of the calibration looks like one of the recorded truth.",
    ESTIMATE: " Without ground truth, the reference is the result of variant `published` for undisturbed matches.",
}


@dataclass(frozen=True)
class TranslationView(Checked):
    """Disturbance of the frame's matches and rotation in the panel of chapter 4."""

    weighting: str = setting(METHOD, "combination of the rows of all features", choices=WEIGHTINGS)
    noise: float = setting(0.1, "noise added to each coordinate in all four images", unit="px", low=0, high=2)
    wrong: float = setting(0.0, "share of matches with wrong positions in the current pair", low=0, high=0.9)
    turn: float = setting(
        0.0, "error of the rotation about the vertical axis", unit="deg", low=-0.5, high=0.5
    )
    draw: int = setting(0, "seed of the noise and of the wrong matches", low=0, high=999)


def disturbed(matches: StereoMatches, view: TranslationView) -> StereoMatches:
    """The matches with noise; some matches are shifted by 4 to 40 px in the current pair."""
    rng = np.random.default_rng([6, view.draw])
    count = len(matches)
    noise = rng.normal(0.0, view.noise, (4, count, 2))
    mismatched = rng.permutation(count)[: round(view.wrong * count)]
    noise[2:, mismatched] += shifts(rng, len(mismatched))
    return replace(
        matches,
        prev_left=matches.prev_left + noise[0],
        prev_right=matches.prev_right + noise[1],
        cur_left=matches.cur_left + noise[2],
        cur_right=matches.cur_right + noise[3],
    )


def usual_rotation(sequence: Sequence, frame: int, points: Points) -> Array:
    """The true rotation of a drawn frame; for a real frame, the best estimate from the matches.

    The truth of a real drive is from GPS and gyroscopes; over one frame, the matches are more accurate.
    """
    exact = points if scene_truth(sequence) is not None else replace(points, T_cp=None)
    return reference_rotation(sequence, frame, exact)


def reference(sequence: Sequence, points: Points, R_cp: Array) -> tuple[Array, str]:
    """The reference translation, (3,) metres, and its name."""
    if points.T_cp is not None:
        return np.asarray(points.T_cp[:3, 3]), RECORDED if scene_truth(sequence) is None else TRUE
    solved = solve_translation(sequence.camera, points.matches, R_cp, TranslationConfig())
    if solved is None:
        raise DataError("the matches of this frame give no translation: choose another *frame*")
    return solved[0], ESTIMATE


def covariance(
    camera: StereoCamera,
    matches: StereoMatches,
    R_cp: Array,
    config: TranslationLimits,
    weighting: str = METHOD,
) -> Array:
    """Covariance (3, 3) of the translation, m², for any weighting: from the scatter of solutions of groups.

    If the solutions of G groups have the covariance S, the covariance of their mean is S / G. The solution
    from all features has about this covariance.
    """
    group = np.arange(len(matches)) % GROUPS
    solved = [solve_by(weighting, camera, matches[group == g], R_cp, config) for g in range(GROUPS)]
    t = np.array([each.t_cp for each in solved if each is not None]).reshape(-1, 3)
    return np.zeros((3, 3)) if len(t) < 2 else np.asarray(np.cov(t.T) / len(t))


class TranslationPanel(Panel):
    """The translation of one frame: residuals by depth, and the error with its ellipse, from above."""

    title = "From a rotation and stereo matches to a translation"
    view = TranslationView
    height = PHOTO_HEIGHT + CHART_HEIGHT
    kit = preset("solution_selection", variant="kit")
    controls = (
        Control("view.weighting", "weighting"),
        Control("translation.max_depth", "depth limit", high=150, step=5),
        Control("translation.agreement", "agreement", low=0.4, high=5, step=0.1),
        Control("translation.scale", "scale s", high=5, step=0.05),
        Control("view.noise", "noise added", high=0.8, step=0.05),
        Control("view.wrong", "wrong share", step=0.05),
        Control("view.turn", "rotation error", step=0.01),
        Control("view.draw", "draw again", button=True),
    )

    def idle(self, state: State) -> set[str]:
        if state.view.weighting != METHOD:
            return {"translation.agreement", "translation.scale"}
        return {"translation.agreement"} if isinstance(state.config, KitConfig) else set()

    def draw(self, state: State) -> Drawing:
        sequence = state.sequence
        camera = sequence.camera
        config = state.config.translation
        view = state.view
        points = frame_points(sequence, state.frame, state.config)
        R_usual = usual_rotation(sequence, state.frame, points)
        t_ref, name = reference(sequence, points, R_usual)
        R = rotation_from_vector(np.radians([0.0, view.turn, 0.0])) @ R_usual
        matches = disturbed(points.matches, view)
        t, residual, weight = self._solved(state, matches, R)
        C = covariance(camera, matches, R, config, view.weighting)

        limit = None
        if view.weighting == METHOD:
            limit = config.scale if isinstance(config, KitTranslationConfig) else config.agreement
        chart, (left, right) = figure(CHART_HEIGHT, 2, (1.7, 1.0))
        residuals_chart(left, points.X_p[:, 2], residual, limit)
        ellipse_chart(right, alone(*feature_rows(camera, matches, R)), weight, t, C, t_ref, name)
        words = f"frame {state.frame}: blue: weight of ½ or more; orange: less; grey: beyond the depth limit"
        image = stereo(sequence, state.frame)[0]
        picture = features_picture(image, matches.prev_left, matches.cur_left, weight, words)

        step = float(np.linalg.norm(t_ref))
        longer = float(np.linalg.norm(t)) / step - 1.0 if step > 0 else np.nan
        sentence = (
            f"t_cp = ({t[0]:.3f}, {t[1]:.3f}, {t[2]:.3f}) m, compared with {name}. "
            f"The length of the step differs by {round(longer, 3) + 0.0:+.1%} from {step:.2f} m."
            f"{ABOUT.get(name, '')}"
        )
        what = "difference" if name == ESTIMATE else "error"
        used = int(np.count_nonzero(np.isfinite(residual)))
        return Drawing([picture, chart], sentence, self._facts(state, what, t - t_ref, C, used))

    def _solved(self, state: State, matches: StereoMatches, R: Array) -> Solution:
        """The result of `solve_by` for the controls; `DataError` without one."""
        camera = state.sequence.camera
        solved = solve_by(state.view.weighting, camera, matches, R, state.config.translation)
        if solved is not None:
            return solved
        if "translation.agreement" in self.idle(state):
            raise DataError("no feature is near enough: increase *depth limit*")
        raise DataError("no feature is near enough, or none agrees: increase *depth limit* or *agreement*")

    def _facts(self, state: State, what: str, off: Array, C: Array, used: int) -> tuple[Fact, ...]:
        """The numbers below the picture.

        what : word for `off` (3,), metres, the difference from the reference. C : (3, 3) covariance of t, m².
        used : number of features.
        """
        view = state.view
        error = MILLI * off
        # A wrong rotation by an angle displaces t to the side by this length times the angle.
        lever = abs(float(off[0]) / np.radians(view.turn)) if view.turn else np.nan
        return (
            Fact(what, float(np.linalg.norm(error)), "mm", 1),
            Fact(f"{what} in x", float(error[0]), "mm", 1),
            Fact(f"{what} in z", float(error[2]), "mm", 1),
            Fact("σ in x", MILLI * float(np.sqrt(C[0, 0])), "mm", 1),
            Fact("σ in z", MILLI * float(np.sqrt(C[2, 2])), "mm", 1),
            Fact("features used", used),
            Fact(f"{what} in x / rotation error", lever, "m", 1),
            Fact("depth limit", state.config.translation.max_depth, "m"),
            Fact("rotation error", view.turn, "°", 2),
            Fact("wrong share", 100 * view.wrong, "%"),
            Fact("noise added", view.noise, "px", 2),
        )
