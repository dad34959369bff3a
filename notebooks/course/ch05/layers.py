"""Chapter 5, the arithmetic below the miniature detector: convolutions, their gradients, and the steps of Adam.

All maps have the shape (B, h, w, channels) and are float32. A head has five channels and no activation.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from vo_lib.geometry.types import Image

Map = NDArray[np.float32]
Source = int | tuple[int, int]  # what a layer reads: a map, or two that are joined (see `Network`)

GREY = 114  # of borders, and zero for the network
CONTRAST = 64  # grey levels, one for the network
HEAD = 5  # channels of an output: the score and four sides
LEAK = np.float32(0.1)  # slope of the activation below zero
HEAD_SPREAD = 0.1  # of the first weights of a head, in units of those of other layers
FIRST_SCORE = -4.0  # at first, every cell says that it sees no vehicle
WARM_UP = 50  # steps until the full rate
LAST_RATE = 0.01  # of the last step, as a share of the full rate
LARGEST_GRADIENT = 10.0  # norm of all gradients; larger ones are scaled down


class Network(NamedTuple):
    """A network as a table.

    Attributes
    ----------
    layers : of each layer what it reads (0 is the image, n the n-th layer; a pair is a map and one of half its
        height and width), the number of its channels, the side of its kernel, and its stride. The last layers
        are the outputs, one for each level.
    levels : of each output the size of a cell, and the smallest and the largest vehicle, pixels.
    """

    layers: list[tuple[Source, int, int, int]]
    levels: list[tuple[int, float, float]]


def network_input(image: Image) -> Map:
    """Grey values (H, W) as numbers near zero (H, W, 1)."""
    return (image[..., None].astype(np.float32) - np.float32(GREY)) / np.float32(CONTRAST)


def network_image(image: Image, scale: float) -> Map:
    """A whole image (H, W) for the network, (1, h, w, 1): scaled, with sides that are multiples of 32."""
    height, width = image.shape
    size = [32 * math.ceil(round(scale * side) / 32) for side in (width, height)]
    # OpenCV counts from the centre of a pixel, the boxes in the network's image from its edge.
    place = np.array([[scale, 0, (scale - 1) / 2], [0, scale, (scale - 1) / 2]])
    return network_input(np.asarray(cv2.warpAffine(image, place, size, borderValue=GREY)))[None]


def layer_input(maps: Sequence[Map], source: Source) -> Map:
    """The map that a layer reads; of a pair, the second one is enlarged and joined to the first."""
    if isinstance(source, tuple):
        fine, coarse = source
        return np.concatenate([maps[fine], twice(maps[coarse])], axis=3)
    return maps[source]


def product(columns: Map, weights: Map) -> Map:
    """The last axis of `columns` times a matrix, as one product: NumPy would make one for each row of cells."""
    flat = columns.reshape(-1, columns.shape[-1]) @ weights
    return flat.reshape(*columns.shape[:-1], -1)


def patches(x: Map, kernel: int, stride: int) -> Map:
    """The pixels under the kernel at each place, (B, h / stride, w / stride, kernel² channels).

    With them, a convolution is one product of matrices. The image gets one zero before its first row and column,
    and zeros after its last ones where the last patch reaches beyond them.
    """
    if kernel == 1:
        return x
    height = x.shape[1] // stride
    width = x.shape[2] // stride
    padded = _padded(x, kernel, stride)
    views = [
        padded[:, i : i + stride * height : stride, j : j + stride * width : stride]
        for i in range(kernel)
        for j in range(kernel)
    ]
    return np.concatenate(views, axis=3)


def _padded(x: Map, kernel: int, stride: int) -> Map:
    after = max(kernel - 1 - stride, 0)  # what the last patch reaches beyond the image
    return np.pad(x, ((0, 0), (1, after), (1, after), (0, 0)))


def spread(g: Map, shape: tuple[int, ...], kernel: int, stride: int) -> Map:
    """The transpose of `patches`: for each pixel, the sum of the gradients of all patches that have it."""
    if kernel == 1:
        return g
    batch, height, width, channels = shape
    rows = g.shape[1] * stride
    columns = g.shape[2] * stride
    out = _padded(np.zeros(shape, np.float32), kernel, stride)
    part = 0
    for i in range(kernel):
        for j in range(kernel):
            out[:, i : i + rows : stride, j : j + columns : stride] += g[..., part : part + channels]
            part += channels
    return out[:, 1 : 1 + height, 1 : 1 + width]


def twice(x: Map) -> Map:
    """A map with each cell repeated, so that it has twice the height and width."""
    return x.repeat(2, axis=1).repeat(2, axis=2)


def halved(g: Map) -> Map:
    """The transpose of `twice`: the sum of the gradients of each cell's four copies."""
    batch, height, width, channels = g.shape
    return np.asarray(g.reshape(batch, height // 2, 2, width // 2, 2, channels).sum(axis=(2, 4)))


def sources(source: Source) -> tuple[int, ...]:
    """The numbers of the maps that a layer reads."""
    return source if isinstance(source, tuple) else (source,)


def first_weights(network: Network, rng: np.random.Generator) -> list[Map]:
    """Random weights (inputs, channels) and biases (channels,) of all layers, one after the other."""
    channels_of = [1]
    weights = []
    for source, channels, kernel, _ in network.layers:
        inputs = kernel**2 * sum(channels_of[each] for each in sources(source))
        size = np.sqrt(2.0 / inputs)
        bias = np.zeros(channels, np.float32)
        if channels == HEAD:
            size *= HEAD_SPREAD
            bias[0] = FIRST_SCORE
        weights.append(rng.normal(0.0, size, (inputs, channels)).astype(np.float32))
        weights.append(bias)
        channels_of.append(channels)
    return weights


def backward(
    network: Network,
    gradients: Sequence[Map],
    maps: Sequence[Map],
    columns: Sequence[Map],
    weights: Sequence[Map],
) -> list[Map]:
    """Gradients of the loss for all weights, by the chain rule from the last layer to the first.

    Parameters
    ----------
    gradients : of the loss for the outputs, which are the last maps.
    maps : the image and the result of each layer. columns : the `patches` that each layer multiplied.
    """
    first_output = len(maps) - len(gradients)
    arrived: dict[int, Map] = {first_output + n: g for n, g in enumerate(gradients)}
    result: list[Any] = [None] * len(weights)
    for n in reversed(range(len(network.layers))):
        source, channels, kernel, stride = network.layers[n]
        g = arrived.pop(n + 1)
        if channels != HEAD:
            g = np.where(maps[n + 1] > 0, g, LEAK * g)
        rows = g.reshape(-1, channels)
        result[2 * n] = columns[n].reshape(len(rows), -1).T @ rows
        result[2 * n + 1] = rows.sum(axis=0)
        if source == 0:
            continue  # the image itself is not learned
        before = sources(source)
        batch, height, width, _ = maps[before[0]].shape
        inputs = sum(maps[each].shape[3] for each in before)
        back = spread(product(g, weights[2 * n].T), (batch, height, width, inputs), kernel, stride)
        parts = [back]
        if len(before) == 2:
            fine = maps[before[0]].shape[3]
            parts = [back[..., :fine], halved(back[..., fine:])]
        for each, part in zip(before, parts, strict=True):
            arrived[each] = arrived[each] + part if each in arrived else part
    return result


class Adam:
    """Steps against the gradient, each weight with its own size: its mean gradient over its root mean square.

    The rate rises over the first steps and then falls along half a cosine. (Kingma and Ba, 2015.)
    """

    def __init__(self, weights: list[Map], rate: float, steps: int) -> None:
        self.weights = weights
        self.rate = rate
        self.steps = steps
        self.step = 0
        self.mean = [np.zeros_like(each) for each in weights]
        self.square = [np.zeros_like(each) for each in weights]

    def update(self, gradients: Sequence[Map]) -> None:
        """Change the weights in place."""
        self.step += 1
        norm = np.sqrt(sum(float((g * g).sum()) for g in gradients))
        shrink = np.float32(min(1.0, LARGEST_GRADIENT / norm))
        falling = LAST_RATE + (1.0 - LAST_RATE) * (1.0 + np.cos(np.pi * self.step / self.steps)) / 2.0
        rate = self.rate * min(1.0, self.step / WARM_UP) * falling
        for weight, gradient, mean, square in zip(
            self.weights, gradients, self.mean, self.square, strict=True
        ):
            g = shrink * gradient
            mean += np.float32(0.1) * (g - mean)
            square += np.float32(0.01) * (g * g - square)
            first = mean / np.float32(1.0 - 0.9**self.step)
            second = square / np.float32(1.0 - 0.99**self.step)
            weight -= np.float32(rate) * first / (np.sqrt(second) + np.float32(1e-8))
