"""The film of a run: an image per motion, with features, boxes and path."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import find_browser
from playwright.sync_api import sync_playwright

from vo_lib import preset, run
from vo_lib.commands.cli import main
from vo_lib.data.catalogue import open_sequence
from vo_lib.errors import DataError
from vo_lib.geometry.types import Image
from vo_lib.report.film import WORDS_HEIGHT_PX, Film, film_frames
from vo_lib.report.plots import METHOD_COLOURS, REMOVED, TRUTH_COLOUR, bgr


def near(picture: Image, colour: tuple[int, int, int], tolerance: int = 0) -> int:
    return int(np.count_nonzero((np.abs(picture.astype(int) - colour) <= tolerance).all(axis=2)))


def test_film_has_the_same_bytes_from_cached_matches(bands: Path, capsys: pytest.CaptureFixture[str]) -> None:
    base = bands.parent
    command = ["run", str(bands), "--out", str(base / "out"), "--video"]
    assert main([*command, str(base / "a.mp4")]) == 0
    assert str(base / "a.mp4") in capsys.readouterr().out
    assert main([*command, str(base / "b.mp4"), "--cache", str(base / "cache")]) == 0
    assert (base / "a.mp4").read_bytes() == (base / "b.mp4").read_bytes()
    video = cv2.VideoCapture(str(base / "a.mp4"))
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
    with Film(bands.parent / "film.mp4", result, "mine") as film:
        pictures = {shown.index: film.picture(shown) for shown in film_frames(result)}
    assert list(pictures) == [1, 2, 3, 4, 5]
    words, image = slice(WORDS_HEIGHT_PX), (slice(WORDS_HEIGHT_PX, WORDS_HEIGHT_PX + 240), slice(480))
    for colour in map(bgr, (METHOD_COLOURS["feature_selection"], TRUTH_COLOUR)):
        drawn = [near(picture[WORDS_HEIGHT_PX:, 480:], colour, 60) for picture in pictures.values()]
        assert drawn == sorted(drawn)
        assert drawn[-1] > 3 * drawn[0] > 0
    assert near(pictures[3][image], REMOVED) > 0 == near(pictures[5][image], REMOVED)
    assert all(picture[words].std() > 5 for picture in pictures.values())


def test_incomplete_film_is_an_error(bands: Path) -> None:
    result = run(open_sequence(bands), preset("solution_selection"))
    place = bands.parent / "films"
    place.mkdir()
    film = Film(place / "film.mp4", result, "mine")
    film.add(next(film_frames(result)))
    for draft in place.iterdir():  # as on a full disk
        draft.unlink()
    with pytest.raises(DataError, match=r"film\.mp4: the film cannot be written"):
        film.__exit__(None)
    assert not list(place.iterdir())


PLAY = """async video => {
    video.muted = true;
    await video.play();
    await new Promise(resolve => video.onended = resolve);
    for (const seconds of [2.0, 0.5]) {
        video.currentTime = seconds;
        await new Promise(resolve => { video.onseeked = video.onerror = resolve; });
    }
    video.currentTime = video.duration;
    await new Promise(resolve => { video.onseeked = video.onerror = resolve; });
    return [video.error && video.error.message, video.currentTime, video.videoWidth];
}"""


def test_browser_plays_a_film(bands: Path) -> None:
    browser = find_browser()
    if browser is None:
        pytest.skip("no Chromium or Chrome is installed")
    folder = bands.parent / "films"
    folder.mkdir()
    result = run(open_sequence(bands), preset("solution_selection"))
    with Film(folder / "film.mp4", result, "mine") as film:
        for shown in 6 * list(film_frames(result)):  # long enough for a second key frame
            film.add(shown)
    assert [path.name for path in folder.iterdir()] == ["film.mp4"]
    (folder / "page.html").write_text("<video src=film.mp4></video>", encoding="utf-8")
    with sync_playwright() as play:
        opened = play.chromium.launch(executable_path=browser, args=["--no-sandbox"])
        page = opened.new_page()
        page.goto((folder / "page.html").as_uri())
        # Thirty frames at ten a second.
        assert page.eval_on_selector("video", PLAY) == [None, 3, 780]
        opened.close()
