"""Drawing of a whole scene into a folder in KITTI's layout, in one or several processes."""

from __future__ import annotations

import functools
import json
from concurrent.futures import BrokenExecutor, as_completed
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vo_lib.data.kitti import calibration_text
from vo_lib.data.label_files import write_labels
from vo_lib.data.poses import write_kitti_poses
from vo_lib.data.scenes import SceneConfig
from vo_lib.errors import DataError
from vo_lib.geometry.types import Progress
from vo_lib.parallel import local_pool
from vo_lib.settings import to_dict

from .render import Renderer
from .route import frame_count
from .sensor import photograph
from .truth_files import encode_depth, visible_boxes, write_objects
from .world import make_world


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
    scene = json.dumps({"config": to_dict(config)}, indent=1)
    _write_text(folder / "truth" / "scene.json", scene + "\n")
    count = frame_count(config)
    selection = range(count) if frames is None else frames
    if not 0 <= selection.start < selection.stop <= count:
        raise DataError(f"--frames {selection.start}:{selection.stop}: the scene has the frames 0:{count}")
    with local_pool(min(jobs, len(selection))) as pool:
        tables = pool.submit(_write_tables, config, folder)
        running = [pool.submit(_write_frame, config, folder, frame) for frame in selection]
        try:
            for done, ended in enumerate(as_completed(running), start=1):
                ended.result()
                if progress:
                    progress(done, len(selection))
            tables.result()
        except BrokenExecutor:
            raise DataError("a drawing process was killed, perhaps for lack of memory") from None


@functools.lru_cache(maxsize=1)
def _renderer(config: SceneConfig) -> Renderer:
    """The renderer of a scene, one per process."""
    cv2.setNumThreads(1)  # the processes share the work by frames
    return Renderer(make_world(config))


def _write_tables(config: SceneConfig, folder: Path) -> None:
    """Write calibration, times, poses and the motion of the vehicles."""
    world = _renderer(config).world
    _write_text(folder / "calib.txt", calibration_text(config.camera))
    _write_text(folder / "times.txt", "".join(f"{t:.6e}\n" for t in world.drive.times))
    write_kitti_poses(folder / "poses.txt", world.poses)
    write_objects(world, folder / "truth" / "objects.npz")


def _write_frame(config: SceneConfig, folder: Path, frame: int) -> None:
    """Draw and write both images of a frame, its labels and its truth."""
    renderer = _renderer(config)
    name = f"{frame:06d}.png"
    for right in (False, True):
        view, picture = photograph(renderer, frame, right)
        _write_png(folder / f"image_{int(right)}" / name, picture, noisy=True)
        if not right:
            boxes = visible_boxes(renderer.world, frame, view)
            _write_png(folder / "truth" / "depth" / name, encode_depth(view.inverse_depth))
            few = 2 * len(renderer.world.vehicles) < 256
            codes = view.instance.astype(np.uint8) if few else view.instance.astype(np.uint16)
            _write_png(folder / "truth" / "instance" / name, codes)
            label = folder / "labels" / f"{frame:06d}.txt"
            write_labels(label, boxes, config.camera.width, config.camera.height, scores=False)


def _write_png(path: Path, image: NDArray[np.uint8] | NDArray[np.uint16], noisy: bool = False) -> None:
    """Write an image with little compression; noisy : the image of a camera, not of the truth."""
    # One fixed filter: a trial of all filters for each row takes twice the time.
    options = [cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_SUB]
    if noisy:
        # Noise has no repetitions, so a search for repetitions is useless.
        options += [cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY]
    path.write_bytes(cv2.imencode(".png", image, options)[1].tobytes())


def _write_text(path: Path, text: str) -> None:
    """Write a text with the same bytes on every system."""
    path.write_text(text, encoding="ascii", newline="\n")
