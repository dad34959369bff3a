"""Made-up scenes in which five points determine the motion badly, or not at all."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from vo_lib.geometry.types import Array, Index

from ..candidates import sets_of_five
from ..colours import BAD, DARK, FOURTH, GOOD
from ..drawing import figure, finish
from ..simulation.problems import HALF_HEIGHT, HALF_WIDTH, Motion, random_problems
from .figures import draw_camera

# The kinds of scenes by name, and the motion and points of each (`random_problems`). "neighbours" is the scene of
# "general"; only its sets of five are chosen in another way (`sets_in`).
KINDS: dict[str, Motion] = {
    "general": "general",
    "neighbours": "general",
    "a plane": "planar",
    "pure rotation": "pure_rotation",
}
POINTS = 65  # of a scene
SEED = 2  # of the scenes in the picture
SET_SEED = 0  # of their sets of five
# Metres in the views from above, with equal scales on both axes.
SIDE = 20.0
AHEAD = (-3.0, 40.0)
CAMERA = 3.0


def sets_in(kind: str, x_c: Array, sets: int, seed: int) -> Index:
    """Indices (sets, 5) of random five-point sets of a scene with current points x_c (N, 2).

    In the kind "neighbours", a set is a random point with its four nearest ones.
    """
    return sets_of_five(x_c, seed, sets, side_by_side=kind == "neighbours")


def scenes_figures() -> tuple[Figure, Figure]:
    """One scene of each kind, with a set of five in orange: from above, and in the current image."""
    plans, plan_axes = figure(250, len(KINDS))
    images, image_axes = figure(150, len(KINDS))
    for plan, image, (name, kind) in zip(plan_axes, image_axes, KINDS.items(), strict=True):
        given = random_problems(np.random.default_rng(SEED), 1, POINTS, kind)
        X = given.X_p[0]
        x_c = given.x_c[0]
        five = sets_in(name, x_c, 1, SET_SEED)[0]
        motion = np.column_stack([given.R_cp[0], given.t_cp[0]])
        draw_camera(plan, np.eye(4)[:3], DARK, CAMERA)
        draw_camera(plan, motion, FOURTH, CAMERA)
        for places, axis in ((X[:, [0, 2]], plan), (x_c, image)):
            axis.plot(*places.T, ".", color=GOOD, markersize=3)
            axis.plot(*places[five].T, "o", color=BAD, markersize=5)
        plan.set(xlim=(-SIDE, SIDE), ylim=AHEAD)
        image.set(xlim=(-HALF_WIDTH, HALF_WIDTH), ylim=(HALF_HEIGHT, -HALF_HEIGHT), yticks=(-0.2, 0.0, 0.2))
        finish(plan, name, "x [m]", "z [m]" if plan is plan_axes[0] else "")
        finish(image, "", "x, normalised", "y" if image is image_axes[0] else "")
    return plans, images
