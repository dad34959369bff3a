"""Results from the ground truth of a drawn scene: depths, predicted places, errors of matches."""

from __future__ import annotations

import numpy as np

from vo_lib.data.truth import Truth, read_picture
from vo_lib.geometry.matches import StereoMatches
from vo_lib.geometry.motion import inverse
from vo_lib.geometry.types import Array, BoolArray
from vo_street.truth_files import decode_depth


def depth(truth: Truth, frame: int) -> Array:
    """Depth Z (H, W) of every pixel of the left image, metres; infinite for the sky."""
    return decode_depth(read_picture(truth.folder / "truth" / "depth" / f"{frame:06d}.png"))


def predict(truth: Truth, frame_p: int, frame_c: int, uv: Array) -> tuple[Array, Array, BoolArray]:
    """Positions of points of one left image in the pair of another frame, with the true motion of vehicles.

    Parameters
    ----------
    frame_p, frame_c : frame of the input points, and frame of the result; they may be equal.
    uv : (N, 2) pixels in the left image of frame_p.

    Returns
    -------
    left, right : (N, 2) pixels in frame_c.
    valid : (N,) mask of the points that have a depth (no sky) and are inside both images of frame_c. A
        nearer surface may hide a valid point.
    """
    uv = np.asarray(uv, np.float64).reshape(-1, 2)
    camera = truth.config.camera
    z = _depth_at(truth, frame_p, uv)
    has_depth = np.isfinite(z)
    z = np.where(has_depth, z, 1.0)
    X = np.concatenate([camera.normalise(uv) * z[:, None], z[:, None]], axis=1)
    # The motion of the street (none) and of each vehicle in the world, then as seen from the two cameras.
    moved = np.concatenate([np.eye(4)[None], truth.objects[frame_c] @ inverse(truth.objects[frame_p])])
    T_cp = inverse(truth.poses[frame_c]) @ moved @ truth.poses[frame_p]
    T = T_cp[truth.vehicle_at(frame_p, uv)]
    left, right = camera.project(np.einsum("nij,nj->ni", T[:, :3, :3], X) + T[:, :3, 3])
    both = np.stack([left, right])
    inside = (both >= 0) & (both <= (camera.width - 1, camera.height - 1))  # false where NaN
    return left, right, has_depth & inside.all(axis=(0, 2))


def match_errors(truth: Truth | None, matches: StereoMatches, frame: int) -> Array:
    """Largest distance (N,) of each match from its true places, pixels; NaN if the true places are unknown.

    The matches are between the pairs `frame` - 1 and `frame`; the previous left place is exact by definition.
    """
    if truth is None:
        return np.full(len(matches), np.nan)
    _, right_p, valid_p = predict(truth, frame - 1, frame - 1, matches.prev_left)
    left, right, valid_c = predict(truth, frame - 1, frame, matches.prev_left)
    away = np.stack([matches.prev_right - right_p, matches.cur_left - left, matches.cur_right - right])
    return np.where(valid_p & valid_c, np.linalg.norm(away, axis=2).max(axis=0), np.nan)


def _depth_at(truth: Truth, frame: int, uv: Array) -> Array:
    """Depth (N,) at sub-pixel positions: interpolation of 1/Z, which is linear over a flat face.

    At an outline, the result is the depth of the nearest pixel.
    """
    near = 1.0 / depth(truth, frame)
    numbers = truth.instances(frame)  # of the thing at each pixel
    height, width = near.shape
    uv = np.nan_to_num(uv)
    column = np.clip(np.floor(uv[:, 0]), 0, width - 2).astype(np.intp)
    row = np.clip(np.floor(uv[:, 1]), 0, height - 2).astype(np.intp)
    a = np.clip(uv[:, 0] - column, 0, 1)
    b = np.clip(uv[:, 1] - row, 0, 1)
    # The four pixels around a position: upper left, upper right, lower left, lower right.
    rows = np.stack([row, row, row + 1, row + 1])
    columns = np.stack([column, column + 1, column, column + 1])
    around = near[rows, columns]
    things = numbers[rows, columns]
    mixed = (1 - b) * ((1 - a) * around[0] + a * around[1]) + b * ((1 - a) * around[2] + a * around[3])
    same = np.all(things == things[0], axis=0) & (np.ptp(around, axis=0) <= 0.1 * around.max(axis=0))
    nearest = np.rint(np.clip(uv, 0, (width - 1, height - 1))).astype(np.intp)
    with np.errstate(divide="ignore"):
        return np.asarray(1.0 / np.where(same, mixed, near[nearest[:, 1], nearest[:, 0]]))
