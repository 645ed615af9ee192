"""What the camera files of other programs have in common: a pose and a lens for every photograph."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np

from matest.capture.schema import CameraTable
from matest.errors import InputError

# Largest departure of a stored rotation from one of unit scale: files with four digits are within it.
_ROUNDING = 1e-3


@dataclass(frozen=True)
class Lens:
    """A pinhole with OpenCV's distortion, in pixels with centres at +0.5.

    Attributes:
        size: width and height of the images that it is for.
        focal: lengths along x and y.
        centre: the principal point, x and y.
        distortion: k1, k2, p1, p2[, k3[, k4, k5, k6]]; none if empty.
    """

    size: tuple[int, int]
    focal: tuple[float, float]
    centre: tuple[float, float]
    distortion: tuple[float, ...] = ()

    def scaled(self, size: tuple[int, int]) -> Lens | None:
        """The same lens before images of another size (width, height); None if they have another shape."""
        if self.size[0] * size[1] != self.size[1] * size[0]:
            return None
        factor = size[0] / self.size[0]
        focal, centre = ((factor * x, factor * y) for x, y in (self.focal, self.centre))
        return replace(self, size=size, focal=focal, centre=centre)


@dataclass(frozen=True)
class View:
    """The camera of one photograph.

    Attributes:
        axes: unit vectors of the world to the right, up and backward (toward the viewer), rows [3, 3].
        position: in world units, [3].
        lens: of the camera.
        notes: what was done to the stored values and a user should know, each a clause without a full stop.
    """

    axes: np.ndarray
    position: np.ndarray
    lens: Lens
    notes: tuple[str, ...] = ()

    def table(self) -> CameraTable:
        """The `[camera]` table that says the same."""
        # A target as far as the origin keeps the digits of the line of sight.
        # What is beyond all numbers is refused by the ranges of a camera.
        with np.errstate(over="ignore", invalid="ignore"):
            target = self.position - max(1.0, float(np.linalg.norm(self.position))) * self.axes[2]
        (fx, fy), (cx, cy) = self.lens.focal, self.lens.centre
        return CameraTable(
            kind="perspective",
            position=_vector(self.position),
            target=_vector(target),
            up=_vector(self.axes[1]),
            matrix=((fx, 0.0, cx), (0.0, fy, cy), (0.0, 0.0, 1.0)),
            distortion=list(self.lens.distortion),
        )


class CameraFile(Protocol):
    """A file, or a folder of files, with the cameras of many photographs.

    Attributes:
        path: of the file, for refusals.
        names: of the photographs, as the file has them.
    """

    @property
    def path(self) -> Path: ...

    @property
    def names(self) -> Sequence[str]: ...

    def view(self, place: int, size: tuple[int, int]) -> View:
        """The camera of the photograph at a place of `names`.

        Args:
            place: index of `names`.
            size: width and height of the images, for lenses that are stated as an angle.

        Raises:
            InputError: a lens or pose that cannot be used.
        """
        ...


def lens(label: str, size: tuple[float, float], values: Sequence[float], distortion: Sequence[float]) -> Lens:
    """A lens of the numbers in a file.

    Args:
        label: names file and photograph, for the refusal.
        size: width and height in pixels.
        values: fx, fy, cx, cy.
        distortion: in OpenCV's order; all zero: none.

    Raises:
        InputError: a number that no lens has.
    """
    if not (all(math.isfinite(value) for value in (*size, *values, *distortion)) and min(values[:2]) > 0):
        raise InputError(
            f"{label}: focal lengths must be positive and all numbers of a lens finite; got "
            f"{_listed((*values, *distortion))}."
        )
    width, height = map(int, size)
    if (width, height) != tuple(size) or min(size) < 1:
        raise InputError(f"{label}: width and height must be whole numbers of pixels; got {_listed(size)}.")
    fx, fy, cx, cy = map(float, values)
    return Lens((width, height), (fx, fy), (cx, cy), tuple(map(float, distortion)) if any(distortion) else ())


def rotation(label: str, matrix: np.ndarray) -> tuple[np.ndarray, tuple[str, ...]]:
    """The rotation in a matrix [3, 3] that may also scale, and a note if it does.

    Raises:
        InputError: it mirrors, shears, or scales the axes differently.
    """
    determinant = float(np.linalg.det(matrix)) if np.isfinite(matrix).all() else math.nan
    if determinant < 0:
        raise InputError(f"{label}: its matrix mirrors the world (determinant {determinant:.4g}); export it anew.")
    if not determinant > 0:
        raise InputError(f"{label}: its matrix is no rotation (determinant {determinant:.4g}); export it anew.")
    scale = determinant ** (1 / 3)
    left, stretches, right = np.linalg.svd(matrix / scale)
    if np.abs(stretches - 1).max() > _ROUNDING:
        raise InputError(
            f"{label}: its matrix stretches the axes of the camera differently (by {_listed(scale * stretches)}); "
            "apply the scale of the camera and its parents and export it anew."
        )
    note = f"the matrix of the camera scales by {scale:.4g}, which is left out: a camera has no scale"
    return left @ right, (note,) if abs(scale - 1) > _ROUNDING else ()


def _vector(values: np.ndarray) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z


def _listed(values: Sequence[float] | np.ndarray) -> str:
    return ", ".join(f"{value:.6g}" for value in values)
