"""Matches from the cache are those from the images, to the last bit; whatever is damaged is made anew."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from conftest import small, write_bands

from vo_lib import Sequence, open_sequence, run
from vo_lib.config import Config
from vo_lib.core.matches import StereoMatches, empty_matches
from vo_lib.runs.match_cache import CachedMatches, pack, unpack
from vo_lib.runs.runner import FoundMatches, run_methods

FRAMES = 12
CHUNK = 5


@pytest.fixture
def sequence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Sequence:
    """Twelve frames, kept five to a file."""
    monkeypatch.setattr("vo_lib.runs.match_cache.CHUNK", CHUNK)
    return open_sequence(write_bands(tmp_path / "bands", frames=FRAMES))


def cached(sequence: Sequence, config: Config) -> CachedMatches:
    return CachedMatches(sequence, config.features, config.matching, sequence.folder.parent / "cache")


def all_bytes(frames: list[StereoMatches]) -> list[bytes]:
    return [getattr(f, item.name).tobytes() for f in frames for item in dataclasses.fields(f)]


def matches_of(source: CachedMatches | FoundMatches) -> list[StereoMatches]:
    return [matches for matches, _ in source]


def test_matches_and_poses_are_the_same_bytes_with_and_without_the_cache(sequence: Sequence) -> None:
    config = small()
    found = matches_of(FoundMatches(sequence, config.features, config.matching))
    assert all_bytes(matches_of(cached(sequence, config))) == all_bytes(found)
    assert all_bytes(matches_of(cached(sequence, config))) == all_bytes(found)
    again = run_methods(sequence, {"": config}, matches=cached(sequence, config))[""].poses
    assert run(sequence, config).poses.tobytes() == again.tobytes()


def test_the_second_time_no_image_is_decoded(sequence: Sequence, monkeypatch: pytest.MonkeyPatch) -> None:
    cached(sequence, small()).fill()
    monkeypatch.setattr("vo_lib.data.sequence.read_image", None)
    frames = list(cached(sequence, small(selection__sets=50, filter__rule="all")))
    assert len(frames) == FRAMES
    assert all(set(ms) == {"cached_matches"} for _, ms in frames)


def test_front_end_settings_camera_images_and_code_have_a_folder_of_their_own(
    sequence: Sequence, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = cached(sequence, small()).folder
    assert cached(sequence, small(selection__sets=50, seed=3)).folder == folder
    assert cached(sequence, small(matching__window=11)).folder != folder
    assert cached(sequence, small(features__quality=4.0)).folder != folder
    camera = dataclasses.replace(sequence.camera, baseline=0.6)
    assert cached(dataclasses.replace(sequence, camera=camera), small()).folder != folder
    assert cached(sequence.part(0, 6), small()).folder != folder
    with monkeypatch.context() as patch:
        patch.setattr("vo_lib.runs.identity.code_digest", lambda: "changed")
        assert cached(sequence, small()).folder != folder
    (sequence.folder / "image_1" / "000007.png").write_bytes(b"another image")
    assert cached(sequence, small()).folder != folder


def test_two_that_fill_the_same_folder_write_the_same_files(sequence: Sequence) -> None:
    whole = matches_of(FoundMatches(sequence, small().features, small().matching))
    one, other = cached(sequence, small()), cached(sequence, small())
    by_turns = list(zip(one, other, strict=True))
    assert all_bytes([frame[0] for frame, _ in by_turns]) == all_bytes(whole)
    assert all_bytes([frame[0] for _, frame in by_turns]) == all_bytes(whole)
    assert all_bytes(matches_of(cached(sequence, small()))) == all_bytes(whole)


@pytest.mark.parametrize("damage", ["flip", "cut", "zeros", "foreign", "missing"])
@pytest.mark.parametrize("number", [0, 1, 2])
def test_a_damaged_or_missing_file_is_noticed_and_made_anew(
    sequence: Sequence, damage: str, number: int
) -> None:
    whole = matches_of(cached(sequence, small()))
    path = sorted(cached(sequence, small()).folder.glob("*.npz"))[number]
    data = path.read_bytes()
    flipped = bytearray(data)
    flipped[len(data) // 2] ^= 4
    broken = {"flip": bytes(flipped), "cut": data[:-9], "zeros": bytes(4), "foreign": pack([empty_matches()])}
    if damage == "missing":
        path.unlink()
    else:
        path.write_bytes(broken[damage])
    assert all_bytes(matches_of(cached(sequence, small()))) == all_bytes(whole)
    assert path.read_bytes() == data


def test_every_flipped_byte_of_a_file_is_noticed() -> None:
    data = pack([empty_matches()])
    assert len(unpack(data)[0]) == 0
    for place in range(len(data)):
        broken = bytearray(data)
        broken[place] ^= 1
        with pytest.raises(ValueError, match="checksum"):
            unpack(bytes(broken))


def test_numbers_are_kept_exactly_and_small_where_nothing_is_lost() -> None:
    rng = np.random.default_rng(0)
    uv = rng.uniform(0, 1000, (50, 2))
    whole = np.arange(50)

    def matches(uv: np.ndarray, ids: np.ndarray) -> StereoMatches:
        return StereoMatches(uv, uv + 1, uv + 2, uv + 3, whole, uv[:, 0], ids)

    single = uv.astype(np.float32).astype(np.float64)
    for given in (matches(uv, whole), matches(single, whole + 2**40), matches(-0.0 * uv, whole)):
        back = unpack(pack([given, empty_matches(), given]))
        assert all_bytes(back) == all_bytes([given, empty_matches(), given])
    assert len(pack([matches(single, whole)])) < 0.7 * len(pack([matches(uv, whole)]))
