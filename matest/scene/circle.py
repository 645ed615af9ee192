"""The circle that a sphere's silhouette is, fitted to the edge of a mask."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from matest.errors import InputError

# Runs of edge points that the standard errors are had from by leaving each out: more than one pixel's steps of an edge
# and the arcs of a hand-drawn mask lie within one of them.
_ARCS = 16


@dataclass(frozen=True)
class Circle:
    """A circle in an image, in pixels.

    Attributes:
        centre: (x, y).
        radius: of the circle.
        centre_std: standard error of each coordinate of the centre, rms of the two.
        radius_std: of the radius.
    """

    centre: tuple[float, float]
    radius: float
    centre_std: float
    radius_std: float


def fit_circle(mask: np.ndarray) -> Circle:
    """The circle that a mask's edge follows, with standard errors.

    Args:
        mask: H×W, any numeric type; nonzero = object.

    Raises:
        InputError: the edge is not a circle to 3 % of its radius.
    """
    return circle_through(edge_points(mask))


def circle_through(edge: np.ndarray) -> Circle:
    """The circle that points (x, y) along an edge follow [n, 2], in their order, with standard errors.

    Raises:
        InputError: they are no circle to 3 % of its radius.
    """
    x, y, radius = _circle_through(edge)
    offsets = edge - (x, y)
    distances = np.linalg.norm(offsets, axis=1)
    jacobian = np.column_stack([offsets / distances[:, None], np.ones(len(offsets))])
    variances = np.diagonal(jackknife(jacobian, distances - radius))
    return Circle((x, y), radius, float(np.sqrt(variances[:2].mean())), float(np.sqrt(variances[2])))


def edge_points(mask: np.ndarray) -> np.ndarray:
    """Points (x, y) in pixels along the longest edge of a mask [n, 2].

    The edge is the half-level contour of the mask (anti-aliased masks give sub-pixel positions); points on the border
    of the image, where a cropped sphere has no edge, do not count.

    Args:
        mask: H×W, any numeric type; nonzero = object.

    Raises:
        InputError: there is no edge.
    """
    from skimage.measure import find_contours

    level = mask.astype(np.float64) / mask.max()
    contours = find_contours(np.pad(level, 1), 0.5)
    if not contours:
        raise InputError("the mask has no edge to fit a circle to: it must show the sphere against a background.")
    # Padding by one pixel shifts by +1; array index i is the pixel centre i + 0.5.
    edge = max(contours, key=len) - 1 + 0.5
    height, width = mask.shape
    inner = (edge[:, 0] > 1) & (edge[:, 0] < height - 1) & (edge[:, 1] > 1) & (edge[:, 1] < width - 1)
    return edge[inner][:, ::-1]


def _circle_through(edge: np.ndarray) -> tuple[float, float, float]:
    """Centre (x, y) and radius of the best circle through points [n, 2].

    Raises:
        InputError: too few points, or they stray by 3 % of its radius.
    """
    from skimage.measure import CircleModel

    circle = CircleModel.from_estimate(edge) if len(edge) >= 8 else None
    if not circle:
        raise InputError("no circle could be fitted to the mask's edge: give centre and radius in [geometry].")
    radius = float(circle.radius)
    spread = float(np.sqrt(np.mean(circle.residuals(edge) ** 2)))
    if spread > 0.03 * radius:
        raise InputError(
            f"the mask's edge is no circle: it strays {spread:.1f} pixels (rms) from the best one, of radius "
            f"{radius:.1f}; a sphere's mask, or centre and radius in [geometry], is needed."
        )
    x, y = (float(value) for value in circle.center)
    return x, y, radius


def jackknife(jacobian: np.ndarray, misfit: np.ndarray) -> np.ndarray:
    """Covariance [p, p] of what was fitted to the points of an edge, by leaving out one arc after the other.

    An arc is a run of neighbouring points, whose errors may be correlated: the jackknife of groups (Efron 1982, ch. 3),
    with one Gauss-Newton step for each.

    Args:
        jacobian: derivatives of the model at every point [n, p], in the order of the points along the edge.
        misfit: of every point to the model [n].
    """
    arcs = np.array_split(np.arange(len(misfit)), min(_ARCS, len(misfit) // 2))
    normal = np.stack([jacobian[arc].T @ jacobian[arc] for arc in arcs])
    right = np.stack([jacobian[arc].T @ misfit[arc] for arc in arcs])
    steps = np.linalg.solve(normal.sum(0) - normal, (right.sum(0) - right)[..., None])[..., 0]
    deviations = steps - steps.mean(axis=0)
    covariance: np.ndarray = (len(arcs) - 1) / len(arcs) * deviations.T @ deviations
    return covariance
