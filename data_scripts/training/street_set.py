"""A drawn detection data set in YOLO format: left images of many streets, with exact boxes.

Every street has a different seed and random settings. Only a few frames per street are drawn. The test split
has scenes that are not in the training split: the kit's named scenes, also with other seeds.
"""

from __future__ import annotations

from collections.abc import Iterable
from concurrent.futures import as_completed
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from vo_lib.data.label_files import write_labels
from vo_lib.data.scenes import KITTI_F, SCENES, TABLE_SCENES, SceneConfig, scene_config
from vo_lib.files import read_text, write_atomic
from vo_lib.geometry.types import Progress
from vo_lib.parallel import local_pool
from vo_lib.runs.folder import refuse_foreign
from vo_lib.settings import Checked, setting
from vo_street.render import Renderer
from vo_street.sensor import expose, exposures, smear
from vo_street.truth_files import visible_boxes
from vo_street.world import make_world

DESCRIPTION = "data.yaml"  # of a data set
NAMES = ("car", "bus", "truck")
CLASS_OF = {2: 0, 5: 1, 7: 2}  # index in NAMES by COCO number
# Seeds of the splits; far apart, so that no street is in two of them.
TRAIN_SEED = 100_000
VALID_SEED = 200_000
TEST_SEED = 300_000
TEST_SEEDS = 2  # seeds per named scene
# The smallest visible vehicle with a label.
MIN_PIXELS = 40
MIN_HEIGHT = 8
JPEG_QUALITY = 92


@dataclass(frozen=True)
class DetectionSetConfig(Checked):
    """Settings of a drawn data set for the training of a vehicle detector for drawn streets."""

    seed: int = setting(0, "number added to the seed of every street", low=0, high=99_999)
    train: int = setting(4000, "images to train on", low=1, high=1_000_000)
    valid: int = setting(240, "images for the mAP curve of the training", low=1, high=100_000)
    frames: int = setting(24, "images per street, far from each other", low=1, high=1000)


@dataclass(frozen=True)
class Street:
    """A street to draw: its split, its number in the split, its settings, and how many frames to draw."""

    split: str
    number: int
    scene: SceneConfig
    frames: int

    def stem(self, k: int) -> str:
        """File stem of the k-th image."""
        return f"{self.number:04d}_{k:02d}"


def random_scene(seed: int) -> SceneConfig:
    """Random settings of a training street: layout, traffic, light, weather and camera."""
    rng = np.random.default_rng([seed, 20])

    def between(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    base = str(rng.choice(["parked", "traffic", "traffic", "jam", "highway", "hard"]))
    scene = SCENES[base]
    city = scene.layout == "city"
    return scene_config(
        base,
        seed=seed,
        length=scene.length * between(0.6, 1.0),
        parked=between(0.0, 0.95) if city else 0.0,
        ahead=int(rng.integers(0, 4)),
        truck_ahead=bool(rng.random() < 0.25),
        gap=between(8.0, 30.0),
        oncoming=between(0.0, 5.5),
        overtaking=between(0.0, 14.0) if scene.lanes > 1 else 0.0,
        lanes=int(rng.integers(1, 4)) if city else int(rng.integers(2, 4)),
        shake=between(0.5, 3.0),
        noise=between(0.5, 5.0),
        optics=between(0.2, 1.2),
        exposure_change=between(0.0, 0.9),
        dark_stretches=between(0.0, 0.5) if rng.random() < 0.4 else 0.0,
        shutter=between(2.0, 15.0) if rng.random() < 0.4 else 0.0,
        focal=KITTI_F * between(0.8, 1.25),
        camera_height=between(1.3, 2.0),
    )


def streets(config: DetectionSetConfig) -> list[Street]:
    """All streets of a data set; equal settings give equal streets."""
    frames = config.frames
    result = []
    for split, first_seed, images in (
        ("train", TRAIN_SEED, config.train),
        ("valid", VALID_SEED, config.valid),
    ):
        for number, begun in enumerate(range(0, images, frames)):
            scene = random_scene(config.seed + first_seed + number)
            result.append(Street(split, number, scene, min(frames, images - begun)))
    number = 0
    for round_of_scenes in range(TEST_SEEDS):
        for name in TABLE_SCENES:
            scene = SCENES[name]  # with its own seed at first, then with others
            if round_of_scenes > 0:
                scene = scene_config(name, seed=config.seed + TEST_SEED + number)
            result.append(Street("test", number, scene, frames))
            number += 1
    return result


def draw_street(street: Street, folder: Path) -> int:
    """Draw the missing images of a street into a data set's folder; return its number of images.

    The label file is written after the image, so an image with a label file is complete.
    """
    root = folder / street.split
    missing = [k for k in range(street.frames) if not (root / "labels" / f"{street.stem(k)}.txt").exists()]
    if not missing:
        return street.frames
    cv2.setNumThreads(1)  # each process draws different streets
    world = make_world(street.scene)
    renderer = Renderer(world)
    exposure = exposures(street.scene, world.drive.times)
    frame_numbers = np.linspace(0, len(world.drive.times) - 1, street.frames).round().astype(int)
    for k in missing:
        frame = int(frame_numbers[k])
        view = renderer.view(frame)
        light = smear(world, frame, view, right=False)
        image = expose(light, street.scene, float(exposure[frame]), frame, right=False)
        boxes = visible_boxes(world, frame, view, MIN_PIXELS, MIN_HEIGHT)
        own_class = np.array([CLASS_OF[kind] for kind in boxes.class_id.tolist()], np.int64)
        data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1]
        write_atomic(root / "images" / f"{street.stem(k)}.jpg", data.tobytes())
        label = root / "labels" / f"{street.stem(k)}.txt"
        height, width = image.shape[:2]
        write_labels(label, replace(boxes, class_id=own_class), width, height, scores=False)
    return street.frames


def write_street_set(
    folder: Path, config: DetectionSetConfig, jobs: int = 1, progress: Progress | None = None
) -> None:
    """Draw a data set; a second call draws the missing images.

    Layout: `data.yaml`; `train`, `valid` and `test`, each with `images` and `labels`.
    """
    everything = streets(config)
    start_set(folder, ("train", "valid", "test"), data_yaml(NAMES))
    total = sum(street.frames for street in everything)
    done = 0
    with local_pool(min(jobs, len(everything))) as pool:
        running = [pool.submit(draw_street, street, folder) for street in everything]
        for drawn in as_completed(running):
            done += drawn.result()
            if progress:
                progress(done, total)


def start_set(folder: Path, splits: Iterable[str], description: str) -> None:
    """Make the folders of a data set, with data.yaml, which shows that the data set is the kit's.

    Raises `DataError` if the folder has a data set that the kit did not write.
    """
    path = folder / DESCRIPTION
    own = path.is_file() and read_text(path) == description
    refuse_foreign(folder, (DESCRIPTION, "train", "valid", "test"), own)
    for split in splits:
        for kind in ("images", "labels"):
            (folder / split / kind).mkdir(parents=True, exist_ok=True)
    write_atomic(path, description)


def data_yaml(names: tuple[str, ...], test: bool = True) -> str:
    """The text of data.yaml in the format of Ultralytics and Roboflow, with or without a test split."""
    lines = ["train: train/images", "val: valid/images"]
    if test:
        lines.append("test: test/images")
    return "\n".join([*lines, f"nc: {len(names)}", "names:", *(f"  - {name}" for name in names), ""])
