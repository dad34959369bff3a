"""Flat four-cornered faces with texture coordinates: the elements of streets and vehicles."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vo_lib.geometry.motion import transform
from vo_lib.geometry.rows import Rows
from vo_lib.geometry.types import Array

Int = NDArray[np.int32]

# Towards the sun, street frame (x right, y down, z forward).
SUN = np.array([-0.45, -0.75, -0.48]) / np.linalg.norm([-0.45, -0.75, -0.48])


@dataclass(frozen=True, eq=False)
class Faces(Rows):
    """F convex flat faces; a triangle repeats its third corner.

    Attributes
    ----------
    corners : (F, 4, 3) corners in their order round the face, metres.
    texture : (F,) number of the texture.
    origin : (F, 2) texel coordinate (s, t) of the first corner.
    s_axis, t_axis : (F, 3) texels per metre: s = origin + s_axis · (X - first corner).
    gain : (F,) brightness that multiplies the texture.
    instance : (F,) number of the object of the face; 0 is the street.
    """

    corners: Array
    texture: Int
    origin: Array
    s_axis: Array
    t_axis: Array
    gain: Array
    instance: Int

    def moved(self, T: Array) -> Faces:
        """The faces and their textures after the rigid motion T (4, 4)."""
        corners = transform(T, self.corners.reshape(-1, 3)).reshape(-1, 4, 3)
        R = T[:3, :3].T
        return dataclasses.replace(self, corners=corners, s_axis=self.s_axis @ R, t_axis=self.t_axis @ R)

    def outward(self) -> Array:
        """Unit normals (F, 3) of the outer sides; faces are invisible from behind."""
        normal = np.cross(self.corners[:, 3] - self.corners[:, 0], self.corners[:, 1] - self.corners[:, 0])
        return np.asarray(normal / np.linalg.norm(normal, axis=1, keepdims=True))

    def lit(self) -> Faces:
        """The faces with a gain that includes the light of sun and sky on the outer sides."""
        return dataclasses.replace(self, gain=self.gain * sunlight(self.outward()))


def sunlight(normal: Array) -> Array:
    """Light (F,) of sun and sky on surfaces with unit normals (F, 3)."""
    return np.asarray(0.62 + 0.38 * np.maximum(normal @ SUN, 0.0) - 0.12 * np.maximum(normal[:, 1], 0.0))


class _Part(NamedTuple):
    """Faces of one texture: corners (n, 4, 3), texture coordinates (n, 4, 2), texture, and gain (n,)."""

    corners: Array
    uv: Array
    texture: int
    gain: Array


@dataclass(eq=False)
class MeshBuilder:
    """A builder of meshes. Seen from the lit outer side, the corners of a face are in clockwise order."""

    sizes: list[tuple[int, int]]  # texels of each texture, from TextureSet.size
    parts: list[_Part] = field(default_factory=list)

    def add(self, corners: Array, texture: int, uv: Array | None = None, gain: float | Array = 1.0) -> None:
        """Add n faces of one texture.

        Parameters
        ----------
        corners : (n, 4, 3) or (4, 3), metres.
        texture : number of the texture.
        uv : (n, 4, 2) or (4, 2), texture coordinates as shares of the texture (above 1: repetition);
            default: the corners of the texture (lower left, upper left, upper right, lower right).
        gain : brightness, a number or (n,).
        """
        quads = np.asarray(corners, float).reshape(-1, 4, 3)
        if uv is None:
            uv = np.array([[0.0, 1.0], [0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
        uv = np.broadcast_to(np.asarray(uv, float).reshape(-1, 4, 2), (len(quads), 4, 2))
        gains = np.broadcast_to(np.asarray(gain, float), len(quads))
        self.parts.append(_Part(quads, uv, texture, gains))

    def build(self) -> Faces:
        """All faces with their texture axes, without lighting."""
        parts = self.parts
        corners = np.concatenate([part.corners for part in parts])
        uv = np.concatenate([part.uv * self.sizes[part.texture] for part in parts])
        texture = np.concatenate([np.full(len(part.corners), part.texture, np.int32) for part in parts])
        gain = np.concatenate([part.gain for part in parts])
        a = corners[:, 1] - corners[:, 0]
        b = corners[:, 3] - corners[:, 0]
        frame = np.stack([a, b, np.cross(a, b)], axis=1)
        # The texture coordinate is linear over the face and constant along its normal.
        rise = np.stack([uv[:, 1] - uv[:, 0], uv[:, 3] - uv[:, 0], np.zeros_like(uv[:, 0])], axis=1)
        axes = np.linalg.solve(frame, rise)
        return Faces(corners, texture, uv[:, 0], axes[:, :, 0], axes[:, :, 1], gain, np.zeros_like(texture))


def prism(base: Array, top: Array) -> Array:
    """Side faces (n, 4, 3) between two rings, each with n corners (n, 3)."""
    return np.stack([base, top, np.roll(top, -1, axis=0), np.roll(base, -1, axis=0)], axis=1)


def ring(centre: Array, radius: float, count: int) -> Array:
    """Corners (count, 3) of a horizontal ring, metres, in the order of increasing angles."""
    angle = 2 * np.pi * np.arange(count) / count
    return np.asarray(centre + radius * np.stack([np.cos(angle), np.zeros(count), np.sin(angle)], axis=1))


def box(low: Array, high: Array) -> Array:
    """The six faces (6, 4, 3) of a box: front (low z), right, back, left, top, bottom; y is down."""
    x0, y0, z0 = low
    x1, y1, z1 = high
    # Each face from its lower left corner clockwise, as seen from outside.
    front = [[x0, y1, z0], [x0, y0, z0], [x1, y0, z0], [x1, y1, z0]]
    back = [[x1, y1, z1], [x1, y0, z1], [x0, y0, z1], [x0, y1, z1]]
    right = [front[3], front[2], back[1], back[0]]
    left = [back[3], back[2], front[1], front[0]]
    top = [front[1], back[2], back[1], front[2]]
    bottom = [front[3], back[0], back[3], front[0]]
    return np.array([front, right, back, left, top, bottom])
