"""A highway: crash barriers, marker posts, gantries, noise barriers, trees that stand well back."""

from __future__ import annotations

import numpy as np

from .mesh import box
from .site import SEGMENT, Site
from .things import add_pole, add_sign, add_tree, two_sides


def build_highway(site: Site) -> None:
    """Everything beside and between the two carriageways."""
    rng, edge = site.rng, site.profile.road + 0.4
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
    """A crash barrier along the whole street: a beam on posts, seen from both sides."""
    for flip in (False, True):
        site.ribbon("rail", site.samples(), (offset, offset), (0.75, 0.42), 8.0, flip=flip)
    for s in np.arange(site.first, site.last, 4.0):
        add_pole(site, site.route.point(s, offset + 0.06 * np.sign(offset)), 0.7, 0.05)


def add_noise_barrier(site: Site, first: float, offset: float) -> None:
    """60 m of concrete wall, 3 m high."""
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
