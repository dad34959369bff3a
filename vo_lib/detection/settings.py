"""Thresholds of vehicle detection."""

from __future__ import annotations

from dataclasses import dataclass

from ..settings import Checked, setting


@dataclass(frozen=True)
class DetectorConfig(Checked):
    """Vehicle boxes from a YOLO network (chapter 5). They decide a run only through the boxes they give."""

    size: int = setting(
        0,
        "longer side of the network's image, where the model leaves it open; 0: the one it was made for",
        unit="px",
        low=0,
        high=4096,
    )
    score: float = setting(0.25, "boxes scored lower are not reported", low=0.001, high=1)
    nms: float = setting(
        0.5, "of two boxes of one class that overlap more (IoU) the better stays", low=0.05, high=1
    )
    classes: tuple[str, ...] = setting(
        ("car", "bus", "truck"), "classes reported, by name or COCO number; none given: every class"
    )
    threads: int = setting(1, "processor threads of the network", low=1, high=64)
