"""A mirror sphere as a camera sees it: from a place in the image to the direction that it reflects."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from matest.errors import InputError
from matest.scene.camera import Camera
from matest.scene.circle import circle_through, edge_points, jackknife

# Standard error of each number of a circle that is stated, pixels: people read them off a picture to the pixel.
STATED_STD = 0.5
# Largest rms distance of the edge from the outline of a sphere, as a share of its radius.
_LARGEST_SPREAD = 0.03
# Points of an edge that determine the outline of a sphere, at least.
_FEWEST_POINTS = 8
# Points that stand for a circle that is stated.
_POINTS = 64


class Reflection(NamedTuple):
    """What a mirror sphere shows at some places of the image.

    Attributes:
        directions: unit vectors to what is seen there, in world coordinates [N, 3].
        normals: of the sphere there [N, 3], which are also places on it, in radii from its centre.
    """

    directions: np.ndarray
    normals: np.ndarray


@dataclass(frozen=True)
class MirrorSphere:
    """The outline of a mirror sphere in an image, and the camera that sees it.

    Attributes:
        camera: orthographic or perspective.
        shape: height and width of the image in pixels.
        outline: of an orthographic image the circle's x, y and radius in pixels; of a perspective one the axis of the
            cone of its outline in world coordinates, divided by the cosine of the half-angle; [3].
        covariance: of the outline [3, 3].
        circle: x, y and radius in pixels, of a perspective image of the best circle.
    """

    camera: Camera
    shape: tuple[int, int]
    outline: np.ndarray
    covariance: np.ndarray
    circle: tuple[float, float, float]

    @classmethod
    def from_mask(cls, mask: np.ndarray, camera: Camera) -> MirrorSphere:
        """The sphere whose outline the edge of a mask H×W follows.

        Raises:
            InputError: the edge is no outline of a sphere.
        """
        return cls.from_edge(edge_points(mask), (mask.shape[0], mask.shape[1]), camera)

    @classmethod
    def from_edge(cls, edge: np.ndarray, shape: tuple[int, int], camera: Camera) -> MirrorSphere:
        """The sphere whose outline points (x, y) of an image follow [n, 2], in their order along it.

        Raises:
            InputError: they are no outline of a sphere.
        """
        if camera.orthographic:
            fit = circle_through(edge)
            covariance = np.diag([fit.centre_std**2, fit.centre_std**2, fit.radius_std**2])
            circle = (*fit.centre, fit.radius)
            return cls(camera, shape, np.array(circle), covariance, circle)
        if len(edge) < _FEWEST_POINTS:
            raise InputError("the mask's edge is too short for the outline of a sphere; give --circle X,Y,R.")
        rays = _rays(camera, shape, edge)
        outline = np.linalg.lstsq(rays, np.ones(len(rays)), rcond=None)[0]
        misfit = 1 - rays @ outline
        # The misfit is the angle off the cone times the tangent of its half-angle, that is about its radius.
        tangent = np.sqrt(max(outline @ outline - 1, 0.0))
        spread = float(np.sqrt(np.mean(misfit**2)))
        if not spread <= _LARGEST_SPREAD * tangent**2:
            raise InputError(
                "the mask's edge is no outline of a sphere in this perspective; correct the mask or the [camera], or "
                "give --circle X,Y,R."
            )
        return cls(camera, shape, outline, jackknife(rays, misfit), _circle_around(edge))

    @classmethod
    def from_circle(cls, circle: tuple[float, float, float], shape: tuple[int, int], camera: Camera) -> MirrorSphere:
        """The sphere whose outline is a circle that somebody states.

        Args:
            circle: x, y and radius in pixels.
            shape: height and width of the image.
            camera: that sees it.
        """
        stated = np.array(circle)
        if camera.orthographic:
            return cls(camera, shape, stated, STATED_STD**2 * np.eye(3), circle)
        outline = _cone(camera, shape, stated)
        steps = STATED_STD * np.eye(3)
        jacobian = np.stack([_cone(camera, shape, stated + step) - outline for step in steps], axis=1)
        return cls(camera, shape, outline, jacobian @ jacobian.T, circle)

    @property
    def radius(self) -> float:
        """In pixels."""
        return self.circle[2]

    @property
    def distance(self) -> float | None:
        """Of the centre from a perspective camera, in radii; None for a distant viewer."""
        if self.camera.orthographic:
            return None
        squared = float(self.outline @ self.outline)
        return float(np.sqrt(squared / (squared - 1)))

    def centre(self, outline: np.ndarray | None = None) -> np.ndarray:
        """Where the centre stands from a perspective camera, in radii [3]; of another outline where one is given."""
        axis = self.outline if outline is None else outline
        # The cone's half-angle has the cosine 1 / |axis|; its sine is one over the distance.
        return axis / np.sqrt(axis @ axis - 1)

    def contains(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Whether places of the image [N] lie inside the outline."""
        if self.camera.orthographic:
            column, row, radius = self.outline
            inside: np.ndarray = (x - column) ** 2 + (y - row) ** 2 < radius**2
            return inside
        seen: np.ndarray = _rays(self.camera, self.shape, np.stack([x, y], axis=1)) @ self.outline > 1
        return seen

    def reflect(self, x: np.ndarray, y: np.ndarray, outline: np.ndarray | None = None) -> Reflection:
        """What places of the image show: r = 2 (n·v) n − v, with the normal n and the unit vector v to the viewer.

        Args:
            x, y: places in pixels [N]; those outside the outline count as lying on it.
            outline: another one than the sphere's.
        """
        outline = self.outline if outline is None else outline
        if self.camera.orthographic:
            right, up, backward = self.camera.axes()
            u, v = (x - outline[0]) / outline[2], (outline[1] - y) / outline[2]
            depth = np.sqrt(np.clip(1 - u * u - v * v, 0, None))
            normals = u[:, None] * right + v[:, None] * up + depth[:, None] * backward
            view = np.broadcast_to(backward, normals.shape)
        else:
            rays, centre = _rays(self.camera, self.shape, np.stack([x, y], axis=1)), self.centre(outline)
            along = rays @ centre
            # Of the two places where a ray meets the sphere, the nearer one.
            reach = along - np.sqrt(np.clip(along**2 - centre @ centre + 1, 0, None))
            normals = reach[:, None] * rays - centre
            view = -rays
        cosine = (normals * view).sum(axis=1, keepdims=True)
        return Reflection(2 * cosine * normals - view, normals)

    def solid_angles(self, x: np.ndarray, y: np.ndarray, outline: np.ndarray | None = None) -> np.ndarray:
        """Solid angles of what pixels centred at (x, y) [N] show, sr [N]; of another outline where one is given."""
        right, down = np.moveaxis(self.slopes(x, y, outline), -1, 0)
        angles: np.ndarray = np.linalg.norm(np.cross(right, down), axis=1)
        return angles

    def slopes(self, x: np.ndarray, y: np.ndarray, outline: np.ndarray | None = None) -> np.ndarray:
        """Change of the direction that is shown, a pixel to the right and down [N, 3, 2]."""

        def across(dx: float, dy: float) -> np.ndarray:
            ends = (self.reflect(x + sign * dx, y + sign * dy, outline).directions for sign in (0.5, -0.5))
            return np.subtract(*ends)

        return np.stack([across(1, 0), across(0, 1)], axis=-1)


def standard_errors(covariance: np.ndarray) -> np.ndarray:
    """One standard error along each axis of covariances [..., n, n], a row each."""
    variances, axes = np.linalg.eigh(covariance)
    errors: np.ndarray = np.sqrt(np.clip(variances, 0, None))[..., None] * np.swapaxes(axes, -1, -2)
    return errors


def _rays(camera: Camera, shape: tuple[int, int], places: np.ndarray) -> np.ndarray:
    """Unit directions of a perspective camera's rays through places (x, y) of its image [N, 2], [N, 3]."""
    return camera.through(*camera.plane_at(shape, places[:, 0], places[:, 1]))[1]


def _cone(camera: Camera, shape: tuple[int, int], circle: np.ndarray) -> np.ndarray:
    """The `outline` of the cone of rays through a circle."""
    angles = np.linspace(0, 2 * np.pi, _POINTS, endpoint=False)
    edge = circle[:2] + circle[2] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    rays = _rays(camera, shape, edge)
    outline: np.ndarray = np.linalg.lstsq(rays, np.ones(len(rays)), rcond=None)[0]
    return outline


def _circle_around(edge: np.ndarray) -> tuple[float, float, float]:
    """Centre and mean radius of the ellipse that points [n, 2] follow."""
    from skimage.measure import CircleModel

    circle = CircleModel.from_estimate(edge)
    (x, y), radius = circle.center, circle.radius
    return float(x), float(y), float(radius)
