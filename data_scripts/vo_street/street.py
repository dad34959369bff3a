"""The whole street of a scene: textures, ground, surrounding woods, and barriers of a highway."""

from __future__ import annotations

import numpy as np

from vo_lib.data.scenes import SceneConfig
from vo_lib.geometry.types import Array

from . import houses, textures
from .atlas import TextureSet
from .city import FRONTS, GABLES, ROOFS, build_city
from .mesh import box, prism, ring
from .site import KERB, SEGMENT, Profile, Site
from .textures import Rng, fractal
from .things import add_pole, add_sign, add_tree, two_sides

TILE = 12.0  # metres of road painted in one texture
ROADS = 4  # different road textures
LAWN = 25.0  # largest distance of lawns from the centre line, metres
BEYOND = 700.0  # width of the flat land around the street, metres


def build_street(site: Site) -> None:
    """Add the complete street to the site's mesh."""
    build_ground(site)
    if site.config.layout == "highway":
        build_highway(site)
    else:
        build_city(site)


def paint_street(store: TextureSet, config: SceneConfig, rng: Rng) -> None:
    """Paint the textures of a street, and store them by name for the builders."""
    both = (True, True)
    along = (True, False)
    width = 2 * Profile.of(config).road
    for k in range(ROADS):
        road = textures.asphalt(rng, config.lanes, width, TILE, solid_centre=config.lanes > 1)
        store.add(f"road {k}", road, along)
    store.add("grass", textures.grass(rng), both)
    store.add("leaves", textures.leaves(rng, 512, mean=104.0, count=3200), both)
    store.add("far wood", textures.leaves(rng, mean=62.0, count=900), both)
    store.add("bark", textures.bark(rng), both)
    store.add("concrete", textures.concrete(rng), along)
    store.add("pole", textures.plain(118.0, 64, 64, rng, 3.0), both)
    store.add("clouds", textures.clouds(rng), both)
    for k in range(6):
        store.add(f"sign {k}", textures.sign(rng, k))
    if config.layout == "highway":
        store.add("rail", textures.rail(rng), along)
    else:
        paint_city(store, rng)


def paint_city(store: TextureSet, rng: Rng) -> None:
    """Paint the textures of pavement, gardens and houses."""
    along = (True, False)
    store.add("slabs", textures.slabs(rng), along)
    store.add("kerb", textures.kerb(rng), along)
    store.add("hedge", textures.leaves(rng, mean=70.0), (True, True))
    store.add("boards", textures.boards(rng, 32, 150.0), along)
    store.add("pickets", textures.boards(rng, 32, 205.0, 7), along)
    store.add("garden wall", textures.masonry(rng, 128, 512, 8, 20, 105.0, 12.0, 150.0), along)
    for k, grey in zip(range(ROOFS), (82.0, 105.0, 66.0), strict=True):
        store.add(f"roof {k}", textures.roof_tiles(rng, grey), along)
    for k in range(FRONTS):
        kind = str(rng.choice(["plaster", "plaster", "brick", "blocks", "boards"]))
        storeys = int(rng.choice(houses.STOREYS))
        store.add(f"house {k}", houses.facade(rng, kind, storeys, shop=k % 5 == 4))
    for k, kind in zip(range(GABLES), ("plaster", "brick", "plaster", "boards"), strict=True):
        store.add(f"gable {k}", houses.gable(rng, kind))


def build_ground(site: Site) -> None:
    """Ground: road, kerbs, pavements, lawns, and flat land up to the woods on the horizon."""
    road = site.profile.road
    out = site.profile.pavement
    for start in np.arange(np.floor(site.first / TILE) * TILE, site.last, TILE):
        s = start + np.arange(0.0, TILE + 0.1, SEGMENT)
        site.ribbon(f"road {int(site.rng.integers(ROADS))}", s, (-road, road), period=TILE)
    s = site.samples()
    raised = KERB if out > road else 0.0
    curvature = _strongest_curvature(site, s)
    # On the inner side of a bend, ground that extends beyond the centre of the bend would fold over.
    inner = np.clip(0.8 / np.maximum(np.abs(curvature), 1e-6), out + 0.1, LAWN)
    for side in (-1.0, 1.0):
        if raised:
            site.ribbon("slabs", s, _ordered(side * road, side * out), (KERB, KERB))
            site.ribbon("kerb", s, (side * road, side * road), (KERB, 0.0), flip=side > 0)
        reach = np.where(np.sign(curvature) == side, inner, LAWN)
        site.ribbon("grass", s, _ordered(side * out, side * reach), (raised, raised), 9.0, 9.0)
    middle = site.route.point(0.5 * (site.first + site.last))
    half = 0.5 * (site.last - site.first) + BEYOND
    square = np.array([[-half, 0.25, -half], [-half, 0.25, half], [half, 0.25, half], [half, 0.25, -half]])
    uv = np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0]]) * 2 * half / 9.0
    site.add("grass", middle + square, uv, 0.9)
    _build_woods(site, middle, half - BEYOND + 240.0)


def _build_woods(site: Site, middle: Array, radius: float) -> None:
    """A ring of woods with an uneven top, visible from inside."""
    count = 240
    base = ring(middle + np.array([0.0, 0.3, 0.0]), radius, count)
    height = 14.0 + 7.0 * np.abs(fractal(site.rng, 8, 256, 1.0)[0, :count])
    top = base - height[:, None] * (0.0, 1.0, 0.0)
    uv = np.tile([[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0]], (count, 1, 1))
    uv[:, :, 0] *= 2 * np.pi * radius / count / 20.0
    uv[:, 1, 1] = height / 20.0
    uv[:, 2, 1] = np.roll(height, -1) / 20.0
    site.add("far wood", prism(base, top)[:, ::-1], uv[:, ::-1], 0.95)


def _ordered(a: Array | float, b: Array | float) -> tuple[Array | float, Array | float]:
    """Both lines of a ribbon, the left line first, so that a horizontal ribbon is visible from above."""
    if np.all(np.asarray(a) <= b):
        return a, b
    return b, a


def _strongest_curvature(site: Site, s: Array) -> Array:
    """The signed curvature (n,), 1/metre, with the largest magnitude within 25 m of s (n,)."""
    near = s + np.arange(-25.0, 26.0, 5.0)[:, None]
    around = np.interp(near, site.route.s, site.route.curvature)
    return np.asarray(np.take_along_axis(around, np.abs(around).argmax(axis=0)[None], axis=0)[0])


def build_highway(site: Site) -> None:
    """Add the objects beside and between the two carriageways."""
    rng = site.rng
    edge = site.profile.road + 0.4
    for offset in (-edge, -0.25, 0.25, edge):
        add_barrier(site, offset)
    for side in (-1.0, 1.0):
        post = box(np.array([-0.06, -1.0, -0.06]), np.array([0.06, 0.0, 0.06]))
        for s in np.arange(site.first + 7, site.last - 7, 50.0):
            site.add("concrete", site.place(post, float(s), side * (edge + 0.6)), None, 1.4)
        for s in np.arange(site.first, site.last - 40.0, 60.0):
            if rng.random() < 0.25:
                add_noise_barrier(site, float(s), side * (edge + 5.0))
            for _ in range(5):
                back = float(edge + rng.uniform(7.0, 40.0))
                add_tree(site, float(s + rng.uniform(0, 60.0)), side * back, float(rng.uniform(1.4, 2.4)))
    for s in np.arange(70.0, site.last - 20.0, 190.0):
        add_gantry(site, float(s), edge + 0.8)
    for s in np.arange(30.0, site.last - 20.0, 120.0):
        add_sign(site, float(s), edge + 1.2, int(rng.choice([0, 4, 5])), 1.2, 1.6)


def add_barrier(site: Site, offset: float) -> None:
    """A crash barrier along the whole street: a beam on posts, visible from both sides."""
    for flip in (False, True):
        site.ribbon("rail", site.samples(), (offset, offset), (0.75, 0.42), 8.0, flip=flip)
    for s in np.arange(site.first, site.last, 4.0):
        add_pole(site, site.route.point(s, offset + 0.06 * np.sign(offset)), 0.7, 0.05)


def add_noise_barrier(site: Site, first: float, offset: float) -> None:
    """A concrete wall, 60 m long and 3 m high."""
    s = np.arange(first, min(first + 60.0, site.last), SEGMENT)
    site.ribbon("concrete", s, (offset, offset), (3.2, 0.0), 8.0, flip=offset > 0)


def add_gantry(site: Site, s: float, edge: float) -> None:
    """A beam over the right carriageway with two direction boards."""
    for offset in (0.0, edge):
        add_pole(site, site.route.point(s, offset), 6.6, 0.16)
    beam = box(np.array([-edge / 2, -6.6, -0.2]), np.array([edge / 2, -6.1, 0.2]))
    site.add("pole", site.place(beam, s, edge / 2))
    front, back = two_sides(1.5, 5.4, 7.6, -0.3)
    for share in (0.3, 0.7):
        site.add("sign 5", site.place(front, s, share * edge))
        site.add("pole", site.place(back, s, share * edge))
