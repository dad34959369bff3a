"""A city street: houses, gardens with hedges and fences, and objects on the pavement."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from vo_lib.geometry.types import Array

from .mesh import box
from .site import KERB, Site
from .things import add_bollards, add_lamp, add_sign, add_tree

# Numbers of different textures.
FRONTS = 14
GABLES = 4
ROOFS = 3
EDGES = {"boards": 1.6, "pickets": 1.0, "hedge": 1.3, "garden wall": 0.9}  # heights, m
BRICKS = np.array([[0.0, 0.2], [0.0, 0.0], [0.1, 0.0], [0.1, 0.2]])  # visible part of a wall on a chimney


def build_city(site: Site) -> None:
    """Build both sides of the street. Around a block, the outer houses of both halves are identical."""
    halves = 1 if site.route.lap is None else 2
    for side in (-1.0, 1.0):
        state = site.rng.bit_generator.state
        for first, last in pairwise(np.linspace(site.first, site.last, halves + 1)):
            if side < 0:  # the outer side, to the left
                site.rng.bit_generator.state = state
            build_houses(site, side, float(first), float(last))
        build_pavement(site, side)


def build_houses(site: Site, side: float, first: float, last: float) -> None:
    """Houses along one side: terraces, and single houses with gardens between them."""
    rng = site.rng
    line = site.profile.pavement
    s = first + 10.0
    terrace = True
    back = 1.0
    while s < last - 20.0:
        width = float(rng.uniform(9.0, 14.0))
        if rng.random() < 0.22:
            terrace = not terrace
            back = 0.0 if terrace else float(rng.uniform(2.5, 5.0))
        add_house(site, s + width / 2, side, width, line + back)
        if not terrace:
            gap = float(rng.uniform(3.0, 7.0))
            add_garden_edge(site, s, s + width + gap, side)
            if gap > 4.0 and rng.random() < 0.8:
                add_tree(site, s + width + gap / 2, side * (line + back + float(rng.uniform(1.0, 4.0))))
            s += gap
        s += width


def add_house(site: Site, s: float, side: float, width: float, offset: float) -> None:
    """Add a house whose front faces the street, unless a bend of the street would intersect the house."""
    rng = site.rng
    height = float(rng.uniform(6.5, 11.0))
    depth = float(rng.uniform(8.0, 10.0))
    ridge = height + float(rng.uniform(1.8, 3.6))
    faces = house_faces(side, width, height, depth, ridge)
    plan = site.place(faces["plan"], s, side * offset)
    middles = 0.5 * (plan + np.roll(plan, 1, axis=0))
    if not site.is_clear(np.concatenate([plan, middles]), site.profile.pavement - 0.4):
        return
    gain = float(rng.uniform(0.88, 1.1))
    roof = site.place(faces["roof"], s, side * offset)
    across = np.array([[0, 1.0], [0, 0], [width / 8, 0], [width / 8, 1.0]])
    gable_top = np.array([[0.1, 0.6], [0.5, 0.1], [0.9, 0.6], [0.9, 0.6]])
    wall = f"gable {int(rng.integers(GABLES))}"
    front = site.place(faces["front"], s, side * offset)
    site.add(f"house {int(rng.integers(FRONTS))}", front, None, gain)
    site.add(wall, site.place(faces["ends"], s, side * offset), None, gain)
    site.add(wall, site.place(faces["gables"], s, side * offset), gable_top, gain)
    site.add(f"roof {int(rng.integers(ROOFS))}", roof, across)
    site.add(wall, roof[:, ::-1], None, 0.5)  # its underside, seen below the eaves
    if rng.random() < 0.7:
        along = float(rng.uniform(-0.3, 0.3)) * width - 0.4
        low = np.array([side * depth * 0.35 - 0.35, -ridge - 0.8, along])
        chimney = box(low, low + np.array([0.7, 1.8, 0.8]))
        site.add("gable 1", site.place(chimney, s, side * offset), BRICKS)


def house_faces(side: float, width: float, height: float, depth: float, ridge: float) -> dict[str, Array]:
    """Faces of a house, metres. The front is at x = 0; inside the house, x has the sign of `side`."""
    half = width / 2
    back = side * depth
    plan = np.array([[0, 0, -half], [0, 0, half], [back, 0, half], [back, 0, -half]])
    tall = plan - (0.0, height, 0.0)
    top = np.array([[back / 2, -ridge, -half], [back / 2, -ridge, half]])
    # The eaves overhang the front and the back by 35 cm, 8 cm below the top of the walls.
    overhang = np.array([-0.35, -0.35, 0.35, 0.35])[:, None] * (side, 0.0, 0.0)
    eaves = tall + overhang + (0.0, 0.08, 0.0)
    front = np.array([plan[0], tall[0], tall[1], plan[1]])
    ends = np.array([[plan[1], tall[1], tall[2], plan[2]], [plan[3], tall[3], tall[0], plan[0]]])
    roof = np.array([[eaves[0], top[0], top[1], eaves[1]], [eaves[2], top[1], top[0], eaves[3]]])
    gables = np.array([[tall[1], top[1], tall[2], tall[2]], [tall[3], top[0], tall[0], tall[0]]])
    if side > 0:  # mirrored, so that faces still run clockwise
        front = front[::-1]
        ends = ends[:, ::-1]
        roof = roof[:, ::-1]
        gables = gables[:, [2, 1, 0, 0]]
    return {"plan": plan, "front": front, "ends": ends, "roof": roof, "gables": gables}


def add_garden_edge(site: Site, first: float, last: float, side: float) -> None:
    """A fence, a hedge or a low wall at the back of the pavement."""
    rng = site.rng
    kind = str(rng.choice(["boards", "pickets", "hedge", "hedge", "garden wall"]))
    s = np.arange(first, last - 0.5, 1.5)
    if len(s) < 2:
        return
    thickness = 0.2
    top = np.full(len(s), EDGES[kind] + KERB)
    period = 5.0
    across = 0.0
    if kind == "hedge":  # thick, with an uneven top, and a texture that repeats
        thickness = 0.8
        top += rng.uniform(-0.12, 0.12, len(s))
        period = 2.0
        across = 2.0
    near = side * (site.profile.pavement + 0.05)
    far = near + side * thickness
    site.ribbon(kind, s, (near, near), (top, KERB), period, across, flip=side > 0)
    site.ribbon(kind, s, (min(near, far), max(near, far)), (top, top), period, across)


def build_pavement(site: Site, side: float) -> None:
    """Lamp posts, street trees, signs, bollards and bins along one kerb."""
    rng = site.rng
    line = side * (site.profile.road + 0.45)
    s = site.first + float(rng.uniform(5, 20))
    while s < site.last - 10:
        kind = rng.random()
        if kind < 0.3:
            add_lamp(site, s, line)
        elif kind < 0.62:
            add_tree(site, s, line, float(rng.uniform(0.8, 1.15)))
        elif kind < 0.85:
            add_sign(site, s, line, int(rng.integers(0, 4)))
        else:
            add_bollards(site, s, line)
        s += float(rng.uniform(7.0, 14.0))
