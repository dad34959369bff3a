"""An atlas of all textures at all scales, which prevents aliasing.

The image of a slanted surface is compressed mainly in one direction; the road, for example, along its length.
Each texture is therefore stored at all pairs of scales, 2^-i along its columns and 2^-j along its rows (a
ripmap). Each pixel reads the pair of scales that fits its footprint. All textures are in one array, so that
one remap is enough.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

Float32 = NDArray[np.float32]
Int = NDArray[np.int32]

PAD = 2  # texels around each level, so that interpolation at its border stays inside
ATLAS_WIDTH = 8192


@dataclass(frozen=True, eq=False)
class Atlas:
    """T textures, each at all scales, with up to L levels per axis.

    Attributes
    ----------
    texels : (A, B) grey values.
    size : (T, 2) texels along s (columns) and t (rows), powers of two.
    top : (T, 2) coarsest level along s and t.
    wrap : (T, 2) 1 if the texture repeats along s or t, else 0.
    column, row : (T, L) origin of level i: texel s is at column[i] + s / 2**i, texel t at row[i] + t / 2**i.
    """

    texels: Float32
    size: Float32
    top: Float32
    wrap: Float32
    column: Float32
    row: Float32


@dataclass(eq=False)
class TextureSet:
    """The textures of a world by name, collected before the atlas is built."""

    images: list[Float32] = field(default_factory=list)
    wraps: list[tuple[bool, bool]] = field(default_factory=list)
    names: dict[str, int] = field(default_factory=dict)

    def add(self, name: str, image: NDArray[np.generic], wrap: tuple[bool, bool] = (False, False)) -> int:
        """Add a texture with power-of-two sides; return its number. `wrap` : whether s and t repeat."""
        self.names[name] = len(self.images)
        self.images.append(np.asarray(image, np.float32))
        self.wraps.append(wrap)
        return self.names[name]

    def size(self, texture: int) -> tuple[int, int]:
        """Numbers of texels of a texture along s and along t."""
        rows, columns = self.images[texture].shape
        return columns, rows

    def build(self) -> Atlas:
        """Shrink every texture to all pairs of scales, and arrange the results in the atlas."""
        count = len(self.images)
        size = np.array([self.size(k) for k in range(count)], np.int64)
        top = np.log2(size).astype(np.int64) - 2
        # Of each texture, the starts of the levels along s and along t.
        starts = []
        for k in range(count):
            along_s = _starts(int(size[k, 0]), int(top[k, 0]))
            along_t = _starts(int(size[k, 1]), int(top[k, 1]))
            starts.append((along_s, along_t))
        sizes = [(along_s[-1], along_t[-1]) for along_s, along_t in starts]
        corner, rows = _arrange(sizes)
        texels = np.zeros((rows, ATLAS_WIDTH), np.float32)
        levels = int(top.max()) + 1
        column = np.zeros((count, levels), np.float32)
        row = np.zeros((count, levels), np.float32)
        for k, image in enumerate(self.images):
            along_s, along_t = starts[k]
            x_of_level = corner[k, 0] + np.array(along_s[:-1])
            y_of_level = corner[k, 1] + np.array(along_t[:-1])
            _write_levels(texels, image, self.wraps[k], x_of_level, y_of_level)
            # Texel centres are at halves of the texture's own coordinate, at integers of the atlas.
            column[k, : top[k, 0] + 1] = x_of_level + PAD - 0.5
            row[k, : top[k, 1] + 1] = y_of_level + PAD - 0.5
        wrap = np.array(self.wraps, np.float32)
        return Atlas(texels, size.astype(np.float32), top.astype(np.float32), wrap, column, row)


def _arrange(blocks: list[tuple[int, int]]) -> tuple[NDArray[np.int64], int]:
    """Places of blocks on shelves, highest blocks first: corners (x, y) (T, 2), and the rows that they need.

    blocks : width and height of each block, texels.
    """
    corner = np.zeros((len(blocks), 2), np.int64)
    x = 0
    y = 0
    shelf_height = 0
    for k in sorted(range(len(blocks)), key=lambda k: (-blocks[k][1], k)):
        width, height = blocks[k]
        if x + width > ATLAS_WIDTH:
            x = 0
            y += shelf_height
            shelf_height = 0
        corner[k] = x, y
        x += width
        shelf_height = max(shelf_height, height)
    return corner, y + shelf_height


def _write_levels(
    texels: Float32,
    image: Float32,
    wrap: tuple[bool, bool],
    x_of_level: NDArray[np.int64],
    y_of_level: NDArray[np.int64],
) -> None:
    """Write a texture at all pairs of scales into the atlas; each scale along s and t has its own place."""
    # Sharp painted edges would shimmer: details finer than a texel are removed.
    soft = cv2.GaussianBlur(_pad(image, wrap), (5, 5), 0.6)
    across = np.ascontiguousarray(soft[PAD:-PAD, PAD:-PAD], np.float32)
    for i, x in enumerate(x_of_level):
        if i > 0:
            across = _halve(across, wrap[0])
        level = across
        for j, y in enumerate(y_of_level):
            if j > 0:
                level = _halve(level.T, wrap[1]).T
            padded = _pad(level, wrap)
            texels[y : y + padded.shape[0], x : x + padded.shape[1]] = padded


def _starts(size: int, top: int) -> list[int]:
    """Start of each padded level, and the total length of the levels, in texels."""
    return [0, *np.cumsum([(size >> i) + 2 * PAD for i in range(top + 1)]).tolist()]


def _pad(image: Float32, wrap: tuple[bool, bool]) -> Float32:
    """The texture with padding: copies of the opposite side along repeated axes, otherwise of the border."""
    border_s = cv2.BORDER_WRAP if wrap[0] else cv2.BORDER_REPLICATE
    border_t = cv2.BORDER_WRAP if wrap[1] else cv2.BORDER_REPLICATE
    wide = cv2.copyMakeBorder(np.ascontiguousarray(image), 0, 0, PAD, PAD, border_s)
    return np.asarray(cv2.copyMakeBorder(wide, PAD, PAD, 0, 0, border_t), np.float32)


def _halve(image: Float32, wrap: bool) -> Float32:
    """The texture with half as many columns, low-passed by (1, 3, 3, 1)/8, without a shift."""
    border = cv2.BORDER_WRAP if wrap else cv2.BORDER_REPLICATE
    wide = cv2.copyMakeBorder(np.ascontiguousarray(image), 0, 0, 1, 1, border)
    outer = wide[:, 0:-2:2] + wide[:, 3::2]
    inner = wide[:, 1:-1:2] + wide[:, 2:-1:2]
    return np.asarray(0.125 * outer + 0.375 * inner, np.float32)
