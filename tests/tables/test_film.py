"""The film of a run: a frame for each motion, with the features, the boxes and the path so far."""

from __future__ import annotations

import json
import re
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import BANDS, BASELINE, FOCAL

from vo_lib import Run, preset, run
from vo_lib.commands.cli import main
from vo_lib.core.errors import DataError
from vo_lib.core.files import claim
from vo_lib.core.types import Image
from vo_lib.data.sequence import open_sequence
from vo_lib.tables.film import PATH, STRIP, TRUTH, Film, shown_frames
from vo_lib.tables.plots import REMOVED

SMALL = ["--features.cell", "10"]


def near(picture: Image, colour: tuple[int, int, int], tolerance: int = 0) -> int:
    return int(np.count_nonzero((np.abs(picture.astype(int) - colour) <= tolerance).all(axis=2)))


def test_a_run_writes_a_film_the_same_again_and_from_kept_matches(
    bands: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    base = bands.parent
    command = ["run", str(bands), "--out", str(base / "out"), *SMALL, "--video"]
    assert main([*command, str(base / "a.mp4")]) == 0
    assert str(base / "a.mp4") in capsys.readouterr().out
    assert main([*command, str(base / "b.mp4"), "--cache", str(base / "cache")]) == 0
    assert (base / "a.mp4").read_bytes() == (base / "b.mp4").read_bytes()
    video = cv2.VideoCapture(str(base / "a.mp4"))
    # Images of 480×240 are shown at twice their size, a square for the path beside them, words below.
    wanted = (5, 10, 960 + 480, 480 + STRIP)
    kinds = cv2.CAP_PROP_FRAME_COUNT, cv2.CAP_PROP_FPS, cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT
    assert tuple(map(video.get, kinds)) == wanted
    assert sum(video.read()[0] for _ in range(9)) == 5


@pytest.mark.parametrize("variant", ["kit", "published"])
def test_the_path_grows_and_removed_features_are_orange(bands: Path, variant: str) -> None:
    (bands / "labels").mkdir()
    (bands / "labels" / "000003.txt").write_text("2 0.5 0.5 0.5 0.5 0.9\n", encoding="utf-8")
    result = run(open_sequence(bands), preset("feature_selection", variant=variant))
    with Film(bands.parent / "film.avi", result, "mine") as film:
        pictures = {shown.index: film.picture(shown) for shown in shown_frames(result)}
    assert list(pictures) == [1, 2, 3, 4, 5]
    image, words = (slice(None, 480), slice(None, 960)), (slice(480, None),)
    for colour in (PATH, TRUTH):
        drawn = [near(picture[:480, 960:], colour, 60) for picture in pictures.values()]
        assert drawn == sorted(drawn)
        assert drawn[-1] > 3 * drawn[0] > 0
    assert near(pictures[3][image], REMOVED) > 0 == near(pictures[5][image], REMOVED)
    assert all(picture[words].std() > 5 for picture in pictures.values())


def test_the_view_has_the_points_at_their_depths_and_needs_nothing_else(bands: Path) -> None:
    page = bands.parent / "view.html"
    assert main(["run", str(bands), "--out", str(bands.parent / "out"), *SMALL, "--view", str(page)]) == 0
    text = page.read_text(encoding="utf-8")
    assert "http" not in text
    found = re.search(r'= (\{"points.*\});', text)
    assert found is not None
    data = json.loads(found[1])
    depth = np.reshape(data["points"], (-1, 3))[:, 2] / 100  # written in centimetres
    assert len(depth) == len(data["grey"]) > 50
    # A point appears in the frame that saw it last, of six frames in half a second.
    assert {*data["seen"]} == {1, 2, 3, 4, 5}
    assert data["times"][-1] == 0.5
    # Bands farther than 50 baselines of 0.5 m are left out.
    bands_at = np.array([FOCAL * BASELINE / d for d in BANDS if FOCAL / d < 50])
    assert np.median(np.abs(depth[:, None] - bands_at).min(axis=1)) < 0.2
    (_, truth), (_, path) = data["lines"]
    np.testing.assert_allclose(truth[-1], [2.5, 0.0, 0.0])
    np.testing.assert_allclose(path[-1], truth[-1], atol=0.1)


def write_film(place: Path, result: Run) -> None:
    with Film(place, result, "mine") as film:
        for shown in shown_frames(result):
            film.add(shown)


def test_a_film_that_fails_leaves_nothing(bands: Path) -> None:
    result = run(open_sequence(bands), preset("viso2"))
    before = set(bands.parent.iterdir())
    with suppress(KeyError), Film(bands.parent / "film.mp4", result, "mine") as film:
        film.add(next(iter(shown_frames(result))))
        raise KeyError
    assert set(bands.parent.iterdir()) == before


@pytest.mark.parametrize("name", ["film.mp4", "film.avi"])
def test_a_film_on_a_full_disk_is_no_film_and_the_old_one_stays(bands: Path, name: str) -> None:
    resource = pytest.importorskip("resource")
    result, place = run(open_sequence(bands), preset("viso2")), bands.parent / name
    claim(place)
    place.write_bytes(b"an older one")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (6000, limits[1]))  # a write beyond fails, as on a full disk
    try:
        with pytest.raises(DataError, match="is the disk full"):
            write_film(place, result)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert place.read_bytes() == b"an older one"
    assert {path.name for path in bands.parent.glob("[!.]*")} == {bands.name, name}
