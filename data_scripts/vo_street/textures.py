"""Painted textures of the street: grey values 0-255, sides powers of two, details at many scales."""

from __future__ import annotations

import itertools

import cv2
import numpy as np
from numpy.typing import NDArray

from vo_lib.geometry.types import Array

Image = NDArray[np.float32]
Rng = np.random.Generator


def fractal(rng: Rng, rows: int, columns: int, slope: float, coarsest: float = 1.0) -> Image:
    """Periodic noise of mean 0 and standard deviation 1, with amplitude proportional to frequency ** -slope.

    `coarsest` is the lowest frequency in the noise, in waves across the texture.
    """
    white = rng.standard_normal((rows, columns), dtype=np.float32)
    fy = np.float32(max(rows, columns)) * np.fft.fftfreq(rows)[:, None].astype(np.float32)
    fx = np.float32(max(rows, columns)) * np.fft.rfftfreq(columns)[None, :].astype(np.float32)
    radius = np.sqrt(fx * fx + fy * fy)
    weight = np.where(radius >= coarsest, np.maximum(radius, 1.0) ** -slope, 0.0).astype(np.float32)
    noise = np.fft.irfft2(np.fft.rfft2(white) * weight, s=(rows, columns))
    noise -= noise.mean()
    return np.asarray(noise / noise.std(), np.float32)


def without_stripes(image: Image) -> Image:
    """The texture with equal means of all rows and columns.

    On a plane with a repeated texture, a dark row would be visible as a line to the vanishing point.
    """
    mean = image.mean()
    image = image - (image.mean(axis=1, keepdims=True) - mean)
    return np.asarray(image - (image.mean(axis=0, keepdims=True) - mean), np.float32)


def plain(grey: float, rows: int, columns: int, rng: Rng, rough: float = 4.0) -> Image:
    """A surface of one grey value with dirt at a large scale and grain at a small scale."""
    dirt = fractal(rng, rows, columns, 1.4)
    grain = fractal(rng, rows, columns, 0.2, 8.0)
    return np.asarray(grey + rough * dirt + 0.6 * rough * grain, np.float32)


def smeared(image: Image, length: int) -> Image:
    """The texture averaged along columns, which makes furrows or streaks of rain."""
    return np.asarray(cv2.blur(image, (1, length), borderType=cv2.BORDER_REFLECT), np.float32)


def box(image: Image, x0: float, y0: float, x1: float, y1: float, grey: float) -> None:
    """Draw a filled rectangle; the coordinates are texels."""
    cv2.rectangle(image, (round(x0), round(y0)), (round(x1) - 1, round(y1) - 1), float(grey), -1)


def letters(image: Image, text: str, at: tuple[int, int], scale: float, grey: float, thick: int) -> None:
    """Write text with its lower left corner at (column, row)."""
    mask = np.zeros(image.shape, np.uint8)
    cv2.putText(mask, text, at, cv2.FONT_HERSHEY_DUPLEX, scale, 255, thick, cv2.LINE_AA)
    blend(image, np.asarray(mask / np.float32(255), np.float32), grey)


def blend(image: Image, mask: Image, grey: Image | float) -> None:
    """Paint `grey` where the mask is 1."""
    image += mask * (grey - image)


# --- ground -------------------------------------------------------------------------------------------------


def asphalt(rng: Rng, lanes: int, width: float, length: float, solid_centre: bool) -> Image:
    """A stretch of road, periodic along the road. Row indices increase to the right, column indices ahead.

    Parameters
    ----------
    lanes : number of lanes per direction. width, length : size of the stretch, metres.
    solid_centre : whether the centre line is solid.
    """
    rows = 1024
    columns = 1024
    per_m = np.array([columns / length, rows / width])
    rough = 0.6 + 0.4 * (fractal(rng, rows, columns, 1.0) > 0)
    image = plain(96.0, rows, columns, rng, 5.0) + 9.0 * fractal(rng, rows, columns, 0.0, 20.0) * rough
    _mend(image, rng, per_m, width, length)
    _crack(image, rng, per_m, width, length)
    for _ in range(int(rng.integers(30, 60))):  # stones, leaves, spots
        x, y, a, b = (rng.uniform(0.02, 0.98, 4) * (columns, rows, 6, 6)).astype(int).tolist()
        grey = float(rng.choice([45.0, 60.0, 140.0, 165.0]))
        turn = float(rng.uniform(0, 180))
        cv2.ellipse(image, (x, y), (a + 1, b + 1), turn, 0, 360, grey, -1)
    if rng.random() < 0.7:
        at = np.array([rng.uniform(2, length - 2), width / 2 + rng.choice([-1.4, 1.7])])
        _manhole(image, at * per_m, per_m)
    lines = np.zeros_like(image)
    for k in range(-lanes, lanes + 1):
        y = (width / 2 + k * 3.3) * per_m[1]
        half = 0.07 * per_m[1]
        broken = abs(k) < lanes and not (k == 0 and solid_centre)
        # Where the line begins and ends, as shares of the stretch.
        first = 0.25 if broken else 0.0
        last = 0.6 if broken else 1.0
        box(lines, first * columns, y - half, last * columns, y + half, 1.0)
    wear = np.clip(0.9 + 0.16 * fractal(rng, rows, columns, 0.8, 4.0), 0.35, 1.0)
    blend(image, lines * wear, 215.0)
    return np.asarray(image, np.float32)


def _mend(image: Image, rng: Rng, per_m: Array, width: float, length: float) -> None:
    """Paint rectangles of newer or older asphalt, sealed with tar."""
    for _ in range(int(rng.integers(2, 5))):
        size = rng.uniform((0.6, 0.5), (4.0, 1.6))
        start = rng.uniform((0.3, 0.2), np.array([length, width]) - size - 0.3)
        x0, y0, x1, y1 = (np.concatenate([start, start + size]) * [*per_m, *per_m]).astype(int).tolist()
        image[y0:y1, x0:x1] += rng.choice([-1.0, 1.0]) * rng.uniform(8.0, 22.0)
        cv2.rectangle(image, (x0, y0), (x1, y1), 58.0, 2)


def _crack(image: Image, rng: Rng, per_m: Array, width: float, length: float) -> None:
    """Crooked cracks."""
    for _ in range(int(rng.integers(3, 7))):
        steps = rng.normal(0, 0.25, (14, 2)) + rng.normal(0, 0.3, 2)
        path = np.cumsum(steps, axis=0) + rng.uniform(0.2, 0.8, 2) * (length, width)
        path[:, 0] = np.clip(path[:, 0], 0.2, length - 0.2)
        cv2.polylines(image, [np.rint(path * per_m).astype(np.int32)], False, 52.0, 2)


def _manhole(image: Image, at: Array, per_m: Array) -> None:
    """A manhole cover with ribs, 64 cm in diameter."""
    x, y = np.rint(at).astype(int).tolist()
    a, b = np.rint(0.32 * per_m).astype(int).tolist()
    cv2.ellipse(image, (x, y), (a, b), 0, 0, 360, 62.0, -1)
    cv2.ellipse(image, (x, y), (a, b), 0, 0, 360, 130.0, 2)
    for k in (-0.55, -0.18, 0.18, 0.55):
        rib = x + round(k * a)
        reach = round(0.6 * b)
        cv2.line(image, (rib, y - reach), (rib, y + reach), 118.0, 3)


def slabs(rng: Rng) -> Image:
    """Pavement slabs with different grey values; periodic along the pavement."""
    image = plain(138.0, 256, 512, rng, 4.0)
    ys = np.linspace(0, 256, 6)
    xs = np.linspace(0, 512, 11)
    for y0, y1 in itertools.pairwise(ys.astype(int)):
        for x0, x1 in itertools.pairwise(xs.astype(int)):
            image[y0:y1, x0:x1] += rng.normal(0, 9.0)
            box(image, x0, y0, x1, y0 + 2, 84.0)
            box(image, x0, y0, x0 + 2, y1, 88.0)
    return image


def kerb(rng: Rng) -> Image:
    """Kerb stones in the view from the road; periodic along the kerb."""
    image = plain(160.0, 16, 256, rng, 6.0)
    for k in range(4):
        image[:, 64 * k : 64 * k + 2] = 80.0
        image[:, 64 * k : 64 * k + 64] += rng.normal(0, 8.0)
    return image


def grass(rng: Rng) -> Image:
    """Lawn: blades and clumps; periodic along both axes."""
    image = 92.0 + 13.0 * fractal(rng, 512, 512, 0.9) + 12.0 * fractal(rng, 512, 512, 0.1, 24.0)
    return without_stripes(np.clip(image, 25, 190))


def leaves(rng: Rng, size: int = 256, mean: float = 78.0, count: int = 1400) -> Image:
    """Foliage: overlapping leaves from dark to light; periodic along both axes."""
    image = np.asarray(mean * 0.55 + 10.0 * fractal(rng, size, size, 1.0), np.float32)
    for k in range(count):
        x, y = rng.integers(0, size, 2)
        axes = (int(rng.integers(2, 9)), int(rng.integers(1, 5)))
        grey = float(mean * (0.5 + 0.9 * k / count) * rng.uniform(0.7, 1.3))
        angle = float(rng.uniform(0, 180))
        for dx, dy in itertools.product((-size, 0, size), repeat=2):
            at = (int(x + dx), int(y + dy))
            if min(at) > -10 and max(at) < size + 10:
                cv2.ellipse(image, at, axes, angle, 0, 360, grey, -1, cv2.LINE_AA)
    return np.asarray(image + 18.0 * fractal(rng, size, size, 1.2), np.float32)


def bark(rng: Rng) -> Image:
    """Tree bark: furrows along the trunk; periodic round the trunk."""
    noise = fractal(rng, 256, 64, 0.7)
    return np.asarray(72.0 + 20.0 * smeared(noise, 9) + 6 * noise, np.float32)


def boards(rng: Rng, count: int, grey: float, gap: int = 4) -> Image:
    """A board fence, dark between the boards; periodic along the fence."""
    image = plain(grey, 128, 512, rng, 5.0)
    wide = 512 // count
    for k in range(count):
        x = wide * k
        image[:, x : x + wide] += rng.normal(0, 14.0)
        image[:, x + wide - gap : x + wide] = 28.0
        image[: int(rng.integers(0, 6)), x : x + wide] = 40.0
        for y in (26, 100):
            cv2.circle(image, (x + (wide - gap) // 2, y), 2, 50.0, -1, cv2.LINE_AA)
    return image


def masonry(
    rng: Rng, rows: int, columns: int, course: int, stone: int, grey: float, spread: float, joint: float
) -> Image:
    """Staggered rows of bricks or blocks of `stone` × `course` texels with different grey values."""
    lines = rows // course + 1
    across = columns // stone + 2
    greys = (grey + spread * rng.standard_normal((lines, across))).astype(np.float32)
    y, x = np.mgrid[0:rows, 0:columns]
    line = y // course
    shifted = x + (line % 2) * (stone // 2)
    image = greys[line, shifted // stone] + plain(0.0, rows, columns, rng, 3.0)
    image[(y % course == 0) | (shifted % stone == 0)] = joint
    return np.asarray(image, np.float32)


def roof_tiles(rng: Rng, grey: float) -> Image:
    """Rows of roof tiles with moss; periodic along the rows."""
    image = masonry(rng, 256, 512, 16, 16, grey, 9.0, grey * 0.55)
    y = np.arange(256)[:, None] % 16
    return np.asarray(image * (0.82 + 0.022 * y) + 9.0 * fractal(rng, 256, 512, 1.2), np.float32)


def concrete(rng: Rng) -> Image:
    """A concrete wall of panels; periodic along the wall."""
    image = plain(150.0, 256, 512, rng, 7.0)
    for x in range(0, 512, 128):
        image[:, x : x + 3] = 92.0
        for y in (60, 190):
            for dx in (30, 98):
                cv2.circle(image, (x + dx, y), 3, 95.0, -1, cv2.LINE_AA)
    image[:6] = 118.0
    return np.asarray(image + 22.0 * smeared(fractal(rng, 256, 512, 0.6), 65), np.float32)


def rail(rng: Rng) -> Image:
    """A crash barrier's beam: two bright waves, bolts at every post; periodic along the beam."""
    y = np.linspace(0, 2 * np.pi, 32)[:, None]
    image = 150.0 + 45.0 * np.sin(y + 0.6) + plain(0.0, 32, 512, rng, 4.0)
    image[:2] = 80.0
    image[-2:] = 70.0
    for x in (64, 320):
        cv2.circle(image, (x, 16), 4, 70.0, -1, cv2.LINE_AA)
        cv2.rectangle(image, (x + 20, 3), (x + 22, 28), 95.0, -1)
    return np.asarray(image, np.float32)


def sign(rng: Rng, kind: int) -> Image:
    """Face of a traffic sign: 0 limit, 1 warning, 2 crossing, 3 place name, 4 chevrons, 5 direction."""
    image = np.full((128, 128), 150.0, np.float32)
    dark = 40.0
    light = 235.0
    if kind == 0:
        cv2.circle(image, (64, 64), 60, 90.0, -1, cv2.LINE_AA)
        cv2.circle(image, (64, 64), 46, light, -1, cv2.LINE_AA)
        text = str(rng.choice(["30", "50", "70"]))
        letters(image, text, (26, 82), 1.9, dark, 5)
    elif kind == 1:
        cv2.fillPoly(image, [np.array([[64, 8], [122, 114], [6, 114]])], 90.0, cv2.LINE_AA)
        cv2.fillPoly(image, [np.array([[64, 34], [100, 102], [28, 102]])], light, cv2.LINE_AA)
        cv2.line(image, (64, 54), (64, 80), dark, 8, cv2.LINE_AA)
        cv2.circle(image, (64, 93), 5, dark, -1, cv2.LINE_AA)
    elif kind == 2:
        image[:] = 70.0
        cv2.fillPoly(image, [np.array([[64, 18], [112, 108], [16, 108]])], light, cv2.LINE_AA)
        for x in (40, 58, 76):
            cv2.line(image, (x, 104), (x + 8, 84), dark, 6, cv2.LINE_AA)
        cv2.circle(image, (64, 48), 7, dark, -1, cv2.LINE_AA)
        cv2.line(image, (64, 54), (60, 84), dark, 9, cv2.LINE_AA)
    elif kind == 4:
        image[:] = light
        for x in range(-32, 128, 48):
            cv2.polylines(image, [np.array([[x, 8], [x + 36, 64], [x, 120]])], False, dark, 18, cv2.LINE_AA)
    else:
        image[:] = light if kind == 3 else 75.0
        ink = dark if kind == 3 else light
        cv2.rectangle(image, (5, 5), (122, 122), ink, 4)
        for y in (48, 92):
            word = "".join(rng.choice(list("ABDEGHKLMNORSTUW"), 5))
            letters(image, word, (14, y), 1.0, ink, 3)
    return np.asarray(image + plain(0.0, 128, 128, rng, 2.0), np.float32)


def clouds(rng: Rng) -> Image:
    """Sky from below: soft clouds on a bright background; periodic along both axes."""
    cover = fractal(rng, 1024, 1024, 1.7, 2.0)
    return without_stripes(196.0 + 46.0 * np.clip(cover, -0.6, 1.4) / 1.4)
