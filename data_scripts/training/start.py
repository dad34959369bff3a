"""Begin a training with the weights of another: its checkpoint, or the network it exported."""

from __future__ import annotations

from pathlib import Path

import onnx
import torch
from onnx import numpy_helper
from torch import Tensor, nn

from training.config import TrainingConfig
from training.dataset import DetectionSet
from training.network import Conv, Detector
from training.trainer import batches, load_state, to_tensor
from vo_lib.core.errors import DataError

LEAST_VARIANCE = 1e-4  # a channel that is always the same would have no scale


def starting_network(path: Path, data: DetectionSet, config: TrainingConfig) -> Detector:
    """The weights of another training to begin with: its `last.pt`, or the ONNX file it exported.

    Raises `DataError` where the file is neither, or knows another number of classes.
    """
    if path.suffix == ".onnx":
        pictures = to_tensor(next(batches(data, config, 0)))
        return read_exported(path, len(data.classes), pictures)
    other = load_state(path)
    if len(other.classes) != len(data.classes):
        raise DataError(f"knows {len(other.classes)} classes, the data set has {len(data.classes)}", path)
    return other.average


@torch.no_grad()
def read_exported(path: Path, classes: int, pictures: Tensor) -> Detector:
    """The network of an ONNX file that `export_onnx` wrote, ready to be trained on.

    An export has each normalisation folded into its convolution. To be trained on, the network needs them
    back: each gets the mean and variance that its convolution gives on `pictures` (B, 3, H, W), and a scale
    and shift that undo them, so that the network says the same as before.

    Raises
    ------
    DataError : the file is no export of this network for this number of classes.
    """
    try:
        graph = onnx.load(str(path)).graph
    except OSError as error:
        raise DataError(f"cannot be read: {error.strerror}", path) from None
    except Exception:  # protobuf's own, without a base that could be named
        raise DataError("is no ONNX file", path) from None
    network = Detector(classes).eval()
    values = {item.name: torch.from_numpy(numpy_helper.to_array(item).copy()) for item in graph.initializer}
    found = [[values.get(name) for name in node.input[1:]] for node in graph.node if node.op_type == "Conv"]
    convolutions = list(_statistics(network, pictures[:1]))
    norms = {part[0]: part[1] for part in network.modules() if isinstance(part, Conv)}
    if len(found) != len(convolutions):
        raise DataError(f"has {len(found)} convolutions, this network {len(convolutions)}", path)
    for convolution, (weight, bias) in zip(convolutions, found, strict=True):
        if weight is None or bias is None or weight.shape != convolution.weight.shape:
            raise DataError("its convolutions are not those of this network for these classes", path)
        convolution.weight.copy_(weight)
        if convolution.bias is not None:
            convolution.bias.copy_(bias)
        else:
            norm = norms[convolution]
            norm.running_mean, norm.running_var = torch.zeros_like(bias), torch.ones_like(bias) - norm.eps
            norm.bias.copy_(bias)
    statistics = _statistics(network, pictures)
    for convolution, norm in norms.items():
        norm.running_mean, norm.running_var = mean, variance = statistics[convolution]
        norm.weight.copy_((variance + norm.eps).sqrt())
        norm.bias.add_(mean)
    return network


def _statistics(network: Detector, pictures: Tensor) -> dict[nn.Conv2d, tuple[Tensor, Tensor]]:
    """Mean and variance of what each convolution gives on the pictures, in the order in which they pass."""
    found: dict[nn.Conv2d, tuple[Tensor, Tensor]] = {}

    def note(part: nn.Conv2d, _: object, output: Tensor) -> None:
        found[part] = output.mean((0, 2, 3)), output.var((0, 2, 3)).clamp(min=LEAST_VARIANCE)

    parts = [part for part in network.modules() if isinstance(part, nn.Conv2d)]
    hooks = [part.register_forward_hook(note) for part in parts]
    network(pictures)
    for hook in hooks:
        hook.remove()
    return found
