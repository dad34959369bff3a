"""Chapter 5: the winner of one frame when a share of the matches is on a lorry in front of the camera."""

from __future__ import annotations

import numpy as np

from vo_lib.config import preset
from vo_lib.geometry.matches import empty_matches
from vo_lib.paper.buckets import select_by_bucket
from vo_lib.paper.selection import sampson_inliers
from vo_lib.runs.drive import make_odometry

from ..frames import frame_matches, stereo, true_motion
from ..panel import Control, Drawing, Fact, Panel, State
from ..simulation.lorry import LorryConfig, with_lorry
from .figures import PHOTO_HEIGHT, filter_picture

CENTI, PERCENT = 100.0, 100.0


class LorryPanel(Panel):
    """A frame with a lorry: the features that the winner fits, and the error without the lorry's features."""

    title = "A lorry in front of the camera"
    view = LorryConfig
    kit = preset("solution_selection", variant="kit")
    height = PHOTO_HEIGHT
    controls = (
        Control("view.share", "share", high=0.9, step=0.05),
        Control("view.distance", "distance", high=20, step=0.5),
    )

    def draw(self, state: State) -> Drawing:
        sequence, frame, config = state.sequence, state.frame, state.config
        frames = [empty_matches(), frame_matches(sequence, frame, config)]
        (_, box_p), (matches, box_c) = with_lorry(sequence.camera, frames, state.view)
        T_true, errors, fits = true_motion(sequence, frame), [], np.zeros(len(matches), np.bool_)
        for method in ("feature_selection", "solution_selection"):
            odometry = make_odometry(sequence.camera, preset(method, variant=config.variant))
            odometry.start(box_p)
            T_cp = odometry.step(matches, box_c).T_cp
            away = np.nan if T_true is None else np.linalg.norm(T_cp[:3, 3] - T_true[:3, 3])
            errors.append(CENTI * float(away))
        if odometry.e_prev is not None:  # the winner of all features
            E = odometry.e_prev.reshape(3, 3)
            fits = sampson_inliers(E, *odometry.points(matches), odometry.threshold)
        image, lorry = stereo(sequence, frame)[0].copy(), matches.id < 0
        for x0, y0, x1, y1 in np.rint(box_c.xyxy).astype(int).tolist():
            image[y0:y1, x0:x1] = image[y0:y1, x0:x1] // 4 + 96
        words = f"frame {frame}: features that the winner fits blue, others orange; the lorry grey"
        picture = filter_picture(image, matches, fits, box_c, None, words)
        used = select_by_bucket(matches.cur_left, matches.age, matches.strength, config.buckets)
        sentence = (
            f"The winner of all features fits {np.sum(fits & ~lorry)} of {np.sum(~lorry)} matches on the street "
            f"and {np.sum(fits & lorry)} of {np.sum(lorry)} on the lorry."
        )
        facts = (
            Fact("on the lorry", PERCENT * int(np.sum(lorry)) / max(len(lorry), 1), "%"),
            Fact("after the buckets", PERCENT * int(np.sum(lorry[used])) / max(len(used), 1), "%"),
            Fact("error, all features", errors[1], "cm", 2),
            Fact("error, box removed", errors[0], "cm", 2),
        )
        return Drawing([picture], sentence, facts)
