"""One frame of a sequence as a picture: which of its matches boxes remove."""

from __future__ import annotations

import numpy as np

from ..config import preset
from ..core.boxes import area
from ..data.sequence import Sequence
from ..front_end.front_end import make_front_end
from ..method.boxes import on_vehicles
from .plots import jpeg, match_image
from .report import Picture


def example_frame(sequence: Sequence) -> Picture:
    """The matches in the frame with the largest vehicle boxes among a dozen of the sequence."""
    tried = np.linspace(1, len(sequence) - 1, min(12, len(sequence) - 1)).astype(int).tolist()
    frame = max(tried, key=lambda i: area(sequence.boxes(i).xyxy).sum())
    config = preset("feature_selection")
    matcher = make_front_end(sequence.camera, config.features, config.matching)
    pairs = [sequence.stereo(frame - 1), sequence.stereo(frame)]
    matches = [matcher.step(matcher.prepare(pair)) for pair in pairs][-1]
    boxes = sequence.boxes(frame)
    kept = ~on_vehicles(matches, sequence.boxes(frame - 1), boxes, config.filter)
    return Picture(
        jpeg(match_image(pairs[1][0], matches, kept, boxes)),
        "Matches of one frame, from the previous place of a feature to its present one: "
        "orange lies in a vehicle's box (white) and is removed, blue stays.",
    )
