"""Rendering of a world: the face of each pixel, its depth and its brightness.

OpenCV's z-buffer rasteriser gives only the face of a pixel. The intersection of the pixel's ray with the
face, and the texture position, are then computed exactly: 1/Z, s/Z and t/Z are linear in the pixel
coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from vo_lib.geometry.camera import StereoCamera
from vo_lib.geometry.motion import inverse, transform
from vo_lib.geometry.rows import joined
from vo_lib.geometry.types import Array, BoolArray

from .antialias import soften_edges
from .mesh import Faces
from .world import World

Float32 = NDArray[np.float32]
Int = NDArray[np.int32]
Places = list[tuple[Float32, Float32]]
Number = TypeVar("Number", np.float32, np.int32)

NEAR = 0.3  # metres
FAR = 3000.0  # metres
REACH = 190.0  # farther objects smaller than 10 m are omitted, metres
SKY_HEIGHT = 900.0  # of the clouds, metres
HORIZON = 205.0  # brightness of the clouds on the horizon
SCALES = (0.5 ** np.arange(16)).astype(np.float32)  # of the levels of the atlas
ROWS_AT_ONCE = 12  # rows shaded together: they fit into the processor's cache


@dataclass(frozen=True, eq=False)
class View:
    """The view of one camera, without the effects of the sensor.

    Attributes
    ----------
    light : (H, W) brightness; 255 is white for an exposure of 1.
    inverse_depth : (H, W) 1/Z, 1/metre; 0 for the sky.
    instance : (H, W) instance number of the visible object; 0 is street or sky.
    """

    light: Float32
    inverse_depth: Float32
    instance: Int


@dataclass(frozen=True, eq=False)
class FaceTable:
    """Shading data of the F faces in the view of one camera; face 0 is the sky.

    Attributes
    ----------
    lines : (9, F) coefficients of s/Z, t/Z and 1/Z as linear functions of normalised points (x, y, 1).
    edges : (F, 4, 3) lines; a point (x, y, 1) is inside a face if its products with all four lines are >= 0.
    texture, instance : (F,) numbers of texture and object. gain : (F,) brightness.
    """

    lines: Float32
    edges: Array
    texture: Int
    gain: Float32
    instance: Int


class Renderer:
    """Renderer of the frames of a world."""

    def __init__(self, world: World):
        self.world = world
        self.camera = world.config.camera
        corners = world.still.corners
        self._middle = corners.mean(axis=1)
        self._radius = np.linalg.norm(corners - self._middle[:, None], axis=2).max(axis=1)
        self._outward = world.still.outward()

    def view(self, frame: int, right: bool = False) -> View:
        """Render the left or right camera of a frame."""
        T_s_c = self.world.drive.poses[frame].copy()
        if right:
            T_s_c[:3, 3] += T_s_c[:3, 0] * self.camera.baseline
        faces, corners = self._in_sight(frame, inverse(T_s_c))
        face_of_pixel = rasterise(corners, self.camera)
        table = face_table(faces, corners, T_s_c, self.world.sky)
        light, inverse_depth = self._shade(face_of_pixel, table)
        light = soften_edges(light, inverse_depth, face_of_pixel, table.edges, self.camera)
        inverse_depth[face_of_pixel == 0] = 0.0
        return View(light, inverse_depth, table.instance[face_of_pixel])

    def _in_sight(self, frame: int, T_c_s: Array) -> tuple[Faces, Array]:
        """Faces that may be visible (street frame), and their corners (F, 4, 3) in the camera frame.

        T_c_s : (4, 4) from the street frame to the camera.
        """
        world = self.world
        eye = -T_c_s[:3, :3].T @ T_c_s[:3, 3]
        away = self._middle - eye
        near = np.einsum("ij,ij->i", away, self._outward) < 0
        near &= (np.einsum("ij,ij->i", away, away) < REACH**2) | (self._radius > 5.0)
        near[near] = self._in_pyramid(transform(T_c_s, self._middle[near]), self._radius[near])
        parts = [world.still[near]]
        for k in world.vehicles_near(frame, REACH):
            placed = world.placed(k, frame)
            middle = placed.corners.mean(axis=1)
            in_sight = np.einsum("ij,ij->i", middle - eye, placed.outward()) < 0
            in_sight &= self._in_pyramid(transform(T_c_s, middle), np.full(len(middle), 10.0))
            parts.append(placed[in_sight])
        faces = joined(parts)
        corners = transform(T_c_s, faces.corners.reshape(-1, 3)).reshape(-1, 4, 3)
        # Nearest first: the rasteriser then overwrites less.
        nearest = corners[:, :, 2].min(axis=1)
        order = np.argsort(nearest, kind="stable")
        order = order[corners[order, :, 2].max(axis=1) > NEAR]
        return faces[order], corners[order]

    def _in_pyramid(self, middle: Array, radius: Array) -> BoolArray:
        """Whether spheres with centres (N, 3), camera frame, may intersect the view frustum."""
        camera = self.camera
        x, y, z = middle.T
        inside = z + radius > NEAR
        # The four planes through the camera's centre and the borders of the image, with a pixel to spare.
        borders = (
            (x, (-camera.cx - 1) / camera.f, 1.0),
            (x, (camera.width - camera.cx) / camera.f, -1.0),
            (y, (-camera.cy - 1) / camera.f, 1.0),
            (y, (camera.height - camera.cy) / camera.f, -1.0),
        )
        for value, border, sign in borders:
            distance = sign * (value - border * z) / np.hypot(1.0, border)
            inside &= distance > -radius
        return np.asarray(inside)

    def _shade(self, faces: Int, table: FaceTable) -> tuple[Float32, Float32]:
        """Brightness and 1/Z of every pixel (H, W), from its face and its position in the texture."""
        camera = self.camera
        atlas = self.world.atlas
        light = np.empty(faces.shape, np.float32)
        inverse_depth = np.empty(faces.shape, np.float32)
        x = ((np.arange(camera.width) - camera.cx) / camera.f).astype(np.float32)[None]
        y = ((np.arange(camera.height) - camera.cy) / camera.f).astype(np.float32)[:, None]
        for start in range(0, camera.height, ROWS_AT_ONCE):
            rows = slice(start, start + ROWS_AT_ONCE)
            face = faces[rows]
            positions, shares, inverse_depth[rows] = self._texels(face, table, x, y[rows])
            (fine_u, coarse_u), (fine_v, coarse_v) = positions
            # Between the levels along s, first in the finer and then in the coarser level along t.
            fine = cv2.remap(atlas.texels, fine_u, fine_v, cv2.INTER_LINEAR)
            coarse = cv2.remap(atlas.texels, coarse_u, fine_v, cv2.INTER_LINEAR)
            in_fine_t = fine + shares[0] * (coarse - fine)
            fine = cv2.remap(atlas.texels, fine_u, coarse_v, cv2.INTER_LINEAR)
            coarse = cv2.remap(atlas.texels, coarse_u, coarse_v, cv2.INTER_LINEAR)
            in_coarse_t = fine + shares[0] * (coarse - fine)
            light[rows] = (in_fine_t + shares[1] * (in_coarse_t - in_fine_t)) * look_up(table.gain, face)
        # Towards the horizon, the sky is brighter and the clouds have less contrast.
        clear = np.float32(HORIZON)
        haze = np.clip(-y / np.float32(0.1), 0.0, 1.0)
        sky = clear + haze * (light - clear) + np.float32(60.0) * np.clip(y, -0.6, 0.0) + np.float32(30.0)
        light = np.where(faces == 0, sky, light)
        return light, inverse_depth

    def _texels(
        self, face: Int, table: FaceTable, x: Float32, y: Float32
    ) -> tuple[Places, list[Float32], Float32]:
        """Positions in the atlas of the texels that give the brightness of pixels (h, W).

        Returns, for s and t: positions in the finer and in the coarser level; the share of the coarser level.
        The third result is 1/Z.
        """
        atlas = self.world.atlas
        pixel = np.float32(1.0 / self.camera.f)
        line = [look_up(coefficients, face) for coefficients in table.lines]
        inverse_depth = line[6] * x + line[7] * y + line[8]
        z = 1.0 / inverse_depth
        texture = look_up(table.texture, face)
        positions = []
        shares = []
        for axis, begins in ((0, atlas.column), (1, atlas.row)):
            a, b, c = line[3 * axis : 3 * axis + 3]
            at = (a * x + b * y + c) * z
            # The number of texels per step to the next pixel, across and down, determines the level.
            across = (a - at * line[6]) * z
            down = (b - at * line[7]) * z
            step2 = across * across + down * down
            top = look_up(atlas.top[:, axis], texture)
            level = 0.5 * np.log2(np.maximum(step2, 1e-12)) + np.log2(pixel)
            level = np.minimum(np.maximum(level, 0.0), top)
            lower = np.minimum(np.floor(level), top - 1.0)
            size = look_up(atlas.size[:, axis], texture)
            at -= look_up(atlas.wrap[:, axis], texture) * size * np.floor(at / size)
            at = np.minimum(np.maximum(at, 0.0), size)
            whole = lower.astype(np.int32)
            at *= look_up(SCALES, whole)
            index = texture * begins.shape[1] + whole
            table_of_begins = begins.ravel()
            fine = look_up(table_of_begins, index) + at
            coarse = look_up(table_of_begins, index + 1) + np.float32(0.5) * at
            positions.append((fine, coarse))
            shares.append(level - lower)
        return positions, shares, inverse_depth


def look_up(table: NDArray[Number], index: Int) -> NDArray[Number]:
    """A faster version of table[index], for indices within the table."""
    return table.take(index, mode="clip")


def rasterise(corners: Array, camera: StereoCamera) -> Int:
    """Face of each pixel (H, W): index into corners plus one, 0 without a face.

    Parameters
    ----------
    corners : (F, 4, 3) faces in the camera frame, metres.
    camera : focal length, principal point and size of the image.
    """
    points, triangles, face_of_point = _triangles(corners)
    # The rasteriser's axes: x right, y up, z back; its picture has its centre in the middle and pixel centres
    # at + 0.5.
    shift = np.array([camera.cx + 0.5 - camera.width / 2, camera.cy + 0.5 - camera.height / 2]) / camera.f
    flipped = np.empty(points.shape, np.float32)
    flipped[:, 0] = points[:, 0] + shift[0] * points[:, 2]
    flipped[:, 1] = -(points[:, 1] + shift[1] * points[:, 2])
    flipped[:, 2] = -points[:, 2]
    # The colour of a face is its number, which single precision represents exactly.
    number = ((face_of_point + 1) * 2.0**-20).astype(np.float32)
    colours = np.repeat(number[:, None], 3, axis=1)
    settings = cv2.TriangleRasterizeSettings()
    settings = settings.setShadingType(cv2.RASTERIZE_SHADING_FLAT).setCullingMode(cv2.RASTERIZE_CULLING_NONE)
    picture = np.zeros((camera.height, camera.width, 3), np.float32)
    depth = np.full((camera.height, camera.width), FAR, np.float32)
    colour, _ = cv2.triangleRasterize(
        flipped,
        triangles,
        colours,
        picture,
        depth,
        np.eye(4, dtype=np.float32),
        2.0 * float(np.arctan(0.5 * camera.height / camera.f)),
        0.5 * NEAR,
        FAR,
        settings,
    )
    return np.asarray(np.asarray(colour)[:, :, 0] * np.float32(2.0**20), np.int32)


def _triangles(corners: Array) -> tuple[Array, Int, NDArray[np.intp]]:
    """The faces (F, 4, 3) as triangles, cut at NEAR: the rasteriser drops what reaches behind the camera.

    Returns
    -------
    Points (P, 3), metres; triangles (T, 3), as numbers of points; and the face (P,) of each point.
    """
    nearest = corners[:, :, 2].min(axis=1)
    whole = np.flatnonzero(nearest > NEAR)
    points = [corners[whole].reshape(-1, 3)]
    faces = [np.repeat(whole, 4)]
    # A convex polygon is a fan of triangles around its first corner.
    first = 4 * np.arange(len(whole))
    both = np.stack([first, first + 1, first + 2, first, first + 2, first + 3], axis=1)
    triangles = [both.reshape(-1, 3)]
    count = 4 * len(whole)
    for face in np.flatnonzero(nearest <= NEAR):
        polygon = clip_near(corners[face])
        k = np.arange(1, len(polygon) - 1)
        points.append(polygon)
        faces.append(np.full(len(polygon), face))
        triangles.append(count + np.stack([0 * k, k, k + 1], axis=1))
        count += len(polygon)
    return np.concatenate(points), np.concatenate(triangles).astype(np.int32), np.concatenate(faces)


def clip_near(polygon: Array) -> Array:
    """The part (n, 3) of a convex polygon with z >= NEAR."""
    clipped: list[Array] = []
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        if a[2] >= NEAR:
            clipped.append(a)
        if (a[2] >= NEAR) != (b[2] >= NEAR):
            clipped.append(a + (NEAR - a[2]) / (b[2] - a[2]) * (b - a))
    return np.array(clipped)


def face_table(faces: Faces, corners: Array, T_s_c: Array, sky: int) -> FaceTable:
    """Shading data of the F - 1 faces and of the sky, face 0, for one camera.

    corners : (F - 1, 4, 3) of the faces in the camera frame; T_s_c : (4, 4) pose of the camera in the street
    frame; sky : number of the texture of clouds.

    A ray meets the plane n · X = h at 1/Z = n · (x, y, 1) / h. With X = Z (x, y, 1), the texture coordinate s
    = s0 + a · (X - X0) gives s/Z = (a + (s0 - a · X0) n/h) · (x, y, 1).
    """
    R_c_s = T_s_c[:3, :3].T
    level = R_c_s @ (0.0, 1.0, 0.0)
    first = np.concatenate([(-SKY_HEIGHT - T_s_c[1, 3]) * level[None], corners[:, 0]])
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0])
    normal = np.concatenate([level[None], normal])
    plane = normal / np.sum(normal * first, axis=1, keepdims=True)
    lines = np.empty((3, len(first), 3))
    for k, axis in enumerate((faces.s_axis, faces.t_axis)):
        cloud = 0.4 * np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])[k]
        a = np.concatenate([cloud[None], axis]) @ R_c_s.T
        start = np.concatenate([[cloud @ T_s_c[:3, 3]], faces.origin[:, k]])
        lines[k] = a + (start - np.sum(a * first, axis=1))[:, None] * plane
    lines[2] = plane
    edges = np.cross(corners, np.roll(corners, -1, axis=1))
    edges *= np.where(np.sum(normal[1:] * first[1:], axis=1) < 0, -1.0, 1.0)[:, None, None]
    edges = np.concatenate([np.zeros((1, 4, 3)), edges])
    return FaceTable(
        lines=np.ascontiguousarray(lines.transpose(0, 2, 1).reshape(9, -1), np.float32),
        edges=edges,
        texture=np.concatenate([[sky], faces.texture]).astype(np.int32),
        gain=np.concatenate([[1.0], faces.gain]).astype(np.float32),
        instance=np.concatenate([[0], faces.instance]).astype(np.int32),
    )
