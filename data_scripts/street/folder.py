"""Drawing a whole scene into a folder in KITTI's layout, with several processes if wanted."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vo_lib.core.camera import StereoCamera
from vo_lib.core.errors import DataError
from vo_lib.core.poses import write_kitti_poses
from vo_lib.core.settings import from_dict, to_dict
from vo_lib.core.types import Progress
from vo_lib.data.scenes import SceneConfig
from vo_lib.data.truth import FARTHEST, NEAREST

from .render import Renderer
from .sensor import photograph
from .truth_files import encode_depth, visible_boxes, write_objects
from .world import World, make_world

SCENE_FILE = "truth/scene.json"


def write_scene(
    config: SceneConfig,
    folder: Path,
    progress: Progress | None = None,
    jobs: int = 2,
    frames: range | None = None,
) -> None:
    """Draw all frames of a scene, or some of them, into an empty folder."""
    for name in ("image_0", "image_1", "labels", "truth/depth", "truth/instance"):
        (folder / name).mkdir(parents=True)
    about = {"config": to_dict(config), "nearest": NEAREST, "farthest": FARTHEST}
    if frames is not None:
        about["frames"] = [frames.start, frames.stop]
    _write_text(folder / SCENE_FILE, json.dumps(about, indent=1) + "\n")
    # Helpers are programs of their own: that works from notebooks and unguarded scripts on any system.
    helpers = [_start_helper(folder, first, jobs) for first in range(1, jobs)]
    try:
        world = make_world(config)
        _write_tables(world, folder)
        whole = range(len(world.drive.times))
        wanted = whole if frames is None else frames
        if not 0 <= wanted.start < wanted.stop <= len(whole):
            raise DataError(f"--frames {wanted.start}:{wanted.stop}: the scene has 0:{len(whole)}")

        def report() -> None:
            if progress:
                done = sum(entry.name.endswith(".txt") for entry in os.scandir(folder / "labels"))
                progress(done, len(wanted))

        _draw(world, folder, wanted[:: max(jobs, 1)], report)
        for helper in helpers:
            while helper.poll() is None:
                try:
                    helper.wait(timeout=0.5)
                except subprocess.TimeoutExpired:
                    report()
        # What a helper could not draw is drawn here.
        missing = [i for i in wanted if not (folder / "labels" / f"{i:06d}.txt").exists()]
        _draw(world, folder, missing, report)
        report()
    finally:
        for helper in helpers:
            helper.kill()
            helper.wait()


def _start_helper(folder: Path, first: int, step: int) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "street", str(folder), str(first), str(step)]
    package = str(Path(__file__).resolve().parents[1])
    path = os.pathsep.join(filter(None, [package, os.environ.get("PYTHONPATH", "")]))
    quiet = subprocess.DEVNULL
    return subprocess.Popen(command, env={**os.environ, "PYTHONPATH": path}, stdout=quiet, stderr=quiet)


def draw_share(folder: Path, first: int, step: int) -> None:
    """Draw frames first, first + step, … of a scene that `write_scene` has begun."""
    about = json.loads((folder / SCENE_FILE).read_text())
    world = make_world(from_dict(SceneConfig, about["config"]))
    frames = range(*about.get("frames", (0, len(world.drive.times))))
    _draw(world, folder, frames[first::step], lambda: None)


def _draw(world: World, folder: Path, frames: range | list[int], report: Callable[[], None]) -> None:
    """Draw some frames, one after the other."""
    renderer, threads = Renderer(world), cv2.getNumThreads()
    cv2.setNumThreads(1)  # the processes share the work by frames
    try:
        for frame in frames:
            write_frame(renderer, folder, frame)
            report()
    finally:
        cv2.setNumThreads(threads)


def _write_tables(world: World, folder: Path) -> None:
    """Calibration, times, poses and the motion of the vehicles."""
    _write_text(folder / "calib.txt", calibration_text(world.config.camera))
    _write_text(folder / "times.txt", "".join(f"{t:.6e}\n" for t in world.drive.times))
    write_kitti_poses(folder / "poses.txt", world.poses)
    write_objects(world, folder / "truth" / "objects.npz")


def write_frame(renderer: Renderer, folder: Path, frame: int) -> None:
    """Both pictures of a frame, its labels and its truth."""
    config, name = renderer.world.config, f"{frame:06d}.png"
    for right in (False, True):
        view, picture = photograph(renderer, frame, right)
        _write_png(folder / f"image_{int(right)}" / name, picture, noisy=True)
        if not right:
            boxes = visible_boxes(renderer.world, frame, view)
            _write_png(folder / "truth" / "depth" / name, encode_depth(view.inverse_depth))
            few = 2 * len(renderer.world.vehicles) < 256
            codes = view.instance.astype(np.uint8) if few else view.instance.astype(np.uint16)
            _write_png(folder / "truth" / "instance" / name, codes)
            lines = "".join(box.yolo(config.camera) + "\n" for box in boxes)
            _write_text(folder / "labels" / f"{frame:06d}.txt", lines)


def calibration_text(camera: StereoCamera) -> str:
    """calib.txt: P0 to P3; odd ones are right cameras, with -f b at the end of the first row."""
    lines = []
    for k in range(4):
        P = np.hstack([camera.K, np.zeros((3, 1))])
        P[0, 3] = -camera.f * camera.baseline * (k % 2)
        lines.append(f"P{k}: " + " ".join(f"{v:.12e}" for v in P.ravel()) + "\n")
    return "".join(lines)


def _write_png(path: Path, image: NDArray[np.uint8] | NDArray[np.uint16], noisy: bool = False) -> None:
    # One fixed filter: trying all for each row costs twice the time.
    options = [cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_SUB]
    if noisy:
        # Noise holds no repetitions: do not look for any.
        options += [cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY]
    path.write_bytes(cv2.imencode(".png", image, options)[1].tobytes())


def _write_text(path: Path, text: str) -> None:
    path.write_text(text, encoding="ascii", newline="\n")
