"""The panel of chapter 5, the film and the report show the removal that the odometry makes."""

from __future__ import annotations

import numpy as np
import pytest

from course.ch05.box_sources import LABELS, FilteringView
from course.ch05.frame_removal import filtered_frame
from vo_lib import preset, run
from vo_lib.config import change
from vo_lib.data.sequence import Sequence
from vo_lib.report.film import film_frames, removal_image
from vo_lib.report.plots import match_image


@pytest.mark.parametrize(
    ("variant", "rule"),
    [("published", "none"), ("published", "all"), ("kit", "all"), ("kit", "moving"), ("kit", "truth")],
)
def test_panel_and_film_show_the_removal_of_the_odometry(street: Sequence, variant: str, rule: str) -> None:
    sequence = street.part(56, 59)
    config = change(preset("feature_selection", variant=variant), "filter.rule", rule)
    if variant == "kit":
        # The panel shows a frame without the calibration that a drive has learnt.
        config = change(config, "calibration.estimate", False)
    result = run(sequence, config)
    *_, filmed = film_frames(result)
    shown, _ = filtered_frame(sequence, 2, config, FilteringView(model=LABELS))
    assert np.count_nonzero(~filmed.removal.kept) == result.motions[-1].removed
    assert (result.motions[-1].removed > 0) == (rule != "none")
    np.testing.assert_array_equal(shown.kept, filmed.removal.kept)
    np.testing.assert_array_equal(shown.boxes.xyxy, filmed.removal.boxes.xyxy)
    assert (shown.state is None) == (rule != "moving")
    if shown.state is not None and filmed.removal.state is not None:
        np.testing.assert_array_equal(shown.state, filmed.removal.state)


@pytest.mark.parametrize(("variant", "rule"), [("published", "all"), ("kit", "all"), ("kit", "moving")])
def test_the_picture_of_a_removal_shows_the_frame_as_the_run_had_it(
    street: Sequence, variant: str, rule: str
) -> None:
    result = run(
        street.part(40, 60), change(preset("feature_selection", variant=variant), "filter.rule", rule)
    )
    most = max(result.motions, key=lambda motion: motion.removed)
    filmed = next(frame for frame in film_frames(result) if frame.motion.removed == most.removed)
    assert np.count_nonzero(~filmed.removal.kept) == most.removed > 0
    removal = filmed.removal
    image = result.sequence.left(filmed.index)
    expected = match_image(image, filmed.matches, removal.kept, removal.boxes, removal.state)
    found = removal_image(result)
    assert found is not None
    assert found[0] == filmed.index
    np.testing.assert_array_equal(found[1], expected)
