"""Settings that a table changes: which method they concern, where their runs are, what the table says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from vo_lib import DataError, settings
from vo_lib.config import PUBLISHED, change, preset
from vo_lib.report.blocks import (
    Block,
    differences,
    make_blocks,
    parse_axes,
    settings_folder,
)
from vo_lib.report.sweep_table import refuse_unused
from vo_lib.report.table1_plan import job_folder

METHODS = {"published": list(PUBLISHED)}
THRESHOLD = (("selection.threshold", 1.0),)


def test_a_change_concerns_only_the_methods_that_use_it() -> None:
    block = Block("published", THRESHOLD)
    assert block.config("viso2") == preset("viso2")
    assert block.unused("viso2") == {"selection.threshold": "estimator is reprojection"}
    for method in ("mesvo_f", "solution_selection", "feature_selection"):
        assert block.config(method) == change(preset(method), "selection.threshold", 1.0)
    (sentence,) = block.described(PUBLISHED)
    assert sentence == (
        "selection.threshold is 1.0, instead of 0.5; viso2 does not use it, since estimator is reprojection."
    )


def test_a_block_names_the_presets_that_already_have_its_value() -> None:
    (sentence,) = Block("published", (("buckets.features", 2),)).described(PUBLISHED)
    assert sentence == (
        "buckets.features is 2, as in the presets in viso2; instead of 3 in mesvo_f, solution_selection, "
        "feature_selection."
    )
    assert Block("published", (("buckets.features", 2),)).used("viso2") == ()


def test_each_value_makes_a_block() -> None:
    axes = parse_axes(["selection.threshold=0.5,1", "filter.margin=0,0.1"], preset("viso2"))
    blocks = make_blocks(METHODS, (("selection.sets", 50),), axes)
    assert [block.words for block in blocks] == [
        f"selection.sets=50, selection.threshold={threshold}, filter.margin={margin}"
        for threshold in (0.5, 1.0)
        for margin in (0.0, 0.1)
    ]
    # A value on an axis takes the place of that of --config.
    (block,) = make_blocks(METHODS, THRESHOLD, parse_axes(["selection.threshold=2"], preset("viso2")))
    assert block.changes == (("selection.threshold", 2.0),)
    assert make_blocks(METHODS, (), {}) == [Block("published")]


def test_changes_without_effect_or_with_two_equal_methods_are_refused() -> None:
    axes = parse_axes(["filter.margin=0.1"], preset("viso2"))
    with pytest.raises(DataError, match=r"filter\.margin: no method of the table uses this setting"):
        make_blocks({"published": ["viso2", "mesvo_f"]}, (), axes)
    with pytest.raises(DataError, match=r"filter\.margin: mesvo_f does not use this setting"):
        make_blocks({"published": ["mesvo_f"]}, (), axes)
    # Each method has its own reason.
    top_k = parse_axes(["selection.top_k=2"], preset("viso2"))
    reasons = r"since estimator is reprojection \(viso2\), and selection\.prior is off \(mesvo_f\)"
    with pytest.raises(DataError, match=reasons):
        make_blocks({"published": ["viso2", "mesvo_f"]}, (), top_k)
    with pytest.raises(DataError, match=reasons):
        refuse_unused({method: preset(method) for method in ("viso2", "mesvo_f")}, top_k)
    ransac = parse_axes(["selection.prior=off", "selection.winner=inliers"], preset("viso2"))
    with pytest.raises(DataError, match="mesvo_f and solution_selection are the same method"):
        make_blocks(METHODS, (), ransac)
    # Here they differ only in settings that they no longer use.
    viso2 = parse_axes(["estimator=reprojection"], preset("viso2"))
    with pytest.raises(DataError, match="mesvo_f and solution_selection are the same method"):
        make_blocks(METHODS, (), viso2)


def test_loops_use_the_settings_of_the_reprojection_error() -> None:
    axes = parse_axes(["reprojection.threshold=1"], preset("viso2"))
    methods = {"published": ["mesvo_f"]}
    with pytest.raises(DataError, match="does not use"):
        make_blocks(methods, (), axes)
    (block,) = make_blocks(methods, (), axes, loops=True)
    assert block.config("mesvo_f").reprojection.threshold == 1.0


def test_only_other_settings_have_another_folder() -> None:
    def folder(block: Block, method: str) -> Path:
        return job_folder(Path(), block.variant, "kitti/00", method, 0, block.used(method))

    presets = Block("published")
    changed = Block("published", THRESHOLD)
    assert folder(changed, "viso2") == folder(presets, "viso2")
    assert folder(changed, "mesvo_f") != folder(presets, "mesvo_f")
    assert folder(changed, "mesvo_f").parent.name == "selection.threshold=1.0"
    # Names of classes that differ only in letters that a folder's name lacks, or in length.
    names = [
        settings_folder([("filter.classes", classes)])
        for classes in (("a b",), ("a", "b"), ("a_b",), ("x" * 300,), ("x" * 301,))
    ]
    assert len(set(names)) == len(names)
    assert max(map(len, names)) < 120


def test_differences_are_those_of_a_run_from_its_preset() -> None:
    config = change(change(preset("mesvo_f", seed=3), "selection.sets", 10), "min_matches", 20)
    changes = differences(config, preset("mesvo_f"))
    assert dict(changes) == {"selection.sets": 10, "min_matches": 20}
    assert Block("published", changes).config("mesvo_f") == replace(config, seed=0)


@pytest.mark.parametrize("method", PUBLISHED)
def test_every_change_of_a_block_is_used_or_unused(method: str) -> None:
    """For each declared setting: the configuration has the new value, or a reason why it has no effect."""
    usual = preset(method)
    for item in settings.declared(type(usual)):
        if item.kind is not bool or item.name == "seed":
            continue
        value = not settings.value_of(usual, item.name)
        block = Block("published", ((item.name, value),))
        has_new_value = settings.value_of(block.config(method), item.name) == value
        assert has_new_value != bool(block.unused(method)), item.name
