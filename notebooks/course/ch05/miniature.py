"""Chapter 5, around the miniature detector of the notebook: streets to learn from and to be judged on, the
cells of the notebook as a module, and the miniature as a model of the panel.
"""

from __future__ import annotations

import ast
import hashlib
import inspect
import json
import os
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import cv2
import numpy as np
from threadpoolctl import threadpool_limits

from vo_lib.data.catalogue import DRAWING_PROCESSES
from vo_lib.data.drawn import ensure_scene
from vo_lib.data.label_files import read_labels
from vo_lib.data.scenes import scene_config
from vo_lib.data.sequence import Sequence, open_folder
from vo_lib.detection.network_image import Letterbox
from vo_lib.detection.settings import DetectorConfig
from vo_lib.detection.suppression import best_boxes
from vo_lib.detection.yolo import NetworkOutput
from vo_lib.errors import DataError
from vo_lib.geometry.boxes import VEHICLES, Boxes
from vo_lib.geometry.types import Array, BoolArray, Image, Progress
from vo_lib.paper.settings import FilterConfig

from ..frames import opened
from ..notebook_folder import NOTEBOOKS
from ..progress import with_bar
from . import layers
from .box_sources import FilteringView, detector_of, frame_boxes, offer_network
from .exercises import decoded, iou, suppressed

NOTEBOOK = NOTEBOOKS / "05_yolo_box_filtering.ipynb"
# Cells that make, train and judge the miniature, in their order in the notebook.
CELLS = (
    "mini-network",
    "mini-three-levels",
    "mini-cells",
    "mini-box-loss",
    "mini-loss",
    "mini-window",
    "mini-train",
    "mini-detect",
    "mini-judge",
)

LEAST_SCORE = 0.02  # of a box on a curve of precision and recall
JUDGED_FRAMES = 24  # of each street
SEED_OF_OTHERS = 100  # added to the seed of a scene: another street of the same kind

# What these cells use of `layers`.
LAYERS = (
    "GREY",
    "Adam",
    "Network",
    "backward",
    "first_weights",
    "layer_input",
    "network_image",
    "network_input",
    "patches",
    "product",
)

JUDGED_STREETS = ("parked", "another jam", "another traffic")  # no training sees them

Labelled = tuple[Image, Array]  # an image (H, W) and the boxes (K, 4) of its vehicles, pixels


@dataclass(frozen=True, eq=False)
class Detected(Sequence):
    """A sequence whose boxes come from a detector, frame by frame as they are asked for; all of them count."""

    model: str = field(kw_only=True)

    def labelled_boxes(self, index: int) -> Boxes:
        return frame_boxes(self, index, FilteringView(model=self.model), FilterConfig())

    def boxes_of(self, classes: tuple[str, ...] = (VEHICLES,)) -> Callable[[int], Boxes]:
        return self.labelled_boxes

    def refuse_other_numbers(self, classes: tuple[str, ...]) -> None:
        """No label folder needs a check."""


def with_boxes_of(sequence: Sequence, model: str) -> Sequence:
    """The sequence with the boxes of its label folder or, without one, with those of a detector."""
    return sequence if sequence.labels is not None else Detected(**vars(sequence), model=model)


def another_street(scene: str, number: int = 1) -> Sequence:
    """A street of the kind of a named scene that is no scene of the course; it is drawn if it is missing."""
    config = scene_config(scene)
    config = replace(config, seed=config.seed + SEED_OF_OTHERS * number)

    def find(report: Progress) -> Sequence:
        folder = ensure_scene(config, progress=report, jobs=DRAWING_PROCESSES)
        return open_folder(folder, f"another {scene}" if number == 1 else f"another {scene} ({number})")

    return with_bar(f"drawing another street like {scene}", find)


def labelled(sequence: Sequence, count: int | None = None) -> list[Labelled]:
    """Left images of a sequence with the boxes of their vehicles: all, or `count` from the first to the last."""
    boxes_of = sequence.boxes_of()
    return [(sequence.stereo(index)[0], boxes_of(index).xyxy) for index in spread_frames(sequence, count)]


def spread_frames(sequence: Sequence, count: int | None) -> list[int]:
    """Indices of `count` frames, from the first to the last; those of all frames if `count` is None."""
    if count is None or count >= len(sequence):
        return list(range(len(sequence)))
    return [int(index) for index in np.linspace(0, len(sequence) - 1, count).round()]


def street(name: str) -> Sequence:
    """A street by name: "jam" is a scene of the course, "another jam" and "jam 2" are other ones of its kind."""
    if name.startswith("another "):
        return another_street(name.removeprefix("another "))
    scene, _, number = name.partition(" ")
    return another_street(scene, int(number)) if number else opened(f"synthetic/{scene}")


def judged_streets() -> dict[str, list[Labelled]]:
    """The images on which `vo data measure_miniature` judges a training, by the name of their street.

    Streets that are missing are drawn.
    """
    return {name: labelled(street(name), JUDGED_FRAMES) for name in JUDGED_STREETS}


def boxes_of_lines(lines: list[str], width: int, height: int) -> Array:
    """The boxes (K, 4), pixels, of the lines of a label file, as the kit reads them.

    If the kit refuses the file, its message is printed, and there are no boxes.
    """
    with TemporaryDirectory() as folder:
        path = Path(folder) / "000000.txt"
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        try:
            return read_labels(path, width, height).xyxy
        except DataError as error:
            print(f"The kit refuses this file: {str(error).replace(folder + os.sep, '')}")
            return np.zeros((0, 4))


class Example(NamedTuple):
    """A small data set: its folders and files as text, and its page data.yaml."""

    tree: str
    yaml: str


def example_folder(sequence: Sequence, frame: int, lines: list[str]) -> Example:
    """The folders of a data set of three images, and data.yaml; `lines` are the labels of `frame`."""
    name = sequence.frames[frame]
    yaml = "train: train/images\nval: valid/images\nnc: 3\nnames:\n  - car\n  - bus\n  - truck\n"
    tree = [
        "data.yaml",
        f"train/images/{name}.png",
        f"train/labels/{name}.txt     {len(lines)} rows",
        "train/images/…             the other images to learn from",
        "valid/images/…             images that only watch the training",
        "valid/labels/…",
    ]
    return Example("\n".join(tree) + "\n", yaml)


def boxes_of_model(model: str, image: Image) -> tuple[Array, Array]:
    """Boxes (K, 4), pixels, and scores (K,) of one of the kit's detectors, best first, down to `LEAST_SCORE`."""
    detector = detector_of(model)
    boxes = detector.select_boxes(detector.candidates(image), LEAST_SCORE, DetectorConfig().nms)
    return boxes.xyxy, boxes.score


class Miniature:
    """The reader's network as a model of the panel: the part of `YoloDetector` that the panel uses."""

    path = Path("miniature")
    names = ("vehicle",)
    named = True
    class_count = 1

    def __init__(self, cells: Callable[[Image], tuple[Array, Array]], scale: float) -> None:
        """cells : function from an image to corners (N, 4), its pixels, and scores (N,) of all cells.

        scale : of the image that the network sees, relative to the camera's.
        """
        self.cells = cells
        self.scale = scale

    def candidates(self, image: Image) -> NetworkOutput:
        """The boxes of all cells, in pixels of the small image."""
        height, width = image.shape[:2]
        with threadpool_limits(1):
            corners, scores = self.cells(image)
        shape = layers.network_image(image, self.scale).shape
        letterbox = Letterbox(shape[2], shape[1], self.scale, 0, 0)
        return NetworkOutput(letterbox, letterbox.to_network(corners), scores[:, None], width, height)

    def select_boxes(
        self, output: NetworkOutput, score: float, nms: float, class_mask: BoolArray | None = None
    ) -> Boxes:
        """The boxes after suppression, in pixels of the image."""
        boxes = best_boxes(output.corners, output.scores, score, nms, class_mask)
        return replace(boxes, xyxy=output.letterbox.to_image(boxes.xyxy, output.width, output.height))


def offer(name: str, cells: Callable[[Image], tuple[Array, Array]], scale: float) -> None:
    """Let the panel know the reader's network by a name; a later call replaces it."""
    offer_network(name, Miniature(cells, scale))


def notebook_code() -> str:
    """The code of the cells in which the notebook makes, trains and judges the miniature."""
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    sources = {cell["id"]: "".join(cell["source"]) for cell in cells}
    return "\n\n".join(sources[name] for name in CELLS)


def code_digest() -> str:
    """A digest of that code and of its layers, without comments and the layout of the lines."""
    code = notebook_code() + "\n\n" + inspect.getsource(layers)
    return hashlib.sha256(ast.unparse(ast.parse(code)).encode()).hexdigest()[:12]


def notebook_functions() -> dict[str, Any]:
    """What the notebook's cells define, with the right answers of the exercises in place of the reader's."""
    names: dict[str, Any] = {
        "np": np,
        "cv2": cv2,
        "decode_output": decoded,
        "suppressed_boxes": suppressed,
        "box_overlap": iou.right,
    }
    names |= {name: getattr(layers, name) for name in LAYERS}
    exec(compile(notebook_code(), NOTEBOOK.name, "exec"), names)
    return names
