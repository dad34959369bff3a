"""The training loop: deterministic, resumable, with a curve of loss and mAP."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from torch import Tensor

from training.augment import Target, fitted, training_picture
from training.config import TrainingConfig
from training.dataset import DetectionSet, Example
from training.loss import Truth, detection_loss
from training.mean_ap import Judged, average_precision, judge
from training.network import Detector
from vo_lib.core.boxes import Boxes
from vo_lib.core.errors import DataError
from vo_lib.core.files import write_bytes_atomic
from vo_lib.core.settings import from_dict, to_dict
from vo_lib.core.types import Progress
from vo_lib.detection.yolo_layout import best_boxes

CHECKPOINT = "last.pt"
PLAIN_SHARE = 0.2  # of the epochs, at the end, without mosaics
LAST_RATE = 0.02  # of the highest learning rate
EVALUATED_HEIGHT = 16.0  # px in the network's picture; lower vehicles are not asked for
EVALUATED_SCORE = 0.01


@dataclass
class State:
    """Everything a training is at the end of an epoch; written as tensors and numbers alone."""

    network: Detector
    average: Detector
    optimizer: torch.optim.Optimizer
    config: TrainingConfig
    classes: tuple[str, ...]
    epoch: int = 0
    losses: list[list[float]] = field(default_factory=list)
    maps: list[float] = field(default_factory=list)


def new_state(config: TrainingConfig, classes: tuple[str, ...], start: Detector | None = None) -> State:
    """An untrained network, or the weights of another one for as many classes, with its optimiser."""
    torch.manual_seed(config.seed)
    network, average = Detector(len(classes)), Detector(len(classes))
    if start is not None:
        network.load_state_dict(start.state_dict())
    average.load_state_dict(network.state_dict())
    network = network.to(memory_format=torch.channels_last)
    weights = [p for p in network.parameters() if p.ndim > 1]
    others = [p for p in network.parameters() if p.ndim <= 1]
    groups = [{"params": weights, "weight_decay": config.decay}, {"params": others, "weight_decay": 0.0}]
    return State(network, average.eval(), torch.optim.AdamW(groups, lr=config.rate), config, classes)


def save_state(state: State, path: Path) -> None:
    """Write a state; it can be read with `weights_only`: tensors, numbers and words, no code."""
    data: dict[str, Any] = {
        "network": state.network.state_dict(),
        "average": state.average.state_dict(),
        "optimizer": state.optimizer.state_dict(),
        "config": to_dict(state.config),
        "classes": list(state.classes),
        "epoch": state.epoch,
        "losses": state.losses,
        "maps": state.maps,
    }
    buffer = io.BytesIO()
    torch.save(data, buffer)
    write_bytes_atomic(path, buffer.getvalue())


def load_state(path: Path) -> State:
    """Read a state that `save_state` wrote; `DataError` for anything else."""
    try:
        data = torch.load(path, map_location="cpu", weights_only=True)
        state = new_state(from_dict(TrainingConfig, data["config"]), tuple(data["classes"]))
        state.network.load_state_dict(data["network"])
        state.average.load_state_dict(data["average"])
        state.optimizer.load_state_dict(data["optimizer"])
        state.epoch, state.losses, state.maps = data["epoch"], data["losses"], data["maps"]
    except FileNotFoundError:
        raise DataError("the checkpoint is missing", path) from None
    except Exception as error:
        raise DataError(
            f"is no checkpoint of this training: {str(error).splitlines()[0][:120]}", path
        ) from None
    return state


def learning_rate(config: TrainingConfig, step: int, steps: int) -> float:
    """Rising for the first steps, at most 200, then a half cosine down to `LAST_RATE`."""
    warm = min(200, max(1, steps // 10))
    if step < warm:
        return config.rate * (step + 1) / warm
    share = (step - warm) / max(1, steps - warm)
    return config.rate * (LAST_RATE + (1 - LAST_RATE) * 0.5 * (1 + math.cos(math.pi * share)))


def batches(data: DetectionSet, config: TrainingConfig, epoch: int) -> Iterator[list[Target]]:
    """The training pictures of an epoch, prepared one batch ahead in a thread."""
    files = data.images["train"]
    order = np.random.default_rng([config.seed, 1, epoch]).permutation(len(files))
    mosaic = epoch < config.epochs - round(PLAIN_SHARE * config.epochs)

    def picture(position: int) -> Target:
        rng = np.random.default_rng([config.seed, 2, epoch, position])
        first = [int(order[position])]

        def draw() -> Example:
            # The first piece is the image whose turn it is, the others of a mosaic are any.
            return data.read(files[first.pop() if first else int(rng.integers(len(files)))])

        return training_picture(draw, config, rng, mosaic)

    def batch(start: int) -> list[Target]:
        return [picture(k) for k in range(start, min(start + config.batch, len(files)))]

    with ThreadPoolExecutor(max_workers=1) as pool:
        starts = list(range(0, len(files), config.batch))
        waiting = pool.submit(batch, starts[0])
        for start in starts[1:]:
            ready, waiting = waiting.result(), pool.submit(batch, start)
            yield ready
        yield waiting.result()


def to_tensor(targets: list[Target]) -> Tensor:
    """Pictures (B, 3, H, W) in 0..1: grey ones as three equal channels."""
    grey = torch.from_numpy(np.stack([target.image for target in targets])).float() / 255.0
    return grey[:, None].expand(-1, 3, -1, -1).contiguous(memory_format=torch.channels_last)


def to_truth(target: Target) -> Truth:
    """The boxes of a picture as tensors."""
    corners, ignored = (torch.from_numpy(part).float() for part in (target.corners, target.ignored))
    return Truth(corners, torch.from_numpy(target.class_id), ignored)


def train_epoch(state: State, data: DetectionSet, progress: Progress | None = None) -> tuple[float, float]:
    """One more pass over the training images; mean box and class loss."""
    config, files = state.config, len(data.images["train"])
    count = -(-files // config.batch)
    state.network.train()
    sums = [0.0, 0.0]
    for number, targets in enumerate(batches(data, config, state.epoch)):
        step = state.epoch * count + number
        for group in state.optimizer.param_groups:
            group["lr"] = learning_rate(config, step, config.epochs * count)
        corners, logits, cells = state.network(to_tensor(targets))
        losses = detection_loss(
            corners, logits, cells, [to_truth(t) for t in targets], config.box_weight, config.candidates
        )
        state.optimizer.zero_grad()
        (losses[0] + losses[1]).backward()
        torch.nn.utils.clip_grad_norm_(state.network.parameters(), 10.0)
        state.optimizer.step()
        update_average(state, step)
        for k, loss in enumerate(losses):
            sums[k] += float(loss.detach()) / count
        if progress:
            progress(step + 1, config.epochs * count)
    state.epoch += 1
    return sums[0], sums[1]


@torch.no_grad()
def update_average(state: State, step: int) -> None:
    """Move the averaged weights towards the present ones; faster at first, when these are worth little."""
    memory = min(state.config.average, (1 + step) / (10 + step))
    new = state.network.state_dict()
    for name, old in state.average.state_dict().items():
        if old.dtype.is_floating_point:
            old.lerp_(new[name], 1 - memory)
        else:
            old.copy_(new[name])


@torch.no_grad()
def evaluate(network: Detector, data: DetectionSet, split: str, config: TrainingConfig) -> list[Judged]:
    """Detections of a split's images, fitted into the training size, beside their truth."""
    network.eval()
    judged = []
    for path in data.images[split]:
        target = fitted(data.read(path), config.size)
        corners, logits, _ = network(to_tensor([target]))
        scores = logits[0].sigmoid().double().numpy()
        found = best_boxes(corners[0].double().numpy(), scores, EVALUATED_SCORE, 0.6)
        truth = Boxes(target.corners, target.class_id, np.ones(len(target.class_id)))
        judged.append(judge(found, truth, target.ignored, EVALUATED_HEIGHT))
    return judged


def train(
    data: DetectionSet, state: State, folder: Path, progress: Progress | None = None
) -> Iterator[State]:
    """Train to the last epoch; after each the state is written to `folder` and given back."""
    torch.set_num_threads(state.config.threads)
    cv2.setNumThreads(1)
    torch.use_deterministic_algorithms(True)
    while state.epoch < state.config.epochs:
        state.losses.append(list(train_epoch(state, data, progress)))
        state.maps.append(average_precision(evaluate(state.average, data, "valid", state.config)))
        save_state(state, folder / CHECKPOINT)
        yield state
