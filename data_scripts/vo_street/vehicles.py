"""Vehicles as textured faces: body, cabin, wheels, mirrors and shadow."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from vo_lib.geometry.types import Array

from .atlas import TextureSet
from .mesh import Faces, MeshBuilder, box, prism
from .shapes import CAR, PAINTS, SHAPES, Cabin, Shape
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
    painted: dict[tuple[str, float], list[int]] = {}
    for name in names:
        for paint in PAINTS:
            views = paint_vehicle(SHAPES[name], paint, rng)
            painted[name, paint] = [textures.add(f"{name} {paint:.0f} {v}", views[v]) for v in VIEWS]
    sizes = [textures.size(k) for k in range(len(textures.images))]
    models = []
    for (name, _), textures_of_views in painted.items():
        shape = SHAPES[name]
        body = MeshBuilder(sizes)
        _build(body, shape, _Views(shape, *textures_of_views), dark, wheel, lamp)
        ground = MeshBuilder(sizes)
        half_width = shape.width / 2 + 0.12
        half_length = shape.length / 2 + 0.15
        flat = np.array(
            [
                [-half_width, -0.015, -half_length],
                [-half_width, -0.015, half_length],
                [half_width, -0.015, half_length],
                [half_width, -0.015, -half_length],
            ]
        )
        ground.add(flat, shade)
        models.append(Model(name, shape, body.build(), ground.build()))
    return models


@dataclass(frozen=True)
class _Views:
    """The painted views of a vehicle along an axis: the number of the texture of each."""

    shape: Shape
    right: int
    left: int
    front: int
    rear: int
    top: int

    def project(self, corners: Array, view: int) -> Array:
        """Texture coordinates (..., 2) of corners (..., 3) in a view, in units of its size."""
        x = corners[..., 0]
        y = -corners[..., 1]
        z = corners[..., 2]
        down = 1.0 - y / self.shape.height
        if view == self.right:
            return np.stack([z / self.shape.length + 0.5, down], axis=-1)
        if view == self.left:
            return np.stack([-z / self.shape.length + 0.5, down], axis=-1)
        if view == self.rear:
            return np.stack([x / self.shape.width + 0.5, down], axis=-1)
        if view == self.front:
            return np.stack([-x / self.shape.width + 0.5, down], axis=-1)
        return np.stack([z / self.shape.length + 0.5, x / self.shape.width + 0.5], axis=-1)


def _build(mesh: MeshBuilder, shape: Shape, views: _Views, dark: int, wheel: int, lamp: int) -> None:
    """Add the faces of one vehicle; dark, wheel and lamp : textures of tyres, wheels and mirrors."""
    half = shape.width / 2
    sill = 0.2 if shape.kind == CAR else 0.42
    for (z0, h0), (z1, h1) in itertools.pairwise(shape.body):
        _add_strip(mesh, views, (z0, h0, half), (z1, h1, half))
        if z1 - z0 > 0.02:
            left = np.array([[-half, -sill, z0], [-half, -h0, z0], [-half, -h1, z1], [-half, -sill, z1]])
            right = np.array([[half, -sill, z0], [half, -h0, z0], [half, -h1, z1], [half, -sill, z1]])
            _add_view(mesh, views, left[::-1], views.left)
            _add_view(mesh, views, right, views.right)
    if shape.cabin is not None:
        _add_cabin(mesh, views, shape.cabin, half, lamp)
    under = np.array([[half, -sill, -shape.length / 2.05], [half, -sill, shape.length / 2.05]])
    mesh.add(np.array([under[0], under[1], under[1] * (-1, 1, 1), under[0] * (-1, 1, 1)]), dark)
    # Below the body, at both ends.
    along = np.array([0.0, 0.0, 1.0])
    end = np.array(
        [[-half, -sill, 0.0], [-half, -sill - 0.2, 0.0], [half, -sill - 0.2, 0.0], [half, -sill, 0.0]]
    )
    rear = shape.body[0][0] + 0.03
    front = shape.body[-1][0] - 0.03
    mesh.add(np.stack([end + along * rear, end[::-1] + along * front]), dark)
    for z in shape.wheels:
        for x in (-half, half):
            _add_wheel(mesh, np.array([x, -shape.radius, z]), shape.radius, dark, wheel)


def _add_view(mesh: MeshBuilder, views: _Views, corners: Array, view: int) -> None:
    """Add a face (4, 3) that shows its part of a view."""
    mesh.add(corners, view, views.project(corners, view))


def _add_strip(
    mesh: MeshBuilder,
    views: _Views,
    first: tuple[float, float, float],
    second: tuple[float, float, float],
) -> None:
    """Add a face across the vehicle, between two lines at (z, height) with half a width each, metres."""
    z0, h0, w0 = first
    z1, h1, w1 = second
    corners = np.array([[-w0, -h0, z0], [-w1, -h1, z1], [w1, -h1, z1], [w0, -h0, z0]])
    view = views.top
    is_steep = abs(h1 - h0) > 0.35 * abs(z1 - z0)
    if is_steep:
        view = views.rear if h1 > h0 else views.front
    _add_view(mesh, views, corners, view)


def _add_cabin(mesh: MeshBuilder, views: _Views, cabin: Cabin, half: float, lamp: int) -> None:
    """Add the rear window, roof, windscreen, sides and mirrors of a car, `half` a width wide at the base."""
    low = cabin.base_height
    high = cabin.roof_height
    narrow = (0.78 if high < 1.7 else 0.88) * half
    rear_base = (cabin.rear_base, low, half)
    rear_roof = (cabin.rear_roof, high, narrow)
    front_roof = (cabin.front_roof, high, narrow)
    front_base = (cabin.front_base, low, half)
    _add_strip(mesh, views, rear_base, rear_roof)
    _add_strip(mesh, views, rear_roof, front_roof)
    _add_strip(mesh, views, front_roof, front_base)
    right = np.array([[w, -h, z] for z, h, w in (rear_base, rear_roof, front_roof, front_base)])
    left = (right * (-1, 1, 1))[::-1]
    _add_view(mesh, views, right, views.right)
    _add_view(mesh, views, left, views.left)
    for x in (-half, half):
        mirror = np.array([x, -low - 0.04, cabin.front_base - 0.28])
        mesh.add(box(mirror - np.array([0.1, 0.09, 0.04]), mirror + np.array([0.1, 0.05, 0.06])), lamp)


def _add_wheel(mesh: MeshBuilder, hub: Array, radius: float, dark: int, wheel: int) -> None:
    """A wheel around its hub (3,) that protrudes 2 cm from the body: a disc, and a tread with 12 sides."""
    out = np.sign(hub[0])
    angle = 2 * np.pi * np.arange(12) / 12
    circle = np.stack([np.zeros(12), np.sin(angle), out * np.cos(angle)], axis=1) * radius
    outer = hub + circle + (0.02 * out, 0, 0)
    inner = hub + circle - (0.2 * out, 0, 0)
    mesh.add(prism(inner, outer), dark)
    for k in range(1, 11, 2):  # the disc as a fan around corner 0; the last face is a triangle
        quad = outer[[0, k, k + 1, min(k + 2, 11)]]
        uv = 0.5 + (quad - hub)[:, [2, 1]] / (2 * radius)
        mesh.add(quad, wheel, uv)
