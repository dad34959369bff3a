"""Values of the presets, with the source of each value in the paper."""

from __future__ import annotations

import json
from functools import reduce
from pathlib import Path
from typing import Any

import pytest

from vo_lib import preset
from vo_lib.config import CONFIG_CLASSES, METHODS, VARIANTS
from vo_lib.detection.settings import DetectorConfig
from vo_lib.kit.settings import KitConfig
from vo_lib.paper.settings import PublishedConfig
from vo_lib.settings import declared

# All defaults. A change of a default is made there too, and the results are measured again.
DEFAULTS = Path(__file__).with_name("defaults.json")
# Settings that distinguish the methods of Table 1: the reason, and the value of each preset.
ORDER = ("viso2", "mesvo_f", "solution_selection", "feature_selection", "moving_selection")
DECISIVE: dict[str, tuple[str, tuple[Any, ...]]] = {
    "estimator": (
        "VISO2 minimises the reprojection error; the others take the rotation from the essential matrix",
        ("reprojection", "essential", "essential", "essential", "essential"),
    ),
    "selection.prior": (
        "section 2.2: nearness to the previous essential vector is what solution selection adds to MESVO_F",
        (None, False, True, True, True),
    ),
    "selection.winner": (
        "the abstract: RANSAC, which counts inliers, is the usual method; section 2.2 speaks of an error",
        (None, "inliers", "error", "error", "error"),
    ),
    "filter.rule": (
        "section 3: feature selection removes features in boxes; moving_selection only in moving boxes",
        ("none", "none", "none", "all", "moving"),
    ),
    "buckets.features": ("StereoScan keeps 2 of a bucket, the others 3", (2, 3, 3, 3, 3)),
}


def flat(config: Any) -> dict[str, Any]:
    """All settings of a configuration by their dotted names."""
    return {item.name: reduce(getattr, item.name.split("."), config) for item in declared(type(config))}


def test_methods_are_those_of_table_1() -> None:
    assert METHODS == ORDER


@pytest.mark.parametrize("variant", VARIANTS)
def test_presets_have_only_the_papers_choices(variant: str) -> None:
    default = flat(CONFIG_CLASSES[variant]())
    for number, method in enumerate(ORDER):
        if method in VARIANTS[variant]:
            settings = flat(preset(method, variant=variant))
            assert {name for name in settings if settings[name] != default[name]} <= set(DECISIVE)
            for name, (reason, values) in DECISIVE.items():
                if values[number] is not None:  # VISO2 has no essential matrix
                    assert settings[name] == values[number], (method, reason)


@pytest.mark.parametrize(
    "config", [PublishedConfig(), KitConfig(), DetectorConfig()], ids=lambda c: type(c).__name__
)
def test_defaults_are_unchanged(config: Any) -> None:
    kept = json.loads(DEFAULTS.read_text(encoding="utf-8"))
    assert json.loads(json.dumps(flat(config))) == kept[type(config).__name__]


@pytest.mark.parametrize("method", ORDER)
def test_seed_is_the_only_change(method: str) -> None:
    assert flat(preset(method, seed=7, variant="kit")) == flat(preset(method, variant="kit")) | {"seed": 7}
