"""Chapter 5: what a method's box rule removes in one frame, and the frame's motion without the removed features."""

from __future__ import annotations

from vo_lib.config import change
from vo_lib.data.sequence import Sequence
from vo_lib.data.truth import matches_on_moving
from vo_lib.errors import DataError
from vo_lib.geometry.boxes import Boxes, no_boxes
from vo_lib.geometry.matches import StereoMatches
from vo_lib.geometry.result import FrameResult
from vo_lib.geometry.types import BoolArray
from vo_lib.kit.settings import KitConfig
from vo_lib.paper.box_removal import Removal
from vo_lib.paper.settings import MethodConfig
from vo_lib.runs.drive import make_odometry

from ..frames import frame_matches, key_of, scene_truth
from ..memory import Memory
from .box_sources import FilteringView, frame_boxes

_motions: Memory[FrameResult] = Memory(48)


def filtered_frame(
    sequence: Sequence, frame: int, config: MethodConfig, view: FilteringView
) -> tuple[Removal, Boxes]:
    """What a method's box rule does to the matches of a frame >= 1, and the frame's boxes of the chosen classes.

    These boxes lack the margin, which `Removal.boxes` have.

    The rule `moving` starts one frame earlier, since a match is also removed if its previous point was in a
    moving box.
    """
    rule = config.filter
    if rule.rule == "truth" and scene_truth(sequence) is None:
        raise DataError(
            "rule: `truth` needs the true motions of vehicles, which only a drawn scene has: choose another rule"
        )
    first = max(frame - 1, 1) if rule.rule == "moving" else frame

    def on_moving(number: int, matches: StereoMatches) -> BoolArray:
        return matches_on_moving(sequence, first - 1 + number, matches)

    box_filter = make_odometry(sequence.camera, config, on_moving=on_moving).box_filter
    box_filter.start(frame_boxes(sequence, first - 1, view, rule))
    for index in range(first, frame + 1):
        boxes = frame_boxes(sequence, index, view, rule)
        removal = box_filter.step(frame_matches(sequence, index, config), boxes)
    return removal, boxes


def motion_from(sequence: Sequence, frame: int, keep: BoolArray, config: MethodConfig) -> FrameResult:
    """Motion of a frame from the matches in the mask `keep` (N,), without earlier frames.

    The motions differ only by the features: neither a previous vector nor an estimated rig is used.
    """
    alone = change(change(config, "filter.rule", "none"), "selection.prior", False)
    if isinstance(alone, KitConfig):
        alone = change(alone, "calibration.estimate", False)
    matches = frame_matches(sequence, frame, config)
    key = (*key_of(sequence, frame), keep.tobytes(), alone)
    return _motions.get(
        key, lambda: make_odometry(sequence.camera, alone).step(matches[keep], no_boxes()).motion
    )
