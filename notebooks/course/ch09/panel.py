"""Chapter 9: a path with simulated drift, its true and false loops, and the closed path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vo_lib.data.poses import from_first
from vo_lib.geometry.types import Image
from vo_lib.loops.find import PlacePairs
from vo_lib.loops.graph import close_path, graph_edges, linearised
from vo_lib.loops.places import place_frames
from vo_lib.loops.settings import LoopConfig
from vo_lib.settings import Checked, setting

from ..colours import DARK
from ..drawing import beside, figure
from ..frames import stereo
from ..panel import Control, Drawing, Fact, Panel, State
from ..perturbed_path import perturbed_path
from .block_drive import ate, made_up_loops, second_visits
from .figures import AFTER, BEFORE, draw_edges, draw_path, weight_chart

PHOTO_HEIGHT = 150
CHART_HEIGHT = 380
EQUAL_WEIGHTS = 1e6  # scale, standard deviations, at which all weights are 1
# Standard error of a frame's rotation. The graph takes the errors of the frames for independent, but the made-up turns
# all go the same way and add up. With the default, which is for a real path, the largest yaw error would lower the
# weights of some true loops.
FRAME_TURN_DEG = 0.1


@dataclass(frozen=True)
class LoopView(Checked):
    """Settings of the panel of chapter 9: changes of the path and of its loops."""

    closed: bool = setting(True, "close the loops by the pose graph")
    false: int = setting(1, "number of false loops, each between two different places", low=0, high=15)
    robust: bool = setting(True, "weights depend on the residual; off: all weights are 1")
    scale: float = setting(3.0, "residual in standard deviations at which a weight is ½", low=0.5, high=30)
    yaw: float = setting(2.0, "excess turn of the path to the right", unit="deg/100 m", low=-5, high=5)
    draw: int = setting(0, "seed of the noise and of the false loops", low=0, high=999)


class LoopPanel(Panel):
    """A path before and after its loops are closed, and the weight of each loop."""

    title = "A path that comes back"
    view = LoopView
    height = PHOTO_HEIGHT + CHART_HEIGHT
    needs_truth = True
    controls = (
        Control("view.closed", "close the loops"),
        Control("view.false", "false loops"),
        Control("view.robust", "robust weights"),
        Control("view.scale", "scale c", step=0.5),
        Control("view.yaw", "yaw error", step=0.1),
        Control("view.draw", "draw again", button=True),
    )

    def idle(self, state: State) -> set[str]:
        return set() if state.view.robust else {"view.scale"}

    def draw(self, state: State) -> Drawing:
        view = state.view
        truth = from_first(state.sequence.true_poses)
        config = LoopConfig(frame_turn=FRAME_TURN_DEG, scale=view.scale if view.robust else EQUAL_WEIGHTS)
        before = perturbed_path(truth, yaw=view.yaw, noise=5.0)  # mm in each step
        frames = place_frames(len(truth), config)
        pairs = second_visits(truth, frames, config.gap)
        loops = made_up_loops(truth, pairs, config, view.false, view.draw)
        is_false = np.arange(len(loops)) >= len(pairs)
        after = before
        weight = np.ones(len(loops))
        paths = {"truth": (truth, DARK), "before": (before, BEFORE)}
        if view.closed:
            closing = close_path(before, loops, config)
            after = closing.poses
            weight = closing.weight
            paths["closed"] = after, AFTER
        edges = graph_edges(before[frames], frames, loops, config)
        residuals, *_ = linearised(after[frames], edges)
        residual = np.linalg.norm(residuals, axis=1)[edges.is_loop]

        chart, (left, right) = figure(CHART_HEIGHT, 2)
        draw_path(left, paths)
        draw_edges(left, before, loops.first_frame, loops.second_frame, weight)
        left.plot(*before[state.frame, [0, 2], 3], "o", color=BEFORE)
        weight_chart(right, residual, is_false, config.scale)

        ate_before = ate(truth, before)
        ate_after = ate(truth, after)
        false = len(loops) - len(pairs)
        sentence = f"True loops: {len(pairs)}, false loops: {false}. ATE {ate_before:.2f} m before"
        sentence += f", {ate_after:.2f} m closed." if view.closed else "; the loops are not closed."
        facts = (
            Fact("ATE before", ate_before, "m", 2),
            Fact("ATE after", ate_after, "m", 2),
            Fact("true loops", len(pairs)),
            Fact("false loops", false),
            Fact("smallest weight, true", float(weight[~is_false].min()) if len(pairs) else np.nan, "", 3),
            Fact("largest weight, false", float(weight[is_false].max()) if false else np.nan, "", 3),
            Fact("robust", int(view.robust)),
        )
        return Drawing([_photos(state, loops, len(pairs)), chart], sentence, facts)


def _photos(state: State, loops: PlacePairs, true_loops: int) -> Image:
    """The image of the frame, and that of the first visit of the nearest loop; without true loops, of frame 0."""
    partner = 0
    visit = "as no place is visited twice"
    if true_loops:
        partner = int(loops.first_frame[np.abs(loops.second_frame - state.frame).argmin()])
        visit = "the first visit of the nearest loop"
    here = stereo(state.sequence, state.frame)[0]
    there = stereo(state.sequence, partner)[0]
    return beside(here, there, f"frame {state.frame}", f"frame {partner}, {visit}")
