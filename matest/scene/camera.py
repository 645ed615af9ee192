"""Cameras: from a pixel to a ray of the world, and from a point of the world to its place in the image.

Pixel coordinates put the origin at the top-left corner of the image and pixel centres at +0.5. A camera matrix of
`cv2.calibrateCamera`, which puts pixel centres at whole numbers, needs 0.5 added to its principal point.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from matest.errors import InputError


@dataclass(frozen=True)
class Camera:
    """Pose and projection of a camera at `position` that looks to `target`, with `up` upward in the image.

    The default is the distant viewer of normal maps and spheres: orthographic, along z.

    At most one of `height` (orthographic: world units across the image height), `fov_y` (perspective: vertical field
    of view, rad) and `matrix` (perspective: 3×3 pinhole matrix in pixels) is set. `distortion` has OpenCV's
    k1, k2, p1, p2[, k3].

    Raises:
        InputError: a pose without direction.
    """

    position: tuple[float, float, float] = (0.0, 0.0, 1.0)
    target: tuple[float, float, float] = (0.0, 0.0, 0.0)
    up: tuple[float, float, float] = (0.0, 1.0, 0.0)
    height: float | None = None
    fov_y: float | None = None
    matrix: tuple[tuple[float, ...], ...] | None = None
    distortion: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        backward = np.subtract(self.position, self.target)
        sideways = np.cross(self.up, backward)
        lengths = np.linalg.norm(self.up) * np.linalg.norm(backward)
        if not np.linalg.norm(sideways) > 1e-9 * lengths or not np.isfinite(lengths):
            raise InputError(
                "camera: position, target and up must differ and up must not point along the line of sight; "
                f"got position {list(self.position)}, target {list(self.target)}, up {list(self.up)}."
            )

    @property
    def orthographic(self) -> bool:
        return self.fov_y is None and self.matrix is None

    @property
    def forward(self) -> np.ndarray:
        """Unit vector from the camera along its line of sight [3]."""
        return -self.axes()[2]

    def axes(self) -> np.ndarray:
        """Rows: right, up, backward (toward the viewer) in world coordinates."""
        backward = np.subtract(self.position, self.target, dtype=float)
        backward /= np.linalg.norm(backward)
        right = np.cross(np.asarray(self.up, dtype=float), backward)
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(backward, right), backward])

    def rays(self, shape: tuple[int, int], pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Origins and unit directions (away from the camera), [N, 3] each, of `pixels` (flat indices, row-major).

        Args:
            shape: height and width of the image in pixels.
            pixels: flat indices [N].
        """
        return self.through(*self.plane(shape, pixels))

    def through(self, u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Origins and unit directions of the rays through places on the plane of the image, as `plane` gives them."""
        axes = self.axes()
        offsets, backward = np.stack([u, v], axis=1) @ axes[:2], axes[2]
        if self.orthographic:
            origins = np.asarray(self.position, dtype=float) + offsets
            return origins, np.broadcast_to(-backward, origins.shape)
        directions = offsets - backward
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        return np.broadcast_to(np.asarray(self.position, dtype=float), directions.shape), directions

    def plane(self, shape: tuple[int, int], pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where the rays of `pixels` (flat indices) cross the plane of the image: to the right and up, [N] each.

        World units from the axis of an orthographic camera, at unit depth before a perspective one.
        """
        rows = pixels // shape[1]
        return self.plane_at(shape, pixels - rows * shape[1] + 0.5, rows + 0.5)

    def plane_at(self, shape: tuple[int, int], x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """`plane` at any places of the image, in pixels from its left and upper edge [N] each."""
        if self.orthographic:
            unit = (self.height or 1.0) / shape[0]
            return (x - shape[1] / 2) * unit, (shape[0] / 2 - y) * unit
        u, v = self._normalised(shape, x, y)
        return u, -v

    def coordinates(self, points: np.ndarray) -> np.ndarray:
        """Points of the world [..., 3] to the right, up, and along the line of sight, from the camera's position."""
        right, up, backward = self.axes()
        return np.subtract(points, self.position) @ np.stack([right, up, -backward], axis=1)

    def project(self, shape: tuple[int, int], points: np.ndarray) -> np.ndarray:
        """Where points of the world [N, 3] appear in the image, in pixels from its left and upper edge [N, 2].

        NaN for points that do not lie before a perspective camera. Far outside the image a lens with distortion may
        bend them back into it: whether a point is seen, its line of sight tells.
        """
        seen = self.coordinates(points)
        if self.orthographic:
            unit = (self.height or 1.0) / shape[0]
            return np.stack([shape[1] / 2 + seen[:, 0] / unit, shape[0] / 2 - seen[:, 1] / unit], axis=1)
        import cv2

        places = np.full((len(seen), 2), np.nan)
        before = seen[:, 2] > 0
        if before.any():
            # OpenCV's camera has y downward.
            places[before] = cv2.projectPoints(
                seen[before] * (1.0, -1.0, 1.0), np.zeros(3), np.zeros(3), self.pixel_matrix(shape),
                np.array(self.distortion or (0.0,) * 4),
            )[0][:, 0]  # fmt: skip
        return places

    def toward(self, points: np.ndarray) -> np.ndarray:
        """Vectors from points of the world [N, 3] to the camera, of unit length if it is orthographic [N, 3]."""
        if self.orthographic:
            return np.broadcast_to(-self.forward, points.shape)
        return np.asarray(self.position) - points

    def pixel_matrix(self, shape: tuple[int, int]) -> np.ndarray:
        """The 3×3 pinhole matrix of a perspective camera for an image of this shape."""
        if self.matrix is not None:
            return np.asarray(self.matrix, dtype=float)
        assert self.fov_y is not None
        focal = shape[0] / 2 / np.tan(self.fov_y / 2)
        return np.array([[focal, 0, shape[1] / 2], [0, focal, shape[0] / 2], [0, 0, 1]])

    def _normalised(self, shape: tuple[int, int], x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Image-plane coordinates at unit distance (x right, y down), without lens distortion."""
        matrix = self.pixel_matrix(shape)
        if any(self.distortion):
            import cv2

            points = np.stack([x, y], axis=-1)[:, None, :]
            criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12)
            undistorted = cv2.undistortPoints(points, matrix, np.array(self.distortion), criteria=criteria)
            return undistorted[:, 0, 0], undistorted[:, 0, 1]
        return (x - matrix[0, 2]) / matrix[0, 0], (y - matrix[1, 2]) / matrix[1, 1]

    def footprint(self, shape: tuple[int, int], distance: np.ndarray) -> np.ndarray:
        """Width of a pixel in world units at `distance` along its ray."""
        if self.orthographic:
            return np.full_like(distance, (self.height or 1.0) / shape[0])
        return distance / self.pixel_matrix(shape)[1, 1]
