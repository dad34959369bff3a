"""The ground: carriageway, kerbs, pavements, lawns, and the woods on the horizon."""

from __future__ import annotations

import numpy as np

from ..core.types import Array
from .mesh import prism, ring
from .site import KERB, SEGMENT, Site
from .textures import fractal

TILE = 12.0  # metres of road painted in one texture
ROADS = 4  # different road textures
LAWN = 25.0  # metres from the centre line to which lawns reach
BEYOND = 700.0  # metres of flat land around it all


def build_ground(site: Site) -> None:
    """Road, kerbs, pavements, lawns, and flat land up to the woods on the horizon."""
    road, out = site.profile.road, site.profile.pavement
    for start in np.arange(np.floor(site.first / TILE) * TILE, site.last, TILE):
        s = start + np.arange(0.0, TILE + 0.1, SEGMENT)
        site.ribbon(f"road {int(site.rng.integers(ROADS))}", s, (-road, road), period=TILE)
    s = site.samples()
    raised = KERB if out > road else 0.0
    curvature = _strongest_curvature(site, s)
    # On the inner side of a bend ground that reached beyond its centre would fold over.
    inner = np.clip(0.8 / np.maximum(np.abs(curvature), 1e-6), out + 0.1, LAWN)
    for side in (-1.0, 1.0):
        if raised:
            site.ribbon("slabs", s, _ordered(side * road, side * out), (KERB, KERB))
            site.ribbon("kerb", s, (side * road, side * road), (KERB, 0.0), flip=side > 0)
        reach = np.where(np.sign(curvature) == side, inner, LAWN)
        site.ribbon("grass", s, _ordered(side * out, side * reach), (raised, raised), 9.0, 9.0)
    middle, half = _extent(site)
    half += BEYOND
    square = np.array([[-half, 0.25, -half], [-half, 0.25, half], [half, 0.25, half], [half, 0.25, -half]])
    uv = np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0]]) * 2 * half / 9.0
    site.add("grass", middle + square, uv, 0.9)
    _build_woods(site, middle, half - BEYOND + 240.0)


def _build_woods(site: Site, middle: Array, radius: float, count: int = 240) -> None:
    """A ring of woods with an uneven top, seen from inside."""
    base = ring(middle + np.array([0.0, 0.3, 0.0]), radius, count)
    height = 14.0 + 7.0 * np.abs(fractal(site.rng, 8, 256, 1.0)[0, :count])
    top = base - height[:, None] * (0.0, 1.0, 0.0)
    uv = np.tile([[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0]], (count, 1, 1))
    uv[:, :, 0] *= 2 * np.pi * radius / count / 20.0
    uv[:, 1, 1], uv[:, 2, 1] = height / 20.0, np.roll(height, -1) / 20.0
    site.add("far wood", prism(base, top)[:, ::-1], uv[:, ::-1], 0.95)


def _extent(site: Site) -> tuple[Array, float]:
    """Middle of the street (3,) and half of its length, metres."""
    return site.route.point(0.5 * (site.first + site.last)), 0.5 * (site.last - site.first)


def _ordered(a: Array | float, b: Array | float) -> tuple[Array | float, Array | float]:
    """The line further left first, so that a level ribbon is seen from above."""
    return (a, b) if np.all(np.asarray(a) <= b) else (b, a)


def _strongest_curvature(site: Site, s: Array) -> Array:
    """The strongest curvature within 25 m of s (n,), signed, 1/metre."""
    near = s + np.arange(-25.0, 26.0, 5.0)[:, None]
    around = np.interp(near, site.route.s, site.route.curvature)
    return np.asarray(np.take_along_axis(around, np.abs(around).argmax(axis=0)[None], axis=0)[0])
