"""Chapter 1: which features are found again, which check drops which, and which are truly right."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from vo_lib.config import VARIANTS, preset
from vo_lib.errors import DataError
from vo_lib.kit.settings import KitConfig
from vo_lib.paper.buckets import select_by_bucket
from vo_lib.paper.settings import FeatureConfig, MatchingConfig, MethodConfig, PublishedConfig, StereoLimits
from vo_lib.settings import Checked, setting

from ..controls import Control
from ..drawing import figure, stack
from ..frames import stereo, truth
from ..panel import Drawing, Panel, State
from ..results import Fact
from ..simulation.truth import match_errors
from .figures import CHOSEN, SURPLUS, by_fate, depths_chart, errors_chart, fates, fates_chart, fates_picture
from .trace import LOST, trace

PHOTO_HEIGHT, CHART_HEIGHT = 298, 290
RIGHT = 1.0  # pixels; a match is right whose places in the other three images are this near to the truth


@dataclass(frozen=True)
class MatchingView(Checked):
    """Which front end, and settings that mean the same for both detectors."""

    variant: str = setting("kit", "the kit's front end, or the paper's as published", choices=tuple(VARIANTS))
    spacing: int = setting(18, "one feature of a kind in a square of this size", unit="px", low=10, high=60)
    threshold: float = setting(1.0, "times the usual one; higher: fewer, safer features", low=0.1, high=20)


def with_view(config: KitConfig, view: MatchingView) -> MethodConfig:
    """The configuration of the variant's front end, with the view's spacing and threshold for its detector.

    The paper's has its own settings, but for the limits of a stereo match that both variants share.
    """
    if view.variant == "kit":
        quality = min(view.threshold * config.features.quality, 50.0)
        return replace(config, features=replace(config.features, cell=view.spacing, quality=quality))
    limits = {field.name: getattr(config.matching, field.name) for field in fields(StereoLimits)}
    blob_quality = view.threshold * FeatureConfig().blob_quality
    return PublishedConfig(
        features=FeatureConfig(blob_cell=view.spacing, blob_quality=blob_quality),
        matching=MatchingConfig(**limits),
    )


class MatchingPanel(Panel):
    """One step of a front end: every feature of the previous pair and what became of it."""

    start = preset("solution_selection", variant="kit")
    title = "Found again or not: the loop, its checks and the buckets"
    view = MatchingView
    height = PHOTO_HEIGHT + CHART_HEIGHT
    controls = (
        Control("view.variant", "front end"),
        Control("view.spacing", "spacing"),
        Control("view.threshold", "threshold ×", step=0.1),
        Control("matching.max_difference", "difference", high=60),
        Control("matching.row_tolerance", "row tolerance", high=3),
        Control("matching.surface_tolerance", "surface tolerance", high=5),
        Control("matching.loop_tolerance", "loop tolerance", high=5),
        Control("buckets.size", "bucket size", high=300),
        Control("buckets.features", "features a bucket", high=20),
    )

    def draw(self, state: State) -> Drawing:
        sequence, frame = state.sequence, state.frame
        known = truth(sequence)
        traced = trace(sequence, frame, with_view(state.kit, state.view))
        if len(traced.id) == 0:
            raise DataError(f"frame {frame - 1} has no features: lower the threshold")
        kept = traced.kept
        chosen = kept[select_by_bucket(kept.cur_left, kept.age, kept.strength, state.config.buckets)]
        fate = fates(traced, chosen.id)
        names = fate[traced.index]
        dropped = int(np.count_nonzero((fate != CHOSEN) & (fate != SURPLUS) & (fate != LOST)))
        facts = [
            Fact("features", len(fate)),
            Fact("found again", len(names)),
            Fact("dropped by checks", dropped),
            Fact("kept", len(chosen)),
        ]
        words = f"frame {frame}: kept blue, others by what dropped them"
        chart, (left, right) = figure(CHART_HEIGHT, 2)
        wrong = np.zeros(
            len(names), np.bool_
        )  # where the truth is not known, too: on outlines before the sky
        if known is None:
            fates_chart(left, fate, None)
            depths_chart(right, sequence.camera.triangulate(chosen.prev_left, chosen.prev_right)[:, 2])
        else:
            error = match_errors(known, traced.found, frame)
            wrong, everywhere = error > RIGHT, np.zeros(len(fate), np.bool_)
            everywhere[traced.index] = wrong
            words += "; rings: kept, but wrong"
            fates_chart(left, fate, everywhere)
            by_name = by_fate(names, error)
            errors_chart(right, by_name)
            exact = by_name["kept"][np.isfinite(by_name["kept"])]
            facts += [
                Fact("wrong among the kept", int(np.count_nonzero(by_name["kept"] > RIGHT))),
                Fact("right ones dropped", int(np.count_nonzero(by_name["dropped by a check"] <= RIGHT))),
                Fact("median error of the kept", float(np.median(exact)) if len(exact) else np.nan, "px", 3),
            ]
        picture = fates_picture(stereo(sequence, frame)[0], traced, fate, wrong, words)
        sentence = (
            f"Of {len(fate)} features of the previous pair {len(names)} are found again; the checks drop "
            f"{dropped} of these, the buckets {np.count_nonzero(fate == SURPLUS)}, and {len(chosen)} stay."
        )
        return Drawing(stack([picture, chart], self.height), sentence, tuple(facts))
