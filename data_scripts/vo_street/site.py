"""The builder of a street: objects at positions along the route, and ribbons that follow the route.

A position is given as arc length s and lateral offset, positive to the right of the centre line.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vo_lib.data.scenes import SceneConfig
from vo_lib.geometry.motion import transform
from vo_lib.geometry.types import Array

from .mesh import MeshBuilder
from .route import BEHIND, LANE_WIDTH, Route

PARKING = 2.2  # width of the row of parked cars, metres
KERB = 0.12  # height of the pavement, metres
PAVEMENT = 2.3  # its width, metres
SEGMENT = 3.0  # length of one flat piece of ground, metres


@dataclass(frozen=True)
class Profile:
    """Cross-section of the street.

    Attributes
    ----------
    lanes, road, pavement : distances from the centre line to the edge of the lanes, of the carriageway, and
        of the pavement (the nearest position of houses), metres.
    """

    lanes: float
    road: float
    pavement: float

    @classmethod
    def of(cls, config: SceneConfig) -> Profile:
        """The cross-section of a scene."""
        lanes = config.lanes * LANE_WIDTH
        if config.layout == "highway":
            return cls(lanes + 1.0, lanes + 3.5, lanes + 3.5)
        return cls(lanes, lanes + PARKING, lanes + PARKING + PAVEMENT)


class Site:
    """Builder that adds faces at positions on the street to a mesh. `names` : texture numbers by name."""

    def __init__(self, mesh: MeshBuilder, names: dict[str, int], route: Route, config: SceneConfig):
        self.mesh = mesh
        self.names = names
        self.route = route
        self.config = config
        self.profile = Profile.of(config)
        self.first = -BEHIND + 5.0
        self.last = float(route.s[-1]) - 5.0
        if route.lap is not None:
            self.first = 0.0
            self.last = route.lap
        self.rng = np.random.default_rng([config.seed, 4])

    def samples(self) -> Array:
        """Arc lengths of the ends of all ribbon segments along the street, metres."""
        closing = 0.0 if self.route.lap is None else SEGMENT
        return np.arange(self.first, self.last + closing, SEGMENT)

    def add(self, name: str, corners: Array, uv: Array | None = None, gain: float | Array = 1.0) -> None:
        """Add faces (n, 4, 3) in the street frame; `uv` and `gain` as in `MeshBuilder.add`."""
        self.mesh.add(corners, self.names[name], uv, gain)

    def place(self, shape: Array, s: float, offset: float, turn: float = 0.0, up: float = 0.0) -> Array:
        """Corners (..., 3) moved from the origin to a place on the street, `up` metres above the ground."""
        moved = transform(self.route.pose(s, offset, turn), shape.reshape(-1, 3)) - (0.0, up, 0.0)
        return np.asarray(moved.reshape(shape.shape))

    def is_clear(self, corners: Array, distance: float) -> bool:
        """Whether all corners are at least `distance` from the route, so that no bend intersects a house."""
        return bool(self.route.distance(corners.reshape(-1, 3)).min() >= distance)

    def ribbon(
        self,
        name: str,
        s: Array,
        offset: tuple[Array | float, Array | float],
        up: tuple[Array | float, Array | float] = (0.0, 0.0),
        period: float = 4.0,
        across: float = 0.0,
        flip: bool = False,
    ) -> None:
        """A ribbon between two lines along the route.

        Parameters
        ----------
        name : name of the texture: columns along the route, rows from the first line to the second line.
        s : (n,) arc lengths, metres.
        offset, up : lateral offset and height of the first and of the second line, a number or (n,), metres.
        period : length of one repeat of the texture along the route, metres.
        across : width of one repeat of the texture, metres; 0: the ribbon has the width of one texture.
        flip : whether the visible side has the first line on the right instead of on the left.
        """
        left = np.broadcast_to(offset[0], s.shape).astype(float)
        right = np.broadcast_to(offset[1], s.shape).astype(float)
        a = self.route.point(s, left, up[0])
        b = self.route.point(s, right, up[1])
        corners = np.stack([a[:-1], a[1:], b[1:], b[:-1]], axis=1)
        u = np.mod(s[:-1], period) / period
        step = np.diff(s) / period
        # The second line is the reference, so that a wall keeps its courses where its top goes up and down.
        wide = np.ones(len(s))
        if across:
            wide = np.linalg.norm(b - a, axis=1) / across
        zero = np.zeros_like(u)
        of_corners = np.stack([[u, -wide[:-1]], [u + step, -wide[1:]], [u + step, zero], [u, zero]])
        uv = of_corners.transpose(2, 0, 1)
        if not across:
            uv[..., 1] += 1.0
        if flip:
            corners = corners[:, ::-1]
            uv = uv[:, ::-1]
        self.add(name, corners, uv)
