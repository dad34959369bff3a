"""A compact anchor-free detector: one box and one score a class at each cell of strides 8, 16 and 32.

The box's centre is predicted relative to the cell's, its size as a logarithm, both in strides; a class score
says at once whether there is a vehicle and what it is. The exported output is laid out as YOLOv8's is:
[1, 4 + C, N], boxes as centre and size in pixels of the network's image, scores in 0..1.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn
from torch.nn import functional as F

STRIDES = (8, 16, 32)
WIDTHS = (16, 32, 48, 80, 112)  # channels at strides 2, 4, 8, 16 and 32
NECK = 48
LARGEST = 5.0  # logarithm of the largest size, in strides
PRIOR = 0.01  # score of an untrained network: most cells hold nothing


class Conv(nn.Sequential):
    """Convolution, batch normalisation, ReLU."""

    def __init__(self, inputs: int, outputs: int, size: int = 3, stride: int = 1):
        super().__init__(
            nn.Conv2d(inputs, outputs, size, stride, size // 2, bias=False),
            nn.BatchNorm2d(outputs, momentum=0.03, eps=1e-3),
            nn.ReLU(inplace=True),
        )


class Split(nn.Module):
    """Half of the channels pass residual 3×3 convolutions, the other half goes round them."""

    def __init__(self, channels: int, depth: int):
        super().__init__()
        half = channels // 2
        self.enter = Conv(channels, channels, 1)
        self.steps = nn.ModuleList(nn.Sequential(Conv(half, half), Conv(half, half)) for _ in range(depth))
        self.leave = Conv(channels, channels, 1)

    def forward(self, x: Tensor) -> Tensor:
        """(B, channels, H, W) to the same."""
        round_about, way = self.enter(x).chunk(2, 1)
        for step in self.steps:
            way = way + step(way)
        mixed: Tensor = self.leave(torch.cat([round_about, way], 1))
        return mixed


class Detector(nn.Module):
    """The whole network: backbone, feature pyramid down and up again, one head shared by box and class."""

    def __init__(self, classes: int):
        super().__init__()
        self.classes = classes
        a, b, c, d, e = WIDTHS
        self.stem = nn.Sequential(Conv(3, a, 3, 2), Conv(a, b, 3, 2), Split(b, 1))
        self.stage8 = nn.Sequential(Conv(b, c, 3, 2), Split(c, 2))
        self.stage16 = nn.Sequential(Conv(c, d, 3, 2), Split(d, 2))
        self.stage32 = nn.Sequential(Conv(d, e, 3, 2), Split(e, 1))
        n = NECK
        self.side = nn.ModuleList(Conv(k, n, 1) for k in (c, d, e))
        self.down16, self.down8 = Conv(n, n), Conv(n, n)
        self.step16, self.step32 = Conv(n, n, 3, 2), Conv(n, n, 3, 2)
        self.up16, self.up32 = Conv(n, n), Conv(n, n)
        last = [nn.Conv2d(n, 4 + classes, 1) for _ in STRIDES]
        self.heads = nn.ModuleList(nn.Sequential(Conv(n, n), conv) for conv in last)
        for conv in last:
            bias = conv.bias
            assert bias is not None
            with torch.no_grad():
                bias[:2], bias[2:4] = 0.0, math.log(3.0)
                bias[4:] = math.log(PRIOR / (1 - PRIOR))

    def forward(self, images: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Predictions for images (B, 3, H, W) in 0..1, H and W multiples of 32, at all N cells.

        Returns
        -------
        corners : (B, N, 4) x0, y0, x1, y1, pixels of the images (outer edges: 0 to W).
        logits : (B, N, C) class scores before the sigmoid.
        cells : (N, 3) centre x, y and stride of each cell, pixels.
        """
        at8 = self.stage8(self.stem(images))
        at16 = self.stage16(at8)
        at32 = self.stage32(at16)
        side8, side16, side32 = (conv(x) for conv, x in zip(self.side, (at8, at16, at32), strict=True))
        mixed16 = self.down16(side16 + F.interpolate(side32, scale_factor=2.0, mode="nearest"))
        out8 = self.down8(side8 + F.interpolate(mixed16, scale_factor=2.0, mode="nearest"))
        out16 = self.up16(mixed16 + self.step16(out8))
        out32 = self.up32(side32 + self.step32(out16))
        raw, places = [], []
        for head, features, stride in zip(self.heads, (out8, out16, out32), STRIDES, strict=True):
            raw.append(head(features).flatten(2).transpose(1, 2))
            places.append(cells_of(features, stride))
        everything, cells = torch.cat(raw, 1), torch.cat(places)
        centre = cells[:, :2] + everything[..., :2] * cells[:, 2:]
        half = 0.5 * torch.exp(everything[..., 2:4].clamp(max=LARGEST)) * cells[:, 2:]
        corners = torch.cat([centre - half, centre + half], -1)
        return corners, everything[..., 4:], cells


def cells_of(features: Tensor, stride: int) -> Tensor:
    """Centre x, y and stride (h·w, 3) of the cells of a feature map (B, C, h, w), pixels of the image.

    Running sums instead of ranges: the exported network then takes any image size.
    """
    ones = torch.ones_like(features[0, 0])
    x, y = torch.cumsum(ones, 1) - 0.5, torch.cumsum(ones, 0) - 0.5
    return torch.stack([x * stride, y * stride, ones * stride], -1).reshape(-1, 3)


class Exported(nn.Module):
    """The network as it is shipped: images (B, 3, H, W) to (B, 4 + C, N), YOLOv8's layout."""

    def __init__(self, detector: Detector):
        super().__init__()
        self.detector = detector
        self.eval()

    def forward(self, images: Tensor) -> Tensor:
        """Centre x, y, width, height in pixels and the class scores of every cell."""
        corners, logits, _ = self.detector(images)
        low, high = corners[..., :2], corners[..., 2:]
        return torch.cat([0.5 * (low + high), high - low, logits.sigmoid()], -1).transpose(1, 2)
