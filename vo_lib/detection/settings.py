"""Thresholds of vehicle detection."""

from __future__ import annotations

from dataclasses import dataclass

from ..settings import Checked, setting


@dataclass(frozen=True)
class DetectorConfig(Checked):
    """Settings of the vehicle detector (chapter 5), which affect a run only through the boxes."""

    size: int = setting(
        0,
        "longer side of the network's input, if not fixed by the model; 0: the side used in training",
        unit="px",
        low=0,
        high=4096,
    )
    score: float = setting(0.25, "boxes with a lower score are not reported", low=0.001, high=1)
    nms: float = setting(
        0.5, "largest IoU of boxes of one class; the box with the lower score is dropped", low=0.05, high=1
    )
    threads: int = setting(1, "processor threads of the network", low=1, high=64)
