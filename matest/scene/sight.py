"""What the rays of a camera meet on a mesh, one ray through each pixel centre.

Embree says which triangle a ray meets first, in single precision. Where the ray meets it follows in double precision
from barycentric coordinates: on the plane (u, v) of the image, that of a corner is proportional to det[h, b, c], with
h = (u, v, 1) and b and c the other two corners in the camera's coordinates (of an orthographic camera, with depth 1).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from matest.scene.camera import Camera
from matest.scene.mesh import Mesh
from matest.workers import in_threads

# Rays that are cast at a time: few enough for their numbers to stay in the processor's cache.
_RAYS = 1 << 15
# Smallest cosine between normal and ray that tells how steep a connected surface is: a limb is steeper.
_GRAZING = 0.02
# Divisor in place of a length or area of zero, which leaves zero.
_NO_LENGTH = np.finfo(float).tiny
# Largest rms rounding of positions, share of a pixel: far below what lens and calibration are accurate to.
_POSITION_ERROR = 1e-4

# Types of numbers of a surface.
Precision = type[np.float32] | type[np.float64]


class Columns(NamedTuple):
    """What the n rays that meet the mesh see.

    Attributes:
        pixels: flat row-major indices, ascending [n].
        depth: distance along the ray, from a common level [n].
        jump: difference in depth to a neighbour above which the surface is not connected [n].
        facing: whether the smooth normal points toward the viewer [n].
        faces: triangle met by the m rays whose pixels face the viewer [m].
        positions: where they meet it, in world units [m, 3].
        normals: there, unit, smooth-shaded [m, 3].
    """

    pixels: np.ndarray
    depth: np.ndarray
    jump: np.ndarray
    facing: np.ndarray
    faces: np.ndarray
    positions: np.ndarray
    normals: np.ndarray


class Sight:
    """A mesh before a camera that takes images of a shape."""

    def __init__(self, mesh: Mesh, camera: Camera, shape: tuple[int, int]) -> None:
        self._mesh, self._camera, self._shape = mesh, camera, shape
        corners = camera.coordinates(mesh.triangles)
        # One row for each number of a triangle, which is faster to gather from than one triangle after the other.
        self._depth = np.ascontiguousarray(corners[..., 2].T)
        if camera.orthographic:
            corners[..., 2] = 1
        others = np.roll(corners, -1, axis=1), np.roll(corners, -2, axis=1)
        # b × c = b × (c − b), whose rounding is that of the triangle's size.
        self._weights = np.ascontiguousarray(np.cross(others[0], others[1] - others[0]).reshape(-1, 9).T)
        self._normals = np.ascontiguousarray(mesh.corner_normals.reshape(-1, 9).T)
        position = np.asarray(camera.position, dtype=float)
        # Depth of the mesh's bounding box before the camera.
        self._nearest = mesh.nearest_depth(camera.forward) - float(position @ camera.forward)

    def columns(self, mask: np.ndarray | None, precision: Precision) -> Columns:
        """All that is seen, or what is seen inside a mask [H, W], traced on all processors.

        Args:
            mask: True where a ray is cast; None: everywhere.
            precision: of normals, and of positions where it suffices for `_POSITION_ERROR`.
        """
        height, width = self._shape
        inside = np.broadcast_to(True, self._shape) if mask is None else mask
        step = max(_RAYS // width, 1)
        bands = [slice(first, first + step) for first in range(0, height, step)]
        places = np.cumsum([0, *(int(np.count_nonzero(inside[band])) for band in bands)])
        whole = self._room(int(places[-1]), precision)

        def trace(number: int) -> list[int]:
            band = bands[number]
            part = self._part((np.flatnonzero(inside[band]) + band.start * width).astype(whole.pixels.dtype))
            for column, values in zip(whole, part, strict=True):
                column[places[number] : places[number] + len(values)] = values
            return [len(values) for values in part]

        counts = list(in_threads(trace, range(len(bands))))
        sizes = zip(*counts, strict=True)
        return Columns(*(_packed(column, places, size) for column, size in zip(whole, sizes, strict=True)))

    def _part(self, pixels: np.ndarray) -> Columns:
        """What some pixels see, in double precision."""
        camera = self._camera
        u, v = camera.plane(self._shape, pixels)
        origins, directions = camera.through(u, v)
        # The object is seen whole, wherever an orthographic camera stands on its line of sight.
        ahead = (self._nearest - self._mesh.extent) * camera.forward if camera.orthographic else 0.0
        faces = self._mesh.first_faces(origins + ahead, directions)
        hit = np.flatnonzero(faces >= 0)
        pixels, faces, u, v = pixels[hit], faces[hit].astype(np.intp), u[hit], v[hit]
        origins, directions = origins[hit], directions[hit]
        shares = self._barycentric(faces, u, v)
        distance = _mixed(shares, self._depth, faces)
        if not camera.orthographic:
            # From the depth to the length of the ray.
            distance *= np.sqrt(u * u + v * v + 1)
        x, y, z = (_mixed(shares, self._normals[axis::3], faces) for axis in range(3))
        length = np.maximum(np.sqrt(x * x + y * y + z * z), _NO_LENGTH)
        normals = np.stack([x / length, y / length, z / length], axis=1)
        cos_o = -np.einsum("ij,ij->i", normals, directions)
        # Across 3×3 pixels a tilted plane spans 2√2 footprints · tan θ; twice that is a jump.
        jump = camera.footprint(self._shape, distance) * (2 + 4 * np.sqrt(2) / np.maximum(cos_o, _GRAZING))
        # A smooth-shaded normal may point away from the viewer at the limb; such pixels are left out.
        facing = cos_o > 0
        positions = origins + distance[:, None] * directions
        depth = distance - self._nearest
        return Columns(pixels, depth, jump, facing, faces[facing], positions[facing], normals[facing])

    def _barycentric(self, faces: np.ndarray, u: np.ndarray, v: np.ndarray) -> list[np.ndarray]:
        """Barycentric coordinates [3] × [n] of the points of n triangles at places on the plane of the image."""
        weights = []
        for corner in range(3):
            by_u, by_v, constant = (row.take(faces) for row in self._weights[3 * corner : 3 * corner + 3])
            weights.append(by_u * u + by_v * v + constant)
        total = sum(weights[1:], weights[0])
        # Zero for a triangle that is seen edge-on.
        total[total == 0] = _NO_LENGTH
        # A ray passes a triangle by as much as single precision rounds.
        shares = [(weight / total).clip(0, 1) for weight in weights]
        total = sum(shares[1:], shares[0])
        return [share / total for share in shares]

    def _room(self, count: int, precision: Precision) -> Columns:
        """Room for what so many rays see."""
        number, index = np.empty(count, np.float32), np.empty(count, np.int32)
        return Columns(
            pixels=np.empty(count, index_type(self._shape)),
            depth=number,
            jump=np.empty_like(number),
            facing=np.empty(count, bool),
            faces=index,
            positions=np.empty((count, 3), self._position_type(precision)),
            normals=np.empty((count, 3), precision),
        )

    def _position_type(self, precision: Precision) -> Precision:
        """The type of positions: `precision`, or double if the coordinates are too large for that."""
        pixel = self._camera.footprint(self._shape, np.array(max(self._nearest, 0.0)))
        # Rounding spreads evenly over the distance between two numbers.
        error = np.spacing(precision(np.abs(self._mesh.bounds).max())) / np.sqrt(12)
        return precision if error <= _POSITION_ERROR * pixel else np.float64


def _mixed(shares: Sequence[np.ndarray], corners: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Values at points with these barycentric coordinates, of values at the corners of triangles [3, F], [n]."""
    first, second, third = (share * values.take(faces) for share, values in zip(shares, corners, strict=True))
    first += second
    first += third
    return first


def index_type(shape: tuple[int, int]) -> np.dtype:
    """The smallest signed integer type, 32 bits at least, for flat indices of an image."""
    return np.result_type(np.int32, np.min_scalar_type(-shape[0] * shape[1]))


def _packed(column: np.ndarray, places: np.ndarray, sizes: Sequence[int]) -> np.ndarray:
    """The first `sizes` values from each of some places on, moved together in place."""
    end = 0
    for place, size in zip(places, sizes, strict=False):
        column[end : end + size] = column[place : place + size]
        end += size
    column.resize((end, *column.shape[1:]), refcheck=False)
    return column
