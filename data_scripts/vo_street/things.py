"""Objects beside a street: trees, poles, lamps, signs, bins."""

from __future__ import annotations

import numpy as np

from vo_lib.geometry.types import Array

from .mesh import box, prism, ring, sunlight
from .site import KERB, Site


def add_tree(site: Site, s: float, offset: float, size: float = 1.0) -> None:
    """Add a tree: a trunk and a crown of a few rough balls. No tree is added on the road."""
    rng = site.rng
    tall = float(rng.uniform(2.4, 3.4)) * size
    foot = site.route.point(s, offset)
    if not site.is_clear(foot[None], site.profile.road + 0.3):
        return
    lower = ring(foot, 0.17 * size, 7)
    upper = ring(foot - (0, tall, 0), 0.12 * size, 7)
    site.add("bark", prism(lower, upper), np.array([[0, 2.0], [0, 0], [0.3, 0], [0.3, 2.0]]))
    for _ in range(int(rng.integers(4, 6))):
        centre = foot - (0, tall + 0.9 * size, 0) + rng.normal(0, 0.6, 3) * size * (1.0, 0.7, 1.0)
        add_leaves(site, centre, float(rng.uniform(0.9, 1.4)) * size, float(rng.uniform(0.85, 1.1)))


def add_leaves(site: Site, centre: Array, radius: float, gain: float) -> None:
    """A rough ball of leaves: triangles in 4 rings of 6 faces."""
    around = 6
    down = 4
    lat = np.linspace(-np.pi / 2, np.pi / 2, down + 1)[:, None]
    # Every other ring is turned by half a face.
    turn = 0.5 * (np.arange(down + 1) % 2)[:, None]
    lon = 2 * np.pi * (np.arange(around) + turn) / around
    rough = radius * site.rng.uniform(0.8, 1.2, (down + 1, around))
    rough[[0, -1]] = radius * 0.9
    unit = np.stack([np.cos(lat) * np.cos(lon), np.sin(lat) + 0 * lon, np.cos(lat) * np.sin(lon)], axis=-1)
    points = centre + rough[..., None] * unit
    beside = np.roll(points, -1, axis=1)
    quads = np.stack([points[1:], points[:-1], beside[:-1], beside[1:]], axis=2).reshape(-1, 4, 3)
    triangles = np.concatenate([quads[:, [0, 1, 3, 3]], quads[:, [1, 2, 3, 3]]])
    normal = np.cross(triangles[:, 2] - triangles[:, 0], triangles[:, 1] - triangles[:, 0])
    size = np.linalg.norm(normal, axis=1)
    # At the poles, half of the triangles have no area.
    has_area = size > 1e-6
    triangles = triangles[has_area]
    normal = (normal / np.maximum(size, 1e-9)[:, None])[has_area]
    # The pattern of leaves is three-dimensional; a triangle shows a section along an axis, the one nearest to
    # its normal, so the two other coordinates are those of the texture.
    axes_of_section = np.array([[1, 2], [0, 2], [0, 1]])[np.abs(normal).argmax(axis=1)]
    uv = np.take_along_axis(triangles, axes_of_section[:, None, :].repeat(4, axis=1), axis=2) / 1.7
    uv = uv - np.floor(uv.min(axis=1, keepdims=True)) + site.rng.uniform(0, 1, (len(uv), 1, 2))
    # The light is that of a round ball, not of the single faces.
    out = triangles[:, :3].mean(axis=1) - centre
    smooth = sunlight(out / np.linalg.norm(out, axis=1, keepdims=True)) / sunlight(normal)
    site.add("leaves", triangles, uv, gain * smooth)


def add_pole(site: Site, foot: Array, height: float, radius: float) -> None:
    """An upright post with six sides; sizes in metres."""
    site.add("pole", prism(ring(foot, radius, 6), ring(foot - (0, height, 0), 0.8 * radius, 6)))


def add_lamp(site: Site, s: float, offset: float) -> None:
    """A lamp post whose arm reaches over the road."""
    add_pole(site, site.route.point(s, offset), 6.0, 0.08)
    ends = np.sort([-np.sign(offset) * 1.6, 0.05 * np.sign(offset)])
    arm = box(np.array([ends[0], -6.0, -0.05]), np.array([ends[1], -5.9, 0.05]))
    site.add("pole", site.place(arm, s, offset))


def add_sign(site: Site, s: float, offset: float, kind: int, size: float = 0.65, high: float = 2.2) -> None:
    """A sign on a post, which faces the traffic on its side of the street; sizes in metres."""
    add_pole(site, site.route.point(s, offset), high + size, 0.035)
    turn = 0.0 if offset > 0 else np.pi
    front, back = two_sides(size / 2, 0.0, size, -0.05)
    site.add(f"sign {kind}", site.place(front, s, offset, turn, high))
    site.add("pole", site.place(back, s, offset, turn, high), None, 0.8)


def add_bollards(site: Site, s: float, offset: float) -> None:
    """Three bollards and a bin on the pavement."""
    for k in range(3):
        add_pole(site, site.route.point(s + 1.5 * k, offset, KERB), 0.95, 0.06)
    bin_ = box(np.array([-0.3, -1.0, -0.3]), np.array([0.3, 0.0, 0.3]))
    site.add("boards", site.place(bin_, s + 6.0, offset + 1.4 * np.sign(offset), 0.0, KERB))


def two_sides(half: float, low: float, high: float, z: float) -> tuple[Array, Array]:
    """Front and back (4, 3) of a board of width 2 · `half`, at heights from `low` to `high`, metres."""
    front = np.array([[-half, -low, z], [-half, -high, z], [half, -high, z], [half, -low, z]])
    return front, front[::-1] + np.array([0.0, 0.0, 0.04])
