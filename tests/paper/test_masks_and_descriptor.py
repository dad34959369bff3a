"""The responses of the two 5×5 masks and the pixels of the descriptor are as in StereoScan.

StereoScan (Geiger, Ziegler and Stiller 2011), section III: blob and corner masks of 5×5, and the horizontal
and the vertical Sobel response at 16 positions in an 11×11 block.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from vo_lib.geometry.types import Image
from vo_lib.paper.features import DescribedFeatures, describe
from vo_lib.paper.settings import FeatureConfig

BLOB_UP, BLOB_DOWN, CORNER_UP, CORNER_DOWN = range(4)
CENTRE = (40, 30)
# In the 11×11 block: the four corners, two positions near the middle of the left and of the right side,
# and four positions in each of the two columns beside the centre.
OUTER = {(u, v) for u in (-5, 5) for v in (-5, -1, 1, 5)}
INNER = {(u, v) for u in (-1, 1) for v in (-3, -1, 1, 3)}


def flat(grey: int = 100) -> Image:
    return np.full((60, 80), grey, np.uint8)


def strongest(result: DescribedFeatures, kind: int) -> tuple[tuple[float, ...], float]:
    """Position and strength of the strongest feature of the given kind."""
    mine = np.flatnonzero(result.kind == kind)
    best = mine[np.argmax(result.strength[mine])]
    return tuple(result.uv[best].tolist()), float(result.strength[best])


@pytest.mark.parametrize(("height", "kind"), [(50, BLOB_UP), (-50, BLOB_DOWN)])
def test_blob_mask_is_strongest_on_a_dot(height: int, kind: int) -> None:
    image, (u, v) = flat(), CENTRE
    image[v - 1 : v + 2, u - 1 : u + 2] += np.int8(height).astype(np.uint8)  # modulo 256
    result = describe(image, FeatureConfig())
    assert strongest(result, kind) == (CENTRE, 16.0 * 50)
    # The other kind of blob has a weaker response beside the dot.
    others = result.strength[result.kind == 1 - kind]
    assert (others < 16.0 * 50 / 2).all()


@pytest.mark.parametrize(("bright", "kind"), [("upper right", CORNER_UP), ("upper left", CORNER_DOWN)])
def test_corner_mask_is_strongest_where_four_fields_meet(bright: str, kind: int) -> None:
    image, (u, v) = flat(), CENTRE
    right, left = slice(u, None), slice(None, u)
    image[:v, right if bright == "upper right" else left] = 180
    image[v:, left if bright == "upper right" else right] = 180
    result = describe(image, FeatureConfig(blob_cell=5))
    place, strength = strongest(result, kind)
    # The crossing is between pixels: at the nearest pixel, the mask is off by half a pixel in u and v.
    assert np.abs(np.array(place) - CENTRE).max() <= 1
    assert strength == pytest.approx(8 * 80, abs=0.5)
    assert not np.any(result.kind == 5 - kind)


def sobel(image: Image, u: int, v: int) -> tuple[int, int]:
    """Horizontal and vertical Sobel response at a pixel, by its definition."""
    block = image[v - 1 : v + 2, u - 1 : u + 2].astype(int)
    weight = np.array([1, 2, 1])
    across = int(weight @ (block[:, 2] - block[:, 0]))
    down = int(weight @ (block[2] - block[0]))
    return across, down


def columns(table: NDArray[Any]) -> list[list[float]]:
    """The columns of a table, in sorted order."""
    return sorted(np.asarray(table, float).T.tolist())


def test_descriptor_has_32_sobel_responses() -> None:
    image = np.random.default_rng(4).integers(0, 255, (60, 80)).astype(np.uint8)
    result = describe(image, FeatureConfig())
    assert len(result.uv) > 10
    assert result.descriptor.shape == (len(result.uv), 32)
    expected = [
        [response for du, dv in sorted(OUTER | INNER) for response in sobel(image, int(u) + du, int(v) + dv)]
        for u, v in result.uv
    ]
    # The order of the 32 numbers is arbitrary, but the same for all features.
    assert columns(result.descriptor) == columns(np.array(expected))
