"""Rectification of a stereo pair with pinhole, fisheye or omnidirectional lenses: matrices and maps."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from vo_lib.geometry.types import Array, Image

Size = tuple[int, int]  # width and height, pixels
Maps = tuple[Image, Image]  # for `cv2.remap`

RADTAN = "radial-tangential"
FISHEYE = "fisheye"
OMNI = "omni"
IDENTITY_PX = 0.05  # rectification maps that move no pixel farther leave the images as they are
# Factors of a wide lens's focal length, tried until all rectified pixels have a source.
ZOOMS = 1.05 ** np.arange(15)


@dataclass(frozen=True)
class Lens:
    """Lens model of a camera: how a direction becomes a pixel.

    Attributes
    ----------
    model : RADTAN, the model of `cv2.projectPoints`; FISHEYE, the equidistant model of `cv2.fisheye`
        (Kannala and Brandt 2006); OMNI, a unit sphere seen from a point `xi` behind its centre, then RADTAN
        (Mei and Rives 2007).
    xi : distance of that point; 0 for the other models.
    """

    model: str = RADTAN
    xi: float = 0.0


def compute_rectification(
    matrices: dict[str, Array], size: Size, lenses: tuple[Lens, Lens]
) -> dict[str, Array]:
    """R1, R2, P1 and P2 of a pair with K, D, R and T."""
    wide = any(lens.model != RADTAN for lens in lenses)
    # The rotations of a rectification do not depend on the lenses.
    no_distortion = np.zeros(5)
    result = cv2.stereoRectify(
        matrices["K1"],
        no_distortion if wide else matrices["D1"],
        matrices["K2"],
        no_distortion if wide else matrices["D2"],
        size,
        matrices["R"],
        matrices["T"].reshape(3, 1),
        flags=cv2.CALIB_ZERO_DISPARITY,
        alpha=0,
    )
    names = ("R1", "R2", "P1", "P2")
    computed = {name: np.asarray(each, np.float64) for name, each in zip(names, result[:4], strict=True)}
    if not wide:
        return computed
    for zoom in ZOOMS:
        computed |= _wide_projections(matrices | computed, lenses, float(zoom))
        sources_l = _sources(matrices | computed, size, "1", lenses[0])
        sources_r = _sources(matrices | computed, size, "2", lenses[1])
        if _are_inside(sources_l, size) and _are_inside(sources_r, size):
            break
    return computed


def _are_inside(pixels: Array, size: Size) -> bool:
    """Whether all pixels (..., 2) are in an image of this size, or at most one pixel outside."""
    return bool(((pixels >= -1) & (pixels <= size)).all())


def _wide_projections(matrices: dict[str, Array], lenses: tuple[Lens, Lens], zoom: float) -> dict[str, Array]:
    """P1 and P2 of a pair with wide lenses.

    `cv2.fisheye.stereoRectify` shrinks the centre of the image to show all of it. Here the rectified images
    have the resolution of the raw images on the optical axis, and lose the border of a lens of 180° instead.
    """
    focal = []
    centre = []
    axis = []
    for camera, lens in zip(("1", "2"), lenses, strict=True):
        K = matrices[f"K{camera}"]
        R = matrices[f"R{camera}"]
        focal.append((K[0, 0] + K[1, 1]) / 2 / (1 + lens.xi))
        centre.append(K[:2, 2])
        axis.append(R[:2, 2] / R[2, 2])
    f = zoom * float(np.mean(focal))
    cx, cy = np.mean(centre, axis=0) - f * np.mean(axis, axis=0)
    P1 = np.array([[f, 0.0, cx, 0.0], [0.0, f, cy, 0.0], [0.0, 0.0, 1.0, 0.0]])
    P2 = P1.copy()
    P2[:, 3] = f * matrices["R2"] @ matrices["T"].ravel()
    return {"P1": P1, "P2": P2}


def _sources(matrices: dict[str, Array], size: Size, camera: str, lens: Lens) -> Array:
    """Position (H, W, 2) in the raw image of each rectified pixel."""
    K = matrices[f"K{camera}"]
    D = matrices[f"D{camera}"]
    R = matrices[f"R{camera}"]
    P = matrices[f"P{camera}"]
    if lens.model == RADTAN:
        maps = cv2.initUndistortRectifyMap(K, D, R, P[:, :3], size, cv2.CV_32FC1)
    elif lens.model == FISHEYE:
        maps = cv2.fisheye.initUndistortRectifyMap(K, D, R, P[:, :3], size, cv2.CV_32FC1)
    else:
        u, v = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
        pixels = np.stack([u, v, np.ones_like(u)], axis=-1).reshape(-1, 3)
        rays = pixels @ np.linalg.inv(P[:, :3]).T @ R  # row vectors: the rotation is R transposed
        return project_omni(rays, K, D, lens.xi).reshape(size[1], size[0], 2)
    return np.stack(maps, axis=-1).astype(np.float64)


def project_omni(X: Array, K: Array, D: Array, xi: float) -> Array:
    """Pixels (N, 2) of points (N, 3) in camera axes by the model OMNI (Mei and Rives 2007)."""
    on_sphere = X / np.linalg.norm(X, axis=1, keepdims=True)
    flat = on_sphere + np.array([0.0, 0.0, xi])
    uv = cv2.projectPoints(flat / flat[:, 2:], np.zeros(3), np.zeros(3), K, D)[0]
    return np.asarray(uv, np.float64).reshape(-1, 2)


def rectification_maps(matrices: dict[str, Array], size: Size, camera: str, lens: Lens) -> Maps:
    """The maps for `cv2.remap` that rectify the images of a camera, "1" or "2"."""
    if lens.model == RADTAN:
        K = matrices[f"K{camera}"]
        D = matrices[f"D{camera}"]
        R = matrices[f"R{camera}"]
        P = matrices[f"P{camera}"]
        maps = cv2.initUndistortRectifyMap(K, D, R, P[:, :3], size, cv2.CV_16SC2)
    else:
        source = _sources(matrices, size, camera, lens).astype(np.float32)
        maps = cv2.convertMaps(source[..., 0], source[..., 1], cv2.CV_16SC2)
    return maps[0], maps[1]  # type: ignore[return-value]


def is_identity(maps: Maps) -> bool:
    """Whether rectification maps leave every pixel where it is."""
    u, v = cv2.convertMaps(*maps, cv2.CV_32FC1)
    height, width = u.shape
    move_u = np.abs(u.astype(np.float64) - np.arange(width)).max()
    move_v = np.abs(v.astype(np.float64) - np.arange(height)[:, None]).max()
    return bool(max(move_u, move_v) <= IDENTITY_PX)
