"""Thresholds of the VISO2 baseline, and all of a published run's together."""

from __future__ import annotations

from dataclasses import dataclass

from ..core.settings import Checked, section, setting
from ..core.vehicle import VehicleConfig
from ..method.config import MethodConfig


@dataclass(frozen=True)
class ReprojectionConfig(Checked):
    """The VISO2 estimator: three matches a trial, Gauss-Newton on the reprojection error (StereoScan)."""

    trials: int = setting(200, "motions from three random matches in a frame", low=1, high=5000)
    threshold: float = setting(
        2.0,
        "a match is an inlier below this residual norm over its four current coordinates",
        unit="px",
        low=0.05,
        high=20,
    )
    iterations: int = setting(20, "largest number of Gauss-Newton steps", low=1, high=100)
    centre: float = setting(
        0.05,
        "a residual weighs 1 / (|u - cu| / |cu| + this): smaller, the middle counts more",
        low=1e-3,
        high=100,
    )


@dataclass(frozen=True)
class PublishedConfig(MethodConfig):
    """Everything that decides a run of a system of Table 1 as published, with the images."""

    estimator: str = setting(
        "essential",
        "rotation from the essential matrix, then the translation; or both from the reprojection error",
        choices=("essential", "reprojection"),
    )
    reprojection: ReprojectionConfig = section(ReprojectionConfig)
    vehicle: VehicleConfig = section(VehicleConfig)
