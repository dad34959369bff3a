"""The systems of Table 1 by name, in the variants `published` and `kit`."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, Literal, TypeVar, cast, overload

from . import settings
from .errors import DataError, did_you_mean
from .kit.settings import KitConfig, KitFilterConfig, KitSelectionConfig
from .paper.settings import BucketConfig, FilterConfig, MethodConfig, PublishedConfig, SelectionConfig

AnyConfig = TypeVar("AnyConfig", bound=MethodConfig)

# VISO2 minimises the reprojection error, and StereoScan keeps two features per bucket.
VISO2: dict[str, Any] = {"estimator": "reprojection", "buckets": BucketConfig(features=2)}
# RANSAC takes the candidate with the most inliers; no prior limits the candidates.
RANSAC: dict[str, Any] = {"prior": False, "winner": "inliers"}

PUBLISHED: dict[str, PublishedConfig] = {
    "viso2": PublishedConfig(filter=FilterConfig(rule="none"), **VISO2),
    "mesvo_f": PublishedConfig(filter=FilterConfig(rule="none"), selection=SelectionConfig(**RANSAC)),
    "solution_selection": PublishedConfig(filter=FilterConfig(rule="none")),
    "feature_selection": PublishedConfig(filter=FilterConfig(rule="all")),
}
KIT: dict[str, KitConfig] = {
    "viso2": KitConfig(filter=KitFilterConfig(rule="none"), **VISO2),
    "mesvo_f": KitConfig(filter=KitFilterConfig(rule="none"), selection=KitSelectionConfig(**RANSAC)),
    "solution_selection": KitConfig(filter=KitFilterConfig(rule="none")),
    "feature_selection": KitConfig(filter=KitFilterConfig(rule="all")),
    "moving_selection": KitConfig(filter=KitFilterConfig(rule="moving")),
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
    if variant not in VARIANTS:
        raise DataError(f"unknown variant {variant!r}: expected one of {', '.join(VARIANTS)}")
    methods = VARIANTS[variant]
    if method not in methods:
        near = "add --variant kit, or " if method in METHODS else did_you_mean(method, methods)
        raise DataError(f"{method!r} is no method of variant {variant}: {near}choose {', '.join(methods)}")
    return dataclasses.replace(methods[method], seed=seed)


def change(config: AnyConfig, name: str, value: Any) -> AnyConfig:
    """A copy of a configuration in which the setting with this dotted name has a new, checked value.

    Raises `DataError` for an unknown name, with the nearest valid one, or for a value out of range.
    """
    return cast(AnyConfig, settings.replace(config, name, value))
