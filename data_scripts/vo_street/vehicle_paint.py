"""The painted views of a vehicle: sides, front, rear and top, drawn in metres."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from .shapes import TRUCK, Cabin, Shape
from .textures import Image, Rng, letters, plain

VIEWS = ("right", "left", "front", "rear", "top")
GLASS = 34.0  # grey of windows
SEAM = 0.5  # brightness of the gaps round doors, as a share of the paint


def paint_wheel(rng: Rng) -> Image:
    """Texture of a wheel: tyre, rim and spokes."""
    image = np.full((128, 128), 30.0, np.float32)
    cv2.circle(image, (64, 64), 44, 175.0, -1, cv2.LINE_AA)
    for k in range(5):
        middle = 2 * np.pi * k / 5 + 0.3
        wedge = []
        for radius, turn in ((16, -0.4), (38, -0.42), (38, 0.42), (16, 0.4)):
            angle = middle + turn
            wedge.append([64 + radius * np.cos(angle), 64 + radius * np.sin(angle)])
        cv2.fillPoly(image, [np.round(wedge).astype(np.int32)], 52.0, cv2.LINE_AA)
    cv2.circle(image, (64, 64), 9, 120.0, -1, cv2.LINE_AA)
    return np.asarray(image + plain(0.0, 128, 128, rng, 2.0), np.float32)


class _Canvas:
    """A picture that is drawn in metres at twice its final resolution.

    A point has its distance x from the left edge and its height h above the ground.
    """

    def __init__(self, rows: int, columns: int, width: float, height: float, grey: float):
        self.image: Image = np.full((2 * rows, 2 * columns), grey, np.float32)
        self.scale = np.array([2 * columns / width, 2 * rows / height])
        self.width = width
        self.height = height

    def at(self, points: object) -> NDArray[np.int32]:
        """Texels (N, 2) of points (N, 2), metres."""
        xh = np.asarray(points, float).reshape(-1, 2)
        texels = np.stack([xh[:, 0], self.height - xh[:, 1]], axis=1) * self.scale
        return np.asarray(np.rint(texels), np.int32)

    def fill(self, points: object, grey: float) -> None:
        """Draw a filled polygon."""
        cv2.fillPoly(self.image, [self.at(points)], float(grey), cv2.LINE_AA)

    def rect(self, x0: float, h0: float, x1: float, h1: float, grey: float) -> None:
        """Draw a filled rectangle with two opposite corners."""
        self.fill([[x0, h0], [x0, h1], [x1, h1], [x1, h0]], grey)

    def pair(self, x0: float, h0: float, x1: float, h1: float, grey: float) -> None:
        """Draw a rectangle on the left and its mirror image on the right."""
        self.rect(x0, h0, x1, h1, grey)
        self.rect(self.width - x1, h0, self.width - x0, h1, grey)

    def line(self, points: object, grey: float, thick: int = 2) -> None:
        """Draw a line from point to point; `thick` is in texels."""
        cv2.polylines(self.image, [self.at(points)], False, float(grey), thick, cv2.LINE_AA)

    def disc(self, x: float, h: float, radius: float, grey: float) -> None:
        """Draw a filled circle."""
        axes = np.round(radius * self.scale).astype(int)
        cv2.ellipse(
            self.image, self.at([x, h])[0].tolist(), axes.tolist(), 0, 0, 360, float(grey), -1, cv2.LINE_AA
        )

    def done(self, rng: Rng) -> Image:
        """The picture at its final resolution, with some dirt."""
        rows = self.image.shape[0] // 2
        columns = self.image.shape[1] // 2
        small = cv2.resize(self.image, (columns, rows), interpolation=cv2.INTER_AREA)
        return np.asarray(small + plain(0.0, rows, columns, rng, 1.6), np.float32)


def paint_vehicle(shape: Shape, paint: float, rng: Rng) -> dict[str, Image]:
    """The views of a vehicle in one colour, with the names in `VIEWS` as keys."""
    return {
        "right": _paint_side(shape, paint, rng, mirror=False),
        "left": _paint_side(shape, paint, rng, mirror=True),
        "front": _paint_end(shape, paint, rng, front=True),
        "rear": _paint_end(shape, paint, rng, front=False),
        "top": _paint_top(shape, paint, rng),
    }


def _paint_end(shape: Shape, paint: float, rng: Rng, front: bool) -> Image:
    """Front or rear of a vehicle."""
    if shape.cabin is None:
        return _paint_large_end(shape, paint, rng, front)
    return _paint_car_end(shape, shape.cabin, paint, rng, front)


def _paint_side(shape: Shape, paint: float, rng: Rng, mirror: bool) -> Image:
    """Side view with the front on the right; `mirror` flips the picture, but not the lettering."""
    c = _Canvas(128, 512, shape.length, shape.height, paint)
    mid = shape.length / 2
    if shape.cabin is None:
        _paint_flat_side(c, shape, paint)
    else:
        _paint_car_side(c, shape, shape.cabin, paint)
    for z in shape.wheels:
        c.disc(mid + z, shape.radius, shape.radius * 1.22, 18.0)
    if mirror:
        c.image = np.ascontiguousarray(c.image[:, ::-1])
    if shape.kind == TRUCK:
        word = str(rng.choice(["CARGO", "NORD", "ALPINA", "EXPRESS"]))
        column, row = c.at([0.9 if not mirror else shape.length - 5.6, 1.7])[0].tolist()
        letters(c.image, word, (column, row), 3.0, 225.0 if paint < 120 else 40.0, 8)
    return c.done(rng)


def _paint_car_side(c: _Canvas, shape: Shape, cabin: Cabin, paint: float) -> None:
    """Side of a car: windows between the pillars, doors, lamps."""
    mid = shape.length / 2
    rear_base, rear_roof, front_roof, front_base, low, high = cabin
    c.rect(0, 0.62, shape.length, 0.66, paint * 0.8 + 6)  # a crease is darker
    c.rect(0, 0.2, shape.length, 0.34, paint * 0.45)
    base = low + 0.05
    roof = high - 0.07
    share = (roof - base) / (high - low)
    rear_top = [mid + rear_base + (rear_roof - rear_base) * share + 0.12, roof]
    front_top = [mid + front_base + (front_roof - front_base) * share - 0.12, roof]
    c.fill([[mid + rear_base + 0.12, base], rear_top, front_top, [mid + front_base - 0.14, base]], GLASS)
    # The sky in the upper part of the windows.
    c.fill([rear_top, front_top, [front_top[0] - 0.1, roof - 0.12], [rear_top[0], roof - 0.1]], 78.0)
    doors = [front_roof - 0.25, front_roof - 1.25]
    if shape.length < 4.2:
        doors = [front_roof - 0.35]
    is_dark = paint < 120
    pillar = 22.0 if is_dark else paint * 0.5
    handle = 190.0 if is_dark else 60.0
    for z in doors:
        c.rect(mid + z - 0.05, base, mid + z + 0.05, roof, pillar)
        c.line([[mid + z, low], [mid + z, 0.3]], paint * SEAM)
        c.rect(mid + z + 0.12, low - 0.14, mid + z + 0.32, low - 0.1, handle)
    front_door = front_base - 0.18
    c.line([[mid + front_door, low], [mid + front_door - 0.03, 0.3]], paint * SEAM)
    c.line([[mid + doors[-1] - 0.95, low], [mid + doors[-1] - 0.8, 0.62]], paint * SEAM)
    c.rect(shape.length - 0.34, 0.66, shape.length, 0.78, 235.0)
    c.rect(0, 0.72, 0.2, 0.9, 120.0)


def _paint_flat_side(c: _Canvas, shape: Shape, paint: float) -> None:
    """Side of a bus or a truck: windows, a stripe, and lettering on the load."""
    mid = shape.length / 2
    low, high = shape.band
    c.rect(0, 0.0, shape.length, 0.62, 60.0)
    if shape.kind == TRUCK:
        c.rect(mid + 2.2, 0.4, shape.length, 2.9, 0.85 * paint + 12)
        load = mid + 2.15
        for z in np.arange(0.4, load, 0.55):
            c.rect(z, 1.0, z + 0.03, 3.45, paint * 0.72)
        c.rect(0.3, 2.8, load - 0.3, 2.95, 225.0 if paint < 120 else 40.0)
        c.rect(0, 0.9, load, 1.0, 40.0)
    else:
        c.rect(0, 0.75, shape.length, 0.95, 220.0 if paint < 150 else 70.0)
        c.rect(mid + 3.6, 0.5, mid + 4.8, 2.6, 30.0)
        c.rect(mid + 4.18, 0.5, mid + 4.22, 2.6, 150.0)
    for z0, z1 in shape.windows:
        c.rect(mid + z0, low, mid + z1, high, GLASS)
        c.fill([[mid + z0, high], [mid + z0 + 0.5 * (z1 - z0), high], [mid + z0, low + 0.3]], 72.0)


def _paint_car_end(shape: Shape, cabin: Cabin, paint: float, rng: Rng, front: bool) -> Image:
    """Front or rear of a car: window, lamps, grille or boot lid, number plate."""
    w = shape.width
    low = cabin.base_height + 0.04
    high = cabin.roof_height - 0.05
    c = _Canvas(128, 128, w, shape.height, paint)
    c.fill([[0.13, low], [0.27, high], [w - 0.27, high], [w - 0.13, low]], GLASS)
    c.fill([[0.3, high - 0.05], [0.8, high - 0.05], [0.5, low + 0.1], [0.22, low + 0.1]], 70.0)
    c.rect(0, 0.2, w, 0.36, 45.0)
    if front:
        c.rect(0.45, 0.5, w - 0.45, 0.68, 28.0)
        for k in np.arange(0.52, w - 0.45, 0.1):
            c.rect(k, 0.5, k + 0.02, 0.68, 110.0)
        c.pair(0.05, 0.6, 0.38, 0.76, 240.0)
        c.disc(w / 2, 0.72, 0.06, 210.0)
    else:
        c.pair(0.04, 0.68, 0.28, 0.92, 85.0)
        c.line([[0.1, 0.62], [w - 0.1, 0.62]], paint * SEAM)
        c.rect(w / 2 - 0.3, 0.9, w / 2 + 0.3, 0.93, 180.0)
    _plate(c, w / 2, 0.38 if front else 0.7)
    return c.done(rng)


def _paint_large_end(shape: Shape, paint: float, rng: Rng, front: bool) -> Image:
    """Front or rear of a bus or a truck: windscreen and lamps, or doors with bars and a striped bumper."""
    w = shape.width
    h = shape.height
    c = _Canvas(128, 128, w, h, paint)
    if front:
        c.rect(0.12, 1.5, w - 0.12, 2.6, GLASS)
        c.fill([[0.3, 2.5], [1.0, 2.5], [0.6, 1.65], [0.3, 1.65]], 70.0)
        c.pair(0.15, 0.62, 0.5, 0.85, 240.0)
        c.rect(0.6, 0.75, w - 0.6, 1.2, 40.0)
    else:
        c.line([[w / 2, 0.95], [w / 2, h - 0.1]], paint * SEAM, 5)
        for x in (0.35, w / 2 - 0.25, w / 2 + 0.25, w - 0.35):
            c.line([[x, 1.0], [x, h - 0.15]], 150.0 if paint < 120 else 70.0, 4)
        c.line([[0.05, h - 0.06], [w - 0.05, h - 0.06]], 60.0, 6)
        c.rect(0, 0.3, w, 1.0, 50.0)
        c.pair(0.1, 0.75, 0.5, 0.9, 120.0)
        for k in range(6):
            c.rect(k * w / 6, 1.05, k * w / 6 + w / 12, 1.15, 235.0)
    _plate(c, w / 2, 0.45)
    return c.done(rng)


def _plate(c: _Canvas, middle: float, low: float) -> None:
    """A number plate."""
    c.rect(middle - 0.26, low, middle + 0.26, low + 0.12, 235.0)
    for k in (0, 1, 3, 4, 5, 6):
        x = middle - 0.22 + 0.065 * k
        c.rect(x, low + 0.025, x + 0.04, low + 0.095, 35.0)


def _paint_top(shape: Shape, paint: float, rng: Rng) -> Image:
    """View from above, with the front on the right: two creases on the bonnet."""
    c = _Canvas(128, 256, shape.length, shape.width, paint * 1.06)
    for near, far in ((0.25, 0.35), (shape.width - 0.25, shape.width - 0.35)):
        c.line([[shape.length * 0.76, near], [shape.length * 0.97, far]], paint * 0.75)
    return c.done(rng)
