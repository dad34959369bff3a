"""Vehicle shapes: side views with a width.

Vehicle frame: x right, y down, z forward; origin on the ground under the middle of the vehicle.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

# COCO classes, as YOLO labels number them.
CAR = 2
BUS = 5
TRUCK = 7
PAINTS = (46.0, 105.0, 165.0, 222.0)


class Cabin(NamedTuple):
    """Side view of a car's cabin: z of its four corners, and the heights of its base and its roof, metres."""

    rear_base: float
    rear_roof: float
    front_roof: float
    front_base: float
    base_height: float
    roof_height: float


@dataclass(frozen=True)
class Shape:
    """Side view of a vehicle, metres. z increases from rear to front; heights are above the ground.

    Attributes
    ----------
    kind : COCO class number.
    length, width : size of the vehicle, metres.
    body : points (z, height) of the upper edge of the lower body, from rear to front.
    cabin : the cabin of a car; None for a bus or a truck, whose body has its windows.
    wheels : z of the axles.
    radius : radius of the wheels.
    windows : (z0, z1) of each side window painted on a flat side (bus, truck).
    band : (low, high) heights of the lower and upper edge of the side windows.
    """

    kind: int
    length: float
    width: float
    body: tuple[tuple[float, float], ...]
    cabin: Cabin | None
    wheels: tuple[float, ...]
    radius: float = 0.32
    windows: tuple[tuple[float, float], ...] = ()
    band: tuple[float, float] = (0.0, 0.0)

    @property
    def height(self) -> float:
        """Height of the highest point, metres."""
        top_of_body = max(height for _, height in self.body)
        if self.cabin is None:
            return top_of_body
        return max(top_of_body, self.cabin.roof_height)


SHAPES = {
    "hatchback": Shape(
        kind=CAR, length=4.0, width=1.74,
        body=((-2.0, 0.3), (-1.99, 0.62), (-1.9, 0.95), (0.95, 0.95), (1.85, 0.78), (1.98, 0.58), (2.0, 0.3)),
        cabin=Cabin(-1.88, -1.45, 0.15, 1.1, 0.94, 1.47),
        wheels=(-1.25, 1.28),
    ),
    "sedan": Shape(
        kind=CAR, length=4.6, width=1.80,
        body=((-2.3, 0.32), (-2.29, 0.65), (-2.22, 0.96), (-1.45, 1.0), (0.95, 0.97), (2.05, 0.8),
              (2.27, 0.6), (2.3, 0.3)),
        cabin=Cabin(-1.75, -0.95, 0.15, 1.1, 0.96, 1.43),
        wheels=(-1.38, 1.42),
    ),
    "estate": Shape(
        kind=CAR, length=4.7, width=1.82,
        body=((-2.35, 0.32), (-2.34, 0.65), (-2.28, 0.98), (1.0, 0.97), (2.1, 0.82), (2.32, 0.6),
              (2.35, 0.3)),
        cabin=Cabin(-2.26, -2.0, 0.2, 1.15, 0.96, 1.5),
        wheels=(-1.4, 1.45),
    ),
    "van": Shape(
        kind=CAR, length=4.9, width=1.94,
        body=((-2.45, 0.35), (-2.45, 1.1), (1.5, 1.12), (2.2, 1.0), (2.42, 0.7), (2.45, 0.35)),
        cabin=Cabin(-2.44, -2.36, 0.85, 1.75, 1.1, 1.95),
        wheels=(-1.5, 1.55), radius=0.34,
    ),
    "truck": Shape(
        kind=TRUCK, length=8.6, width=2.5,
        body=((-4.3, 0.95), (-4.3, 3.5), (2.2, 3.5), (2.21, 2.9), (3.9, 2.85), (4.25, 1.6), (4.3, 0.45)),
        cabin=None,
        wheels=(-2.7, 3.0), radius=0.48,
        windows=((2.75, 3.75),), band=(1.65, 2.5),
    ),
    "bus": Shape(
        kind=BUS, length=11.5, width=2.55,
        body=((-5.75, 0.4), (-5.72, 3.05), (5.5, 3.05), (5.72, 2.7), (5.75, 0.35)),
        cabin=None,
        wheels=(-3.4, 3.3), radius=0.48,
        windows=((-5.3, -3.9), (-3.8, -2.4), (-2.3, -0.9), (-0.8, 0.6), (0.7, 2.1), (2.2, 3.5), (4.9, 5.4)),
        band=(1.25, 2.5),
    ),
}  # fmt: skip
