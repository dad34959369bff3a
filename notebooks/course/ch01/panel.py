"""Chapter 1: the kept matches, the check that each dropped feature failed, and the errors of the matches."""

from __future__ import annotations

import numpy as np

from vo_lib.config import preset
from vo_lib.errors import DataError
from vo_lib.paper.settings import PublishedConfig

from ..drawing import PHOTO_HEIGHT
from ..frames import scene_truth, stereo
from ..panel import Control, Drawing, Fact, Panel, State
from ..simulation.true_matches import match_errors
from .figures import by_fate, fates_picture, step_figure
from .trace import trace
from .wrong_matches import RIGHT

CHART_HEIGHT = 252


class MatchingPanel(Panel):
    """One step of a front end: every feature of the previous pair and its fate."""

    kit = preset("solution_selection", variant="kit")
    title = "Matching: the loop, its checks and the buckets"
    height = PHOTO_HEIGHT + CHART_HEIGHT
    controls = (
        Control("features.blob_cell", "spacing", low=9, high=61),
        Control("features.blob_quality", "threshold", high=500),
        Control("matching.search_radius", "search radius", high=300),
        Control("matching.row_tolerance", "row tolerance", high=3),
        Control("matching.loop_tolerance", "loop tolerance", high=5),
        Control("features.cell", "corner spacing", high=60),
        Control("features.quality", "strength", high=20),
        Control("matching.max_difference", "difference", high=60),
        Control("matching.surface_tolerance", "surface tolerance", high=5),
        Control("buckets.size", "bucket size", high=300),
        Control("buckets.features", "features a bucket", high=20),
    )

    def draw(self, state: State) -> Drawing:
        frame = state.frame
        ground_truth = scene_truth(state.sequence)
        traced = trace(state.sequence, frame, state.config)
        if len(traced.id) == 0:
            control = "threshold" if isinstance(state.config, PublishedConfig) else "strength"
            raise DataError(f"frame {frame - 1} has no features that can be matched: lower *{control}*")
        error = match_errors(ground_truth, traced.matches, frame)
        by_name = by_fate(traced, error)
        wrong = error > RIGHT  # false where the truth is not known

        found = len(traced.matches)
        checked = len(traced.checked)
        kept = len(traced.chosen)
        words = f"frame {frame}: kept blue, others in the colour of the failed check"
        sentence = (
            f"{len(traced.id)} features of the previous pair have a stereo match, and {found} of them are "
            f"matched in all four images. The checks remove {found - checked} of these, the "
            f"buckets {checked - kept}; {kept} are kept."
        )
        facts = [Fact("features", len(traced.id)), Fact("kept", kept)]
        if ground_truth is None:
            sentence += " This sequence has no truth for single matches."
        else:
            words += "; rings: wrong, but kept"
            exact = by_name["kept"][np.isfinite(by_name["kept"])]
            median = float(np.median(exact)) if len(exact) else np.nan
            facts += [
                Fact("wrong among the kept", int(np.count_nonzero(by_name["kept"] > RIGHT))),
                Fact("right ones dropped", int(np.count_nonzero(by_name["dropped"] <= RIGHT))),
                Fact("median error of the kept", median, "px", 3),
            ]
        picture = fates_picture(stereo(state.sequence, frame)[0], traced, wrong, words)
        chart = step_figure(traced, error, CHART_HEIGHT)
        return Drawing([picture, chart], sentence, tuple(facts))
