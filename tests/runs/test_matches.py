"""The match cache: equality with computed matches, keys, and damaged files."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from pathlib import Path

import pytest
from conftest import small, write_bands

from vo_lib import Sequence, open_sequence, preset, run
from vo_lib.paper.settings import MethodConfig
from vo_lib.runs.drive import run_methods
from vo_lib.runs.front_end import TimedMatches, find_matches
from vo_lib.runs.match_cache import CachedMatches

FRAMES = 12


@pytest.fixture
def sequence(tmp_path: Path) -> Sequence:
    """Twelve frames."""
    return open_sequence(write_bands(tmp_path / "bands", frames=FRAMES))


def cached(sequence: Sequence, config: MethodConfig) -> CachedMatches:
    return CachedMatches(sequence, config, sequence.folder.parent / "cache")


def matches_of(source: Iterable[TimedMatches]) -> list[tuple[object, bytes]]:
    return [(column.dtype, column.tobytes()) for matches, _ in source for column in vars(matches).values()]


@pytest.mark.parametrize("config", [small(), preset("solution_selection")], ids=["kit", "published"])
def test_cached_matches_equal_computed_ones(sequence: Sequence, config: MethodConfig) -> None:
    images = matches_of(find_matches(sequence, config))
    assert matches_of(cached(sequence, config)) == images
    assert matches_of(cached(sequence, config)) == images
    again = run_methods(sequence, {"": config}, matches=cached(sequence, config))[""].poses
    assert run(sequence, config).poses.tobytes() == again.tobytes()


def test_cache_key_covers_all_inputs_of_matches(sequence: Sequence, monkeypatch: pytest.MonkeyPatch) -> None:
    path = cached(sequence, small()).path
    assert cached(sequence, small(selection__sets=50, seed=3)).path == path
    camera = dataclasses.replace(sequence.camera, baseline=0.6)
    others = [
        cached(sequence, small(matching__window=11)),
        cached(sequence, small(features__quality=4.0)),
        cached(sequence, preset("solution_selection")),
        cached(dataclasses.replace(sequence, camera=camera), small()),
        cached(sequence.part(0, 6), small()),
    ]
    with monkeypatch.context() as patch:
        patch.setattr("vo_lib.runs.identity.code_digest", lambda modules: "other")
        others.append(cached(sequence, small()))
    (sequence.folder / "image_1" / "000007.png").write_bytes(b"another image")
    others.append(cached(sequence, small()))
    assert len({path, *(each.path for each in others)}) == 1 + len(others)


@pytest.mark.parametrize("damage", ["flip", "cut", "foreign", "missing"])
def test_damaged_cache_files_are_replaced(sequence: Sequence, damage: str) -> None:
    matches = matches_of(cached(sequence, small()))
    path = cached(sequence, small()).path
    data = path.read_bytes()
    middle = len(data) // 2
    flipped = data[:middle] + bytes([data[middle] ^ 4]) + data[middle + 1 :]
    broken = {"flip": flipped, "cut": data[:-9], "foreign": b"PK of another kind"}
    path.write_bytes(broken[damage]) if damage in broken else path.unlink()
    assert matches_of(cached(sequence, small())) == matches
    assert matches_of(cached(sequence, small())) == matches_of(find_matches(sequence, small()))
