"""A training in its folder: begun, or gone on with where it stopped; drawn, and exported at the end."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from training import trainer
from training.config import MODEL, TrainingConfig
from training.dataset import DetectionSet
from training.detection_plots import training_figure
from training.export import export_onnx
from training.start import starting_network
from vo_lib.core.errors import DataError
from vo_lib.core.files import write_bytes_atomic
from vo_lib.core.settings import to_dict
from vo_lib.core.types import Progress
from vo_lib.tables.plots import png

CURVES = "curves.png"
FREE = ("epochs", "threads")  # settings that a training may change when it goes on


def train_in(
    folder: Path,
    data: DetectionSet,
    config: TrainingConfig,
    start: Path | None,
    used_with: int,
    progress: Progress,
) -> trainer.State:
    """Train to the last epoch; the curves are drawn after each, the ONNX file is written at the end.

    Parameters
    ----------
    start : checkpoint or ONNX file whose weights a new training begins with.
    used_with : longer side of the images that the exported model is used with, pixels.

    Raises
    ------
    DataError : the folder holds a training of something else, or `start` is no network of this kind.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / trainer.CHECKPOINT
    if path.exists():
        state = trainer.load_state(path)
        check_same(state, config, data, path)
        state.config = config
    else:
        first = None if start is None else starting_network(start, data, config)
        state = trainer.new_state(config, data.classes, first)
    for _ in trainer.train(data, state, folder, progress):
        title = f"{len(data.images['train'])} images, epoch {state.epoch} of {config.epochs}"
        figure = training_figure(np.array(state.losses), np.array(state.maps), title)
        write_bytes_atomic(folder / CURVES, png(figure))
    export_onnx(state.average, state.classes, folder / MODEL, used_with)
    return state


def check_same(state: trainer.State, config: TrainingConfig, data: DetectionSet, path: Path) -> None:
    """`DataError` where the folder holds a training of something else."""
    old, new = to_dict(state.config), to_dict(config)
    changed = [name for name in old if old[name] != new[name] and name not in FREE]
    if changed or state.classes != data.classes:
        what = f"{changed[0]} {old[changed[0]]}" if changed else f"classes {', '.join(state.classes)}"
        raise DataError(f"is a training with {what}: give another --out or the same settings", path)
