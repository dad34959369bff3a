"""Chapter 5: the vote of one frame if a lorry in front of the camera has part of the matches."""

from __future__ import annotations

import numpy as np

from vo_lib.config import preset
from vo_lib.data.sequence import Sequence
from vo_lib.geometry.boxes import Boxes
from vo_lib.geometry.camera import StereoCamera
from vo_lib.geometry.matches import StereoMatches, empty_matches
from vo_lib.geometry.types import Array, BoolArray
from vo_lib.paper.buckets import select_by_bucket
from vo_lib.paper.selection import sampson_inliers
from vo_lib.paper.settings import MethodConfig
from vo_lib.runs.drive import make_odometry

from ..ch03.figures import errors_figure
from ..colours import PALE
from ..controls import Control
from ..drawing import log_axis, say, stack
from ..frames import Memory, frame_matches, key_of, lacks, stereo, true_motion
from ..panel import Drawing, Panel, State
from ..results import Fact
from ..simulation.lorry import LorryConfig, with_lorry
from .figures import filter_picture

PHOTO_HEIGHT, CHART_HEIGHT = 298, 230
CENTI, PERCENT = 100.0, 100.0
SHARES, SHOWN = np.arange(1, 10) / 10, (0.01, 200.0)  # of the chart; centimetres
WAYS = {"all features": "solution_selection", "box removed": "feature_selection"}


_errors: Memory[dict[str, Array]] = Memory(48)


def laden_frame(
    sequence: Sequence, frame: int, config: MethodConfig, lorry: LorryConfig
) -> tuple[StereoMatches, list[Boxes]]:
    """The matches of a frame >= 1 with the lorry's; its boxes in the previous and the current left image."""
    frames = [empty_matches(), frame_matches(sequence, frame, config)]
    laden = [*with_lorry(sequence.camera, frames, lorry)]
    return laden[1][0], [box for _, box in laden]


def vote(
    camera: StereoCamera, matches: StereoMatches, boxes: list[Boxes], config: MethodConfig
) -> tuple[Array, BoolArray]:
    """T_cp (4, 4) of a frame without a previous vector, and which of its matches (N,) the winner fits."""
    odometry = make_odometry(camera, config)
    odometry.start(boxes[0])
    T_cp = odometry.step(matches, boxes[1]).T_cp
    if odometry.e_prev is None:
        return T_cp, np.zeros(len(matches), np.bool_)
    E = odometry.e_prev.reshape(3, 3)
    return T_cp, sampson_inliers(E, *odometry.points(matches), odometry.threshold)


def lorry_errors(sequence: Sequence, frame: int, lorry: LorryConfig, variant: str) -> dict[str, float]:
    """Error of a frame's translation, centimetres, with all features and with the lorry's box removed."""
    T_true, errors = true_motion(sequence, frame), {}
    if T_true is None:
        return dict.fromkeys(WAYS, np.nan)
    for name, method in WAYS.items():
        config = preset(method, variant=variant)
        T_cp, _ = vote(sequence.camera, *laden_frame(sequence, frame, config, lorry), config)
        errors[name] = CENTI * float(np.linalg.norm(T_cp[:3, 3] - T_true[:3, 3]))
    return errors


def errors_by_share(sequence: Sequence, frame: int, distance: float, variant: str) -> dict[str, Array]:
    """The same for each of `SHARES`, (S,) each; kept."""

    def find() -> dict[str, Array]:
        lorries = (LorryConfig(share, distance) for share in SHARES.tolist())
        each = [lorry_errors(sequence, frame, lorry, variant) for lorry in lorries]
        return {name: np.array([errors[name] for errors in each]) for name in WAYS}

    return _errors.get((*key_of(sequence, frame), distance, variant), find)


class LorryPanel(Panel):
    """A frame with a lorry in it: the features that the winner fits, and the errors over the lorry's share."""

    title = "A lorry before the camera"
    view = LorryConfig
    kit = preset(WAYS["all features"], variant="kit")
    height = PHOTO_HEIGHT + CHART_HEIGHT
    controls = (
        Control("view.share", "share", high=0.9, step=0.05),
        Control("view.distance", "distance", high=20, step=0.5),
    )

    def draw(self, state: State) -> Drawing:
        sequence, frame, view, config = state.sequence, state.frame, state.view, state.config
        matches, boxes = laden_frame(sequence, frame, config, view)
        _, fits = vote(sequence.camera, matches, boxes, config)
        lorry = matches.id < 0
        on_lorry, on_street = (int(np.sum(fits & each)) for each in (lorry, ~lorry))
        image = stereo(sequence, frame)[0].copy()
        for x0, y0, x1, y1 in np.rint(boxes[1].xyxy).astype(int).tolist():
            image[y0:y1, x0:x1] = image[y0:y1, x0:x1] // 4 + 96
        words = f"frame {frame}: features that the winner fits blue, others orange; the lorry grey"
        picture = filter_picture(image, matches, fits, boxes[1], None, words, PHOTO_HEIGHT)
        chart = errors_figure(
            errors_by_share(sequence, frame, view.distance, config.variant),
            PERCENT * SHARES,
            f"error of the translation, lorry {view.distance:g} m ahead",
            "share of the matches on the lorry [%]",
            "cm",
            CHART_HEIGHT,
        )
        (axis,) = chart.axes
        log_axis(axis.yaxis, *SHOWN)
        axis.axvline(PERCENT * view.share, color=PALE, linewidth=1)
        if missing := lacks(sequence):
            say(axis, missing)
        used = select_by_bucket(matches.cur_left, matches.age, matches.strength, config.buckets)
        errors = lorry_errors(sequence, frame, view, config.variant)
        sentence = (
            f"The winner of all features fits {on_street} of the street's {np.sum(~lorry)} matches and "
            f"{on_lorry} of the lorry's {np.sum(lorry)}: "
            f"the vote goes to the {'lorry' if on_lorry > on_street else 'street'}."
        )
        facts = (
            Fact("on the lorry", PERCENT * int(np.sum(lorry)) / max(len(lorry), 1), "%"),
            Fact("after the buckets", PERCENT * int(np.sum(lorry[used])) / max(len(used), 1), "%"),
            *(Fact(f"error, {name}", error, "cm", 2) for name, error in errors.items()),
        )
        return Drawing(stack([picture, chart], self.height), sentence, facts)
