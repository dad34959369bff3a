"""The whole street of a scene: its textures, then its faces."""

from __future__ import annotations

from . import houses, textures
from .atlas import TextureSet
from .city import FRONTS, GABLES, ROOFS, build_city
from .ground import ROADS, TILE, build_ground
from .highway import build_highway
from .scenes import SceneConfig
from .site import Profile, Site
from .textures import Rng


def build_street(site: Site) -> None:
    """Add all of the street to the site's mesh."""
    build_ground(site)
    if site.config.layout == "highway":
        build_highway(site)
    else:
        build_city(site)


def paint_street(store: TextureSet, config: SceneConfig, rng: Rng) -> None:
    """Paint the textures a street needs; the builders find them by name."""
    both, along = (True, True), (True, False)
    width = 2 * Profile.of(config).road
    for k in range(ROADS):
        road = textures.asphalt(rng, config.lanes, width, TILE, solid_centre=config.lanes > 1)
        store.add(f"road {k}", road, along)
    store.add("grass", textures.grass(rng), both)
    store.add("leaves", textures.leaves(rng, 512, mean=104.0, count=3200), both)
    store.add("far wood", textures.leaves(rng, mean=62.0, count=900), both)
    store.add("bark", textures.bark(rng), both)
    store.add("concrete", textures.concrete(rng), along)
    store.add("pole", textures.smooth_metal(rng, 118.0), both)
    store.add("clouds", textures.clouds(rng), both)
    for k in range(6):
        store.add(f"sign {k}", textures.sign(rng, k))
    if config.layout == "highway":
        store.add("rail", textures.rail(rng), along)
    else:
        paint_city(store, rng)


def paint_city(store: TextureSet, rng: Rng) -> None:
    """Pavement, gardens and houses."""
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
