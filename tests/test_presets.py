"""Values of the presets, with the source of each value in the paper."""

from __future__ import annotations

import json
from functools import reduce
from pathlib import Path
from typing import Any

import pytest
from conftest import with_box, write_bands

from vo_lib import DataError, open_sequence, preset, run
from vo_lib.config import CONFIG_CLASSES, METHODS, VARIANTS, change
from vo_lib.detection.settings import DetectorConfig
from vo_lib.kit.settings import KitConfig
from vo_lib.paper.settings import PublishedConfig
from vo_lib.settings import Checked, declared, unused_because

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


def test_error_of_a_value_names_the_values_of_the_own_variant() -> None:
    with pytest.raises(DataError, match=r"filter\.rule: 'foo' is not one of none, all$"):
        change(preset("feature_selection"), "filter.rule", "foo")
    with pytest.raises(DataError, match=r"filter\.rule: 'foo' is not one of none, all, moving, truth$"):
        change(preset("feature_selection", variant="kit"), "filter.rule", "foo")
    with pytest.raises(
        DataError,
        match=r"^selection\.sats: did you mean selection\.sets\? expected a setting of PublishedConfig$",
    ):
        change(preset("feature_selection"), "selection.sats", 5)


def test_a_method_of_variant_kit_alone_is_refused_in_one_sentence() -> None:
    with pytest.raises(DataError, match=r"^'moving_selection' is no method of .*: add --variant kit, or"):
        preset("moving_selection")


# Changes of a preset that turn other settings off.
CHANGES: tuple[dict[str, Any], ...] = (
    {},
    {"selection.prior": False},
    {"filter.rule": "none"},
    {"selection.mode": "literal"},
    {"calibration.estimate": False},
)


@pytest.mark.parametrize("changes", CHANGES, ids=str)
@pytest.mark.parametrize(
    ("variant", "method"), [(variant, method) for variant in VARIANTS for method in VARIANTS[variant]]
)
def test_a_run_reads_the_settings_that_are_declared_as_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, variant: str, method: str, changes: dict[str, Any]
) -> None:
    names = [item.name for item in declared(CONFIG_CLASSES[variant])]
    if not changes.keys() <= set(names):
        pytest.skip("the variant has no such setting")
    folder = with_box(write_bands(tmp_path / "bands", 6), 6)
    config = change(preset(method, variant=variant), "min_matches", 5)
    for name, value in ({"features.cell": 10} if variant == "kit" else {"features.blob_cell": 9}).items():
        config = change(config, name, value)
    for name, value in changes.items():
        config = change(config, name, value)
    read = set[tuple[int, str]]()

    def watched(self: Checked, name: str) -> Any:
        read.add((id(self), name))
        return object.__getattribute__(self, name)

    sequence = open_sequence(folder)
    with monkeypatch.context() as patch:
        patch.setattr(Checked, "__getattribute__", watched, raising=False)
        run(sequence, config)
    places = {}
    for name in names:
        *parents, last = name.split(".")
        places[name] = id(reduce(getattr, parents, config)), last
    unused = {name for name in names if unused_because(config, name)}
    # Read without an effect on the path: boxes for films, and the ratio if all candidates compete.
    harmless = {"filter.margin", "filter.classes", "filter.score", "selection.prior_rejection_ratio"}
    assert {name for name in names if places[name] not in read} - harmless == unused - harmless
