"""Chapter 1: the matched features, the check that drops each of the others, and the truly correct ones."""

from __future__ import annotations

import numpy as np

from vo_lib.config import preset
from vo_lib.errors import DataError
from vo_lib.paper.buckets import select_by_bucket

from ..controls import Control
from ..drawing import figure, stack
from ..frames import stereo, truth
from ..panel import Drawing, Panel, State
from ..results import Fact
from ..simulation.truth import match_errors
from .figures import CHOSEN, SURPLUS, by_fate, depths_chart, errors_chart, fates, fates_chart, fates_picture
from .trace import LOST, OPEN, trace

PHOTO_HEIGHT, CHART_HEIGHT = 298, 290
RIGHT = 1.0  # pixels; a match is right whose places in the other three images are this near to the truth


class MatchingPanel(Panel):
    """One step of a front end: every feature of the previous pair and its fate."""

    kit = preset("solution_selection", variant="kit")
    title = "Found again or not: the loop, its checks and the buckets"
    height = PHOTO_HEIGHT + CHART_HEIGHT
    controls = (
        Control("features.blob_cell", "spacing", low=9, high=61),
        Control("features.blob_quality", "threshold", high=500),
        Control("matching.search_radius", "search radius", high=300),
        Control("matching.row_tolerance", "row tolerance", high=3),
        Control("matching.loop_tolerance", "loop tolerance", high=5),
        Control("features.cell", "corner spacing", high=60),
        Control("features.quality", "corners above", high=20),
        Control("matching.max_difference", "difference", high=60),
        Control("matching.surface_tolerance", "surface tolerance", high=5),
        Control("buckets.size", "bucket size", high=300),
        Control("buckets.features", "features a bucket", high=20),
    )

    def draw(self, state: State) -> Drawing:
        sequence, frame = state.sequence, state.frame
        known = truth(sequence)
        traced = trace(sequence, frame, state.config)
        if len(traced.id) == 0:
            raise DataError(f"frame {frame - 1} has no features: lower the threshold")
        kept = traced.kept
        chosen = kept[select_by_bucket(kept.cur_left, kept.age, kept.strength, state.config.buckets)]
        fate = fates(traced, chosen.id)
        names = fate[traced.index]
        dropped = int(np.count_nonzero(~np.isin(fate, (CHOSEN, SURPLUS, LOST, OPEN))))
        facts = [
            Fact("features", len(fate)),
            Fact("found again", len(names)),
            Fact("dropped by checks", dropped),
            Fact("kept", len(chosen)),
        ]
        words = f"frame {frame}: kept blue, others by what dropped them"
        chart, (left, right) = figure(CHART_HEIGHT, 2)
        wrong = np.zeros(len(names), np.bool_)  # where the truth is not known, too
        if known is None:
            fates_chart(left, traced, fate, None)
            depths_chart(right, sequence.camera.triangulate(chosen.prev_left, chosen.prev_right)[:, 2])
        else:
            error = match_errors(known, traced.found, frame)
            wrong = error > RIGHT
            words += "; rings: kept, but wrong"
            fates_chart(left, traced, fate, wrong)
            by_name = by_fate(names, error)
            errors_chart(right, by_name)
            exact = by_name["kept"][np.isfinite(by_name["kept"])]
            facts += [
                Fact("wrong among the kept", int(np.count_nonzero(by_name["kept"] > RIGHT))),
                Fact("right ones dropped", int(np.count_nonzero(by_name["dropped"] <= RIGHT))),
                Fact("median error of the kept", float(np.median(exact)) if len(exact) else np.nan, "px", 3),
            ]
        picture = fates_picture(stereo(sequence, frame)[0], traced, fate, wrong, words)
        sentence = (
            f"Of {len(fate)} features of the previous pair {len(names)} are found again in all four images; the "
            f"checks drop {dropped} of these, the buckets {np.count_nonzero(fate == SURPLUS)}, and {len(chosen)} "
            "are kept."
        )
        return Drawing(stack([picture, chart], self.height), sentence, tuple(facts))
