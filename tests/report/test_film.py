"""The film of a run: an image per motion, with features, boxes and path."""

from __future__ import annotations

import subprocess
import sys
import weakref
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import find_browser
from playwright.sync_api import sync_playwright

from vo_lib import preset, run
from vo_lib.commands.cli import main
from vo_lib.data.catalogue import open_sequence
from vo_lib.geometry.boxes import no_boxes
from vo_lib.geometry.types import Image
from vo_lib.paper.box_removal import Removal
from vo_lib.report import film as film_module
from vo_lib.report.film import (
    MAP_MARGIN_PX,
    PATH_WIDTH_PX,
    WORDS_HEIGHT_PX,
    Film,
    film_frames,
    poster,
    round_length,
)
from vo_lib.report.plots import METHOD_COLOURS, REMOVED, TRUTH_COLOUR, bgr
from vo_lib.report.webm import FILM_MARK, MOST_WAITING, webm_file

PATH_COLOUR = bgr(METHOD_COLOURS["feature_selection"])


def near(picture: Image, colour: tuple[int, int, int], tolerance: int = 0) -> int:
    return int(np.count_nonzero((np.abs(picture.astype(int) - colour) <= tolerance).all(axis=2)))


def test_film_has_the_same_bytes_from_cached_matches(bands: Path, capsys: pytest.CaptureFixture[str]) -> None:
    base = bands.parent
    command = ["run", str(bands), "--out", str(base / "out"), "--video"]
    assert main([*command, str(base / "a.webm")]) == 0
    assert str(base / "a.webm") in capsys.readouterr().out
    assert main([*command, str(base / "b.webm"), "--keep-matches", "--cache", str(base / "cache")]) == 0
    assert list((base / "cache").rglob("*.npz"))
    assert (base / "a.webm").read_bytes() == (base / "b.webm").read_bytes()
    video = cv2.VideoCapture(str(base / "a.webm"))
    # An image of 480×240, a square for the path beside it, words above.
    expected = (5, 10, 480 + 300, 300 + WORDS_HEIGHT_PX)
    kinds = cv2.CAP_PROP_FRAME_COUNT, cv2.CAP_PROP_FPS, cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT
    assert tuple(map(video.get, kinds)) == expected
    assert sum(video.read()[0] for _ in range(9)) == 5


@pytest.mark.parametrize("variant", ["kit", "published"])
def test_film_shows_path_and_removed_features(bands: Path, variant: str) -> None:
    (bands / "labels").mkdir()
    (bands / "labels" / "000003.txt").write_text("2 0.5 0.5 0.5 0.5 0.9\n", encoding="utf-8")
    result = run(open_sequence(bands), preset("feature_selection", variant=variant))
    with Film(bands.parent / "film.webm", result, "mine") as film:
        pictures = {shown.index: film.picture(shown) for shown in film_frames(result)}
    assert list(pictures) == [1, 2, 3, 4, 5]
    words, image = slice(WORDS_HEIGHT_PX), (slice(WORDS_HEIGHT_PX, WORDS_HEIGHT_PX + 240), slice(480))
    for colour in map(bgr, (METHOD_COLOURS["feature_selection"], TRUTH_COLOUR)):
        drawn = [near(picture[WORDS_HEIGHT_PX:, 480:], colour, 60) for picture in pictures.values()]
        assert drawn == sorted(drawn)
        assert drawn[-1] > 3 * drawn[0] > 0
    assert near(pictures[3][image], REMOVED) > 0 == near(pictures[5][image], REMOVED)
    assert all(picture[words].std() > 5 for picture in pictures.values())


FULL_DISK = """
import resource, sys
from pathlib import Path
from vo_lib import open_sequence, preset, run
from vo_lib.report.film import Film, film_frames

result = run(open_sequence(sys.argv[1]), preset("solution_selection"))
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))  # no file may be larger: as on a full disk
with Film(Path(sys.argv[2]), result, "mine") as film:
    for shown in film_frames(result):
        film.add(shown)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no limit for the size of files")
def test_film_on_a_full_disk_is_an_error_and_the_earlier_film_stays(bands: Path) -> None:
    place = bands.parent / "films"
    place.mkdir()
    film = place / "film.webm"
    film.write_bytes(FILM_MARK)
    words = [sys.executable, "-c", FULL_DISK, str(bands), str(film)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert "film.webm: cannot be written" in done.stderr
    assert [path.name for path in place.iterdir()] == ["film.webm"]
    assert film.read_bytes() == FILM_MARK


FULL_AFTER_ENCODING = """
import resource, sys
from pathlib import Path
import numpy as np
from vo_lib.report.webm import webm_file

with webm_file(Path(sys.argv[1]), 64, 48, 10) as pictures:
    pictures.add(np.zeros((48, 64, 3), np.uint8))
    pictures.finish()
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no limit for the size of files")
def test_a_disk_that_fills_up_at_the_end_of_a_film_is_an_error_of_writing(tmp_path: Path) -> None:
    film = tmp_path / "film.webm"
    words = [sys.executable, "-c", FULL_AFTER_ENCODING, str(film)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.stderr.endswith(f"{film}: cannot be written: File too large\n")
    assert "cannot be read" not in done.stderr
    assert not list(tmp_path.iterdir())


def test_film_that_is_interrupted_leaves_nothing(bands: Path) -> None:
    result = run(open_sequence(bands), preset("solution_selection"))
    place = bands.parent / "films"
    place.mkdir()
    shown = next(film_frames(result))
    with suppress(KeyboardInterrupt), Film(place / "film.webm", result, "mine") as film:
        film.add(shown)
        assert list(place.iterdir())
        raise KeyboardInterrupt
    assert not list(place.iterdir())


def test_film_of_a_wide_camera_shrinks_image_and_features_alike(bands: Path) -> None:
    result = run(open_sequence(bands), preset("solution_selection"))
    shown = next(film_frames(result))
    removed = shown.matches[np.array([0])]
    at = replace(removed, prev_left=np.array([[200.0, 100.0]]), cur_left=np.array([[200.0, 100.0]]))
    one = replace(shown, matches=at, removal=Removal(np.array([False]), no_boxes()))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(film_module, "MAX_IMAGE_WIDTH_PX", 240)  # half of the width of these images
        picture = Film(bands.parent / "film.webm", result, "mine").picture(one)
    assert picture.shape == (300 + WORDS_HEIGHT_PX, 240 + 300, 3)
    rows, columns = np.nonzero((picture[WORDS_HEIGHT_PX:, :240] == REMOVED).all(axis=2))
    assert (columns.mean(), rows.mean()) == pytest.approx((99.75, 49.75), abs=0.5)


@pytest.mark.parametrize(
    ("most", "length"), [(1.0, 1), (1.99, 1), (2.0, 2), (4.9, 2), (5, 5), (12, 10), (999, 500), (0.3, 0.2)]
)
def test_scale_has_a_round_length(most: float, length: float) -> None:
    assert round_length(most) == pytest.approx(length)


def test_scale_of_the_map_is_as_long_as_it_says(bands: Path) -> None:
    """A straight path of 30 m is three times as long on the map as the line of 10 m above it."""
    result = run(open_sequence(bands), preset("solution_selection"))
    poses = np.tile(np.eye(4), (6, 1, 1))
    poses[:, 0, 3] = np.linspace(0.0, 30.0, 6)  # to the right
    still = replace(result, poses=poses, sequence=replace(result.sequence, truth=None))
    *_, shown = film_frames(result)
    picture = Film(bands.parent / "film.webm", still, "mine").picture(shown)
    row = (picture[WORDS_HEIGHT_PX + MAP_MARGIN_PX // 2, 480:] == 0).all(axis=1)  # of the line and its number
    line = int(np.argmin(row[np.argmax(row) :]))
    path_columns = np.nonzero((picture[WORDS_HEIGHT_PX:, 480:] == PATH_COLOUR).all(axis=2).any(axis=0))[0]
    assert np.ptp(path_columns) == pytest.approx(3 * line + PATH_WIDTH_PX, abs=6)


def test_memory_does_not_grow_with_the_frames(tmp_path: Path) -> None:
    """While an encoder is slow, at most `MOST_WAITING` pictures and the one in work are kept."""
    pictures = list[weakref.ref[Image]]()
    most = 0
    with webm_file(tmp_path / "film.webm", 64, 48, 10) as encoder:
        for _ in range(60):
            picture = np.zeros((48, 64, 3), np.uint8)
            pictures.append(weakref.ref(picture))
            encoder.add(picture)
            del picture
            most = max(most, sum(each() is not None for each in pictures))
    assert most <= MOST_WAITING + 2
    assert cv2.VideoCapture(str(tmp_path / "film.webm")).get(cv2.CAP_PROP_FRAME_COUNT) == 60


def test_webm_is_read_by_another_program(tmp_path: Path) -> None:
    """FFmpeg finds every frame at its time, and each picture as it was."""
    with webm_file(tmp_path / "film.webm", 64, 48, 10) as encoder:
        for value in range(0, 250, 10):
            encoder.add(np.full((48, 64, 3), value, np.uint8))
    video = cv2.VideoCapture(str(tmp_path / "film.webm"))
    assert (video.get(cv2.CAP_PROP_FRAME_COUNT), video.get(cv2.CAP_PROP_FPS)) == (25, 10)
    for number in range(25):
        found, picture = video.read()
        assert found
        assert video.get(cv2.CAP_PROP_POS_MSEC) == pytest.approx(100 * number)
        assert picture.mean() == pytest.approx(10 * number, abs=4)


def test_poster_is_the_middle_of_the_film(tmp_path: Path) -> None:
    with webm_file(tmp_path / "film.webm", 64, 48, 10) as encoder:
        for value in range(0, 250, 10):
            encoder.add(np.full((48, 64, 3), value, np.uint8))
    picture = cv2.imdecode(np.frombuffer(poster(tmp_path / "film.webm"), np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    assert picture.mean() == pytest.approx(120, abs=5)
    (tmp_path / "damaged.webm").write_bytes(b"no film")
    assert poster(tmp_path / "damaged.webm") == b""


PLAY = """async video => {
    video.muted = true;
    await video.play();
    const times = new Set();  // that a person sees while it plays
    video.ontimeupdate = () => times.add(video.currentTime);
    await new Promise(resolve => video.onended = resolve);
    if (times.size < 4) return ["the film did not advance", ...times];
    for (const seconds of [2.0, 0.5]) {
        video.currentTime = seconds;
        await new Promise(resolve => { video.onseeked = video.onerror = resolve; });
    }
    video.currentTime = video.duration;
    await new Promise(resolve => { video.onseeked = video.onerror = resolve; });
    return [video.error && video.error.message, video.currentTime, video.videoWidth];
}"""


@pytest.mark.slow  # the browser, which .ci/run installs meanwhile
def test_browser_plays_a_film(bands: Path) -> None:
    browser = find_browser()
    if browser is None:
        pytest.skip("no Chromium or Chrome is installed")
    folder = bands.parent / "films"
    folder.mkdir()
    result = run(open_sequence(bands), preset("solution_selection"))
    with Film(folder / "film.webm", result, "mine") as film:
        for shown in 6 * list(film_frames(result)):  # long enough for a second key frame
            film.add(shown)
    assert [path.name for path in folder.iterdir()] == ["film.webm"]
    (folder / "page.html").write_text("<video src=film.webm></video>", encoding="utf-8")
    with sync_playwright() as play:
        opened = play.chromium.launch(executable_path=browser, args=["--no-sandbox"])
        page = opened.new_page()
        page.goto((folder / "page.html").as_uri())
        # Thirty frames at ten a second.
        assert page.eval_on_selector("video", PLAY) == [None, 3, 780]
        opened.close()


@pytest.mark.parametrize("length", [10, 80, 300])
def test_a_long_label_leaves_room_for_the_numbers(bands: Path, length: int) -> None:
    result = run(open_sequence(bands), preset("solution_selection"))
    *_, shown = film_frames(result)
    inked = []
    for label in ("", ("a_name_of_the_north_road_" * 20)[:length]):
        picture = Film(bands.parent / "film.webm", result, label).picture(shown)
        words = (picture[:WORDS_HEIGHT_PX] == 0).all(axis=2)
        assert not words[:, -4:].any()  # nothing runs off the picture
        inked.append(words[: WORDS_HEIGHT_PX // 3].sum())
    assert inked[1] >= inked[0]  # the numbers are all there, behind the label
