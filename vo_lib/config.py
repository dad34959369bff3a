"""The systems of Table 1 by name, as published and the kit's way; the rooms declare the thresholds."""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Mapping
from typing import Any, Literal, TypeVar, overload

from .baseline.config import PublishedConfig, ReprojectionConfig
from .beyond.config import (
    CalibrationConfig,
    Config,
    FilterConfig,
    MovingConfig,
    SelectionConfig,
    TranslationConfig,
)
from .core import settings
from .core.errors import DataError
from .core.vehicle import VehicleConfig
from .detection.config import DetectorConfig
from .front_end.config import FeatureConfig, MatchingConfig
from .method import config as method
from .method.config import BucketConfig

__all__ = [
    "METHODS",
    "PUBLISHED",
    "VARIANTS",
    "BucketConfig",
    "CalibrationConfig",
    "Config",
    "DetectorConfig",
    "FeatureConfig",
    "FilterConfig",
    "MatchingConfig",
    "MovingConfig",
    "PublishedConfig",
    "ReprojectionConfig",
    "SelectionConfig",
    "TranslationConfig",
    "VehicleConfig",
    "change",
    "config_class",
    "preset",
]

AnyConfig = TypeVar("AnyConfig", bound=PublishedConfig)

# StereoScan keeps two features a bucket.
VISO2_BUCKETS = BucketConfig(features=2)


def _published(prior: bool, rule: str) -> PublishedConfig:
    return PublishedConfig(
        selection=method.SelectionConfig(prior=prior), filter=method.FilterConfig(rule=rule)
    )


def _kit(prior: bool, rule: str) -> Config:
    return Config(selection=SelectionConfig(prior=prior), filter=FilterConfig(rule=rule))


PUBLISHED: dict[str, PublishedConfig] = {
    "viso2": PublishedConfig(
        estimator="reprojection", buckets=VISO2_BUCKETS, filter=method.FilterConfig(rule="none")
    ),
    "mesvo_f": _published(prior=False, rule="none"),
    "solution_selection": _published(prior=True, rule="none"),
    "feature_selection": _published(prior=True, rule="all"),
}
METHODS: dict[str, Config] = {
    "viso2": Config(estimator="reprojection", buckets=VISO2_BUCKETS, filter=FilterConfig(rule="none")),
    "mesvo_f": _kit(prior=False, rule="none"),
    "solution_selection": _kit(prior=True, rule="none"),
    "feature_selection": _kit(prior=True, rule="all"),
    "moving_selection": _kit(prior=True, rule="moving"),
}
VARIANTS: dict[str, Mapping[str, PublishedConfig]] = {"published": PUBLISHED, "kit": METHODS}


@overload
def preset(method: str, *, variant: Literal["kit"] = "kit", seed: int = 0) -> Config: ...


@overload
def preset(method: str, *, variant: str, seed: int = 0) -> PublishedConfig: ...


def preset(method: str, *, variant: str = "kit", seed: int = 0) -> PublishedConfig:
    """The configuration of a method of Table 1, as `published` or the `kit`'s way, with a seed.

    Raises `DataError` for an unknown name, with the nearest known one.
    """
    config_class(variant)
    methods = VARIANTS[variant]
    if method in METHODS and method not in methods:
        raise DataError(f"{method} is the kit's own: the paper has {', '.join(methods)}")
    if method not in methods:
        near = difflib.get_close_matches(method, methods, n=1, cutoff=0.3)
        hint = f"did you mean {near[0]}? " if near else ""
        raise DataError(f"unknown method {method!r}: {hint}the methods are {', '.join(methods)}")
    return dataclasses.replace(methods[method], seed=seed)


def config_class(variant: str) -> type[PublishedConfig]:
    """The settings class of a variant; `DataError` for an unknown one."""
    if variant not in VARIANTS:
        raise DataError(f"unknown variant {variant!r}: expected one of {', '.join(VARIANTS)}")
    return Config if variant == "kit" else PublishedConfig


def change(config: AnyConfig, name: str, value: Any) -> AnyConfig:
    """A copy of a configuration with one setting changed by its dotted name, checked.

    Raises `DataError` for a name or value that there is not; what is the kit's own is named as that where the
    configuration is `published`.
    """
    try:
        changed: AnyConfig = settings.replace(config, name, value)
    except DataError:
        if isinstance(config, Config):
            raise
        settings.replace(METHODS["viso2"], name, value)  # no value of the kit's either: says so
        raise DataError(f"{name} {value}: the kit's own; `published` is the paper and no more") from None
    return changed
