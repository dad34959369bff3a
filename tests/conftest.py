"""Shared data: a small synthetic stereo sequence with exact geometry, and real KITTI clips if they exist."""

from __future__ import annotations

import functools
import gc
import os
import shutil
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

# For the processes that tests start, too: where two processes share two cores, waiting BLAS threads take half
# of the processor's time.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# When imported, jsonschema builds the grammars of all kinds of addresses, which takes more than a second in
# each process. The format of notebooks asks for none of them, and jsonschema does without them.
sys.modules["rfc3987_syntax"] = None  # type: ignore[assignment]

import cv2
import numpy as np
import pytest
from file_server import FileServer
from filelock import FileLock
from hypothesis import settings
from matplotlib.figure import Figure
from real_images import KITTI_00, RealImages

from vo_lib.config import change, preset
from vo_lib.data.catalogue import open_sequence
from vo_lib.data.drawn import ensure_scene
from vo_lib.data.sequence import Sequence
from vo_lib.geometry.motion import rigid, rotation_from_vector
from vo_lib.geometry.types import Array, Image
from vo_lib.kit.settings import KitConfig
from vo_lib.report.plots import png

# No time limit per example, because a machine may be busy. The default profile has the same examples in
# every run; `--hypothesis-profile long` has many more, and others in each run.
settings.register_profile("gate", deadline=None, max_examples=50, derandomize=True)
settings.register_profile("long", deadline=None, max_examples=2000)
settings.load_profile("gate")
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # A background job of a shell ignores SIGINT, and so would every program that the tests start.
    signal.signal(signal.SIGINT, signal.default_int_handler)

# The slowest files come first: a process without work takes tests from the end of another one's list.
LONGEST = ("test_notebooks.py", "test_browser.py", "test_panels.py", "test_odometry.py", "test_jobs.py")

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")

BASELINE = 0.5
FOCAL = 300.0
WIDTH, HEIGHT = 480, 240
BANDS = (4, 6, 9, 12, 16, 20)  # disparity of each band of rows, pixels


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Sort the tests by file: the slowest files first, then those with tests of the drawn street.

    The first process then has all tests of the street, which it draws, and the others never wait for it.
    """
    of_street = {item.path for item in items if "street" in getattr(item, "fixturenames", ())}

    def rank(item: pytest.Item) -> int:
        if item.path.name in LONGEST:
            return LONGEST.index(item.path.name)
        return len(LONGEST) if item.path in of_street else len(LONGEST) + 1

    items.sort(key=rank)


def pytest_collection_finish() -> None:
    """Spare the garbage collector the modules and tests that were collected, which stay to the end."""
    gc.collect()
    gc.freeze()


def find_browser() -> str | None:
    """Path of the installed Chromium or Chrome, or None."""
    return next(filter(None, map(shutil.which, BROWSERS)), None)


@pytest.fixture(scope="session", autouse=True)
def _own_hashes(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Store the hashes of the tests' images outside the user's cache folder."""
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("user")
        patch.setattr("vo_lib.data.image_hashes.cache_folder", lambda: folder)
        yield


@pytest.fixture(scope="session", autouse=True)
def _no_kitti_of_the_machine() -> Iterator[None]:
    """Hide this machine's KITTI sequences from the tests, which ask `real` for those they need."""
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("KITTI_ROOT", raising=False)
        patch.setattr("vo_lib.data.catalogue.KITTI_FOLDERS", (Path("data", "kitti_of_tests"),))
        yield


@pytest.fixture(scope="session")
def real(tmp_path_factory: pytest.TempPathFactory) -> RealImages:
    """Parts of real KITTI sequences; a test that asks for frames that this machine lacks is skipped."""
    return RealImages(tmp_path_factory.mktemp("kitti"))


@pytest.fixture
def drive_00(real: RealImages, monkeypatch: pytest.MonkeyPatch) -> Sequence:
    """The first 201 frames of KITTI 00. Its matches in the user's cache serve several tests and notebooks."""
    monkeypatch.setenv("KITTI_ROOT", str(real.root(*KITTI_00)))
    return open_sequence("kitti/00")


@pytest.fixture(scope="session")
def street(tmp_path_factory: pytest.TempPathFactory) -> Sequence:
    """`synthetic/traffic` in the user's cache folder, which the notebooks also use.

    Drawing takes almost a minute; the first test process draws the scene, and the other processes wait. One
    process draws if the others have tests of their own: each would build the whole street before it draws.
    """
    base = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" not in os.environ:
        return open_sequence("synthetic/traffic")
    with FileLock(base.parent / "street.lock"):
        ensure_scene("traffic", jobs=1)
        return open_sequence("synthetic/traffic")


def texture(rng: np.random.Generator, height: int, width: int, smooth: float) -> Image:
    """Random grey values (H, W) from 0 to 255, blurred with a standard deviation of `smooth` px."""
    noise = cv2.GaussianBlur(rng.uniform(0, 255, (height, width)), (0, 0), smooth)
    low, high = noise.min(), noise.max()
    return np.asarray(255 * (noise - low) / (high - low), np.uint8)


def write_bands(folder: Path, frames: int = 6, standing: bool = False) -> Path:
    """A folder in KITTI's layout whose geometry is exact in integer pixels.

    The scene has six bands of texture at six depths. The camera moves to the right by one baseline per
    frame, so the left image of a frame equals the right image of the previous frame. With `standing`, the
    camera does not move.
    """
    for name, content in _band_files(frames, standing).items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    return folder


@functools.lru_cache(maxsize=16)
def _band_files(frames: int, standing: bool) -> dict[str, bytes]:
    """The files of the band sequence by name; they are drawn once, since hundreds of tests write them."""
    rng = np.random.default_rng(7)
    height = HEIGHT // len(BANDS)
    width = WIDTH + max(BANDS) * (frames + 1)
    textures = [texture(rng, height, width, 1.2) for _ in BANDS]
    files = dict[str, bytes]()
    for frame in range(frames):
        for view in range(2):
            place = view if standing else frame + view
            rows = [t[:, d * place : d * place + WIDTH] for t, d in zip(textures, BANDS, strict=True)]
            png = cv2.imencode(".png", np.concatenate(rows))[1]
            files[f"image_{view}/{frame:06d}.png"] = png.tobytes()
    matrix = f"{FOCAL} 0 {WIDTH / 2} {{}} 0 {FOCAL} {HEIGHT / 2} 0 0 0 1 0\n"
    steps = [0.0 if standing else BASELINE * i for i in range(frames)]
    texts = {
        "calib.txt": "P0: " + matrix.format(0) + "P1: " + matrix.format(-FOCAL * BASELINE),
        "times.txt": "".join(f"{0.1 * i:.6e}\n" for i in range(frames)),
        "poses.txt": "".join(f"1 0 0 {x} 0 1 0 0 0 0 1 0\n" for x in steps),
    }
    return files | {name: text.encode() for name, text in texts.items()}


def small(method: str = "solution_selection", **changes: object) -> KitConfig:
    """A method of variant `kit` for the band sequence, with settings such as selection__sets=20."""
    config = change(preset(method, variant="kit"), "features.cell", 10)
    for name, value in changes.items():
        config = change(config, name.replace("__", "."), value)
    return config


def with_box(folder: Path, frames: int, box: str = "2 0.25 0.5 0.3 0.8\n") -> Path:
    """The sequence with the same vehicle box in every frame."""
    (folder / "labels").mkdir()
    for frame in range(frames):
        (folder / "labels" / f"{frame:06d}.txt").write_text(box, encoding="utf-8")
    return folder


def winding_road(frames: int, turn: float, step: float) -> Array:
    """Poses (N, 4, 4) along gentle curves; `turn` is the largest rotation per frame, radians."""
    poses = np.tile(np.eye(4), (frames, 1, 1))
    for i in range(1, frames):
        R = rotation_from_vector(np.array([0.0, turn * np.sin(i / 9), 0.0]))
        poses[i] = poses[i - 1] @ rigid(R, np.array([0, 0, step]))
    return poses


@pytest.fixture
def pictures_not_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """One empty picture in place of all: for tests of runs and numbers, whose time goes into pictures."""
    empty = png(Figure(figsize=(1, 1)))
    for module in ("commands.run", "report.table1_page", "report.sweep_table"):
        monkeypatch.setattr(f"vo_lib.{module}.png", lambda figure: empty)


@pytest.fixture
def bands(tmp_path: Path) -> Path:
    """The band sequence of six frames, in a new folder."""
    return write_bands(tmp_path / "bands")


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[FileServer]:
    """A web server on this machine; failed downloads are repeated without a pause."""
    monkeypatch.setattr("fetch.download.PAUSE_S", 0.0)
    made = FileServer()
    yield made
    made.close()
