"""Vehicles as textured faces: body, cabin, wheels, mirrors and shadow."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from vo_lib.geometry.types import Array

from .atlas import TextureSet
from .mesh import Faces, MeshBuilder, box, prism
from .shapes import CAR, PAINTS, SHAPES, Shape
from .textures import Rng, plain
from .vehicle_paint import VIEWS, paint_vehicle, paint_wheel


@dataclass(frozen=True)
class Model:
    """A vehicle model: faces of the vehicle and faces of the shadow on the ground, in the vehicle frame."""

    name: str
    shape: Shape
    faces: Faces
    shadow: Faces


def make_models(textures: TextureSet, rng: Rng, names: tuple[str, ...]) -> list[Model]:
    """One model for each shape and paint."""
    dark = textures.add("tyre", plain(34.0, 32, 32, rng, 4.0), (True, True))
    wheel = textures.add("wheel", paint_wheel(rng))
    shade = textures.add("shadow", plain(34.0, 64, 128, rng, 3.0))
    lamp = textures.add("mirror", plain(70.0, 16, 16, rng, 3.0))
    painted = {}
    for name in names:
        for paint in PAINTS:
            views = paint_vehicle(SHAPES[name], paint, rng)
            painted[name, paint] = [textures.add(f"{name} {paint:.0f} {v}", views[v]) for v in VIEWS]
    sizes = [textures.size(k) for k in range(len(textures.images))]
    models = []
    for (name, _), views_of in painted.items():
        shape = SHAPES[name]
        body = MeshBuilder(sizes)
        ground = MeshBuilder(sizes)
        _build(body, shape, views_of, dark, wheel, lamp)
        w = shape.width / 2 + 0.12
        z = shape.length / 2 + 0.15
        flat = np.array([[-w, -0.015, -z], [-w, -0.015, z], [w, -0.015, z], [w, -0.015, -z]])
        ground.add(flat, shade)
        models.append(Model(name, shape, body.build(), ground.build()))
    return models


def _build(mesh: MeshBuilder, shape: Shape, views: list[int], dark: int, wheel: int, lamp: int) -> None:
    """Faces of one vehicle; the texture of a painted face is a view along an axis."""
    right_side, left_side, front, rear, top = views
    half = shape.width / 2
    length = shape.length
    height = shape.height

    def project(corners: Array, view: int) -> Array:
        """Texture coordinates of each corner, in units of the size of the view."""
        x = corners[..., 0]
        y = -corners[..., 1]
        z = corners[..., 2]
        if view in (right_side, left_side):
            along = z / length if view == right_side else -z / length
            return np.stack([along + 0.5, 1.0 - y / height], axis=-1)
        if view == top:
            return np.stack([z / length + 0.5, x / shape.width + 0.5], axis=-1)
        return np.stack([(x if view == rear else -x) / shape.width + 0.5, 1.0 - y / height], axis=-1)

    def strip(z0: float, h0: float, z1: float, h1: float, w0: float, w1: float) -> None:
        """A face across the whole width of the vehicle, from (z0, h0) to (z1, h1) in the side view."""
        corners = np.array([[-w0, -h0, z0], [-w1, -h1, z1], [w1, -h1, z1], [w0, -h0, z0]])
        view = top
        if abs(h1 - h0) > 0.35 * abs(z1 - z0):
            view = rear if h1 > h0 else front
        mesh.add(corners, view, project(corners, view))

    sill = 0.2 if shape.kind == CAR else 0.42
    outline = [(z, h) for z, h in shape.body]
    for (z0, h0), (z1, h1) in itertools.pairwise(outline):
        strip(z0, h0, z1, h1, half, half)
        if z1 - z0 > 0.02:
            for x in (-half, half):
                corners = np.array([[x, -sill, z0], [x, -h0, z0], [x, -h1, z1], [x, -sill, z1]])
                view, corners = (right_side, corners) if x > 0 else (left_side, corners[::-1])
                mesh.add(corners, view, project(corners, view))
    if shape.cabin:
        zb0, zr0, zr1, zb1, low, high = shape.cabin
        wide = half
        narrow = (0.78 if high < 1.7 else 0.88) * half
        strip(zb0, low, zr0, high, wide, narrow)
        strip(zr0, high, zr1, high, narrow, narrow)
        strip(zr1, high, zb1, low, narrow, wide)
        right = np.array([[wide, -low, zb0], [narrow, -high, zr0], [narrow, -high, zr1], [wide, -low, zb1]])
        for view, corners in ((right_side, right), (left_side, (right * (-1, 1, 1))[::-1])):
            mesh.add(corners, view, project(corners, view))
        for x in (-half, half):  # mirrors
            at = np.array([x, -low - 0.04, zb1 - 0.28])
            mesh.add(box(at - np.array([0.1, 0.09, 0.04]), at + np.array([0.1, 0.05, 0.06])), lamp)
    under = np.array([[half, -sill, -length / 2.05], [half, -sill, length / 2.05]])
    mesh.add(np.array([under[0], under[1], under[1] * (-1, 1, 1), under[0] * (-1, 1, 1)]), dark)
    along = np.array([0.0, 0.0, 1.0])
    ends = np.array(
        [[-half, -sill, 0.0], [-half, -sill - 0.2, 0.0], [half, -sill - 0.2, 0.0], [half, -sill, 0.0]]
    )
    mesh.add(
        np.stack([ends + along * (outline[0][0] + 0.03), ends[::-1] + along * (outline[-1][0] - 0.03)]), dark
    )
    for z in shape.wheels:
        for x in (-half, half):
            _add_wheel(mesh, np.array([x, -shape.radius, z]), shape.radius, dark, wheel)


def _add_wheel(mesh: MeshBuilder, hub: Array, radius: float, dark: int, wheel: int) -> None:
    """A wheel that protrudes 2 cm from the side of the body: a disc, and a tread with 12 sides."""
    out = np.sign(hub[0])
    angle = 2 * np.pi * np.arange(12) / 12
    circle = np.stack([np.zeros(12), np.sin(angle), out * np.cos(angle)], axis=1) * radius
    outer = hub + circle + (0.02 * out, 0, 0)
    inner = hub + circle - (0.2 * out, 0, 0)
    mesh.add(prism(inner, outer), dark)
    for k in range(1, 11, 2):
        quad = outer[[0, k, k + 1, min(k + 2, 11)]]
        uv = 0.5 + (quad - hub)[:, [2, 1]] / (2 * radius)
        mesh.add(quad, wheel, uv)
