"""The systems of Table 1 by name, in the variants `published` and `kit`."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, Literal, TypeVar, overload

from . import settings
from .errors import DataError, did_you_mean
from .kit.settings import KitConfig, KitFilterConfig, KitSelectionConfig
from .paper.settings import BucketConfig, FilterConfig, MethodConfig, PublishedConfig, SelectionConfig

AnyConfig = TypeVar("AnyConfig", bound=MethodConfig)

# StereoScan keeps two features per bucket.
VISO2_BUCKETS = BucketConfig(features=2)
# RANSAC takes the candidate with the most inliers; no prior limits the candidates.
RANSAC: dict[str, Any] = {"prior": False, "winner": "inliers"}


def _published(rule: str, **selection: Any) -> PublishedConfig:
    """A published method with the essential matrix, by its box rule and its settings of the selection."""
    return PublishedConfig(selection=SelectionConfig(**selection), filter=FilterConfig(rule=rule))


def _kit(rule: str, **selection: Any) -> KitConfig:
    """The same in variant `kit`."""
    return KitConfig(selection=KitSelectionConfig(**selection), filter=KitFilterConfig(rule=rule))


PUBLISHED: dict[str, PublishedConfig] = {
    "viso2": PublishedConfig(
        estimator="reprojection", buckets=VISO2_BUCKETS, filter=FilterConfig(rule="none")
    ),
    "mesvo_f": _published("none", **RANSAC),
    "solution_selection": _published("none"),
    "feature_selection": _published("all"),
}
KIT: dict[str, KitConfig] = {
    "viso2": KitConfig(estimator="reprojection", buckets=VISO2_BUCKETS, filter=KitFilterConfig(rule="none")),
    "mesvo_f": _kit("none", **RANSAC),
    "solution_selection": _kit("none"),
    "feature_selection": _kit("all"),
    "moving_selection": _kit("moving"),
}
VARIANTS: dict[str, Mapping[str, MethodConfig]] = {"published": PUBLISHED, "kit": KIT}
CONFIG_CLASSES: dict[str, type[MethodConfig]] = {"published": PublishedConfig, "kit": KitConfig}
# The settings of both variants by dotted name; of a name that both have, the kit's.
SETTINGS = {item.name: item for cls in CONFIG_CLASSES.values() for item in settings.declared(cls)}
METHODS = tuple(KIT)  # the paper's four methods and moving_selection, which only variant `kit` has


@overload
def preset(method: str, *, variant: Literal["published"] = "published", seed: int = 0) -> PublishedConfig: ...


@overload
def preset(method: str, *, variant: Literal["kit"], seed: int = 0) -> KitConfig: ...


@overload
def preset(method: str, *, variant: str, seed: int = 0) -> MethodConfig: ...


def preset(method: str, *, variant: str = "published", seed: int = 0) -> MethodConfig:
    """Configuration of a method of Table 1 with a seed. The variant is `published` (the paper) or `kit`.

    An unknown name raises `DataError` with the nearest valid name.
    """
    config_class(variant)  # refuses an unknown variant
    methods = VARIANTS[variant]
    if method in METHODS and method not in methods:
        raise DataError(f"{method} is not in the paper, only in variant kit: add --variant kit")
    if method not in methods:
        near = did_you_mean(method, methods)
        raise DataError(f"unknown method {method!r}: {near}the methods are {', '.join(methods)}")
    return dataclasses.replace(methods[method], seed=seed)


def config_class(variant: str) -> type[MethodConfig]:
    """The settings class of a variant; `DataError` for an unknown variant."""
    if variant not in CONFIG_CLASSES:
        raise DataError(f"unknown variant {variant!r}: expected one of {', '.join(VARIANTS)}")
    return CONFIG_CLASSES[variant]


def change(config: AnyConfig, name: str, value: Any) -> AnyConfig:
    """A copy of a configuration in which the setting with this dotted name has a new, checked value.

    Raises `DataError` for an unknown name, with the nearest valid one, or for a value out of range.
    """
    changed: AnyConfig = settings.replace(config, name, value)
    return changed
