"""How well photographs can be explained at all: by one material, whatever it is, under the light that is stated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from scipy.optimize import linear_sum_assignment, nnls
from torch import Tensor

from matest.brdf import Brdf, CookTorrance, Lambert, OrenNayar
from matest.photographs.images import full_scale
from matest.scene.points import join_points
from matest.shading import SKY_COSINES, interpolate, reflectance, shade

if TYPE_CHECKING:
    from matest.photographs.photographs import Photographs

# Any material is taken as a sum of a matte body, a rough one and highlights of these slopes.
_ROUGH = 0.9
_SLOPES = (0.05, 0.1, 0.15, 0.22, 0.32, 0.5)
# Reflectance of the highlights at normal incidence: between that of dielectrics and of metals.
_F0 = 0.5
# Photographs that must show a pixel for its own albedo to be told from the light on it.
_MIN_IMAGES = 4
# Rounds in which the material and the albedo of every pixel are estimated, one given the other.
_ROUNDS = 3
# Rounds in which the order of the lights is chosen by the common material.
_ORDERS = 3
# Half of the interval over which the slope of the transfer function is taken, fraction of full scale.
_STEP = 0.02
# What two orders must differ by for the stated one to be given up, share of all squares: twins differ by rounding.
_SAME = 1e-6
# A value so many times as large as nearly all, of this share of them, is no light from the surface.
_WILD, _BRIGHT = 100.0, 0.99
# Less than any sum of squares that is not zero.
_NOTHING = 1e-30
# Share of the most that any pixel gets: a pixel that gets less says nothing of its albedo.
_NEGLIGIBLE = 1e-8


class Explanation:
    """The best that one material and an albedo at each pixel can do to explain photographs.

    Every pixel counts that is not on a rim and not saturated, in shadow too: that a pixel is dark says as much about
    light and shape as that it is bright. Residuals are those of the stored values, whatever their transfer function.

    Args:
        photographs: few pixels of them suffice.
        other: explanation of the same surface under the same lights, whose shading is the same.
        order: of each photograph the one of `other` whose lights are its own; None: each has its own.
    """

    def __init__(
        self, photographs: Photographs, other: Explanation | None = None, order: tuple[int, ...] | None = None
    ) -> None:
        self._photographs = photographs
        own = list(order or range(len(photographs)))
        self._columns: np.ndarray = _shading(photographs) if other is None else other._columns[own]

    def misfit(self, images: Sequence[int] = (), *, textured: bool = True) -> float:
        """Rms residual over the rms stored value, of some images; of none: of all.

        With `textured`, every pixel has an albedo of its own.
        """
        some = list(images or range(len(self._photographs)))
        residual, total = self._squares[int(textured)][:, some].sum(axis=1)
        return float(np.sqrt(residual / max(total, _NOTHING)))

    @cached_property
    def _squares(self) -> list[np.ndarray]:
        """Sums of the squared residuals, and of the squares, of the stored values of each image [2, K].

        First of one albedo, then of one at each pixel.
        """
        encoding, squares = self._photographs.encoding, []
        for fitted in self._fitted:
            light = fitted * self._exposures * (1.0 if encoding.flat is None else encoding.flat)
            residual = encoding.encoded(light + encoding.black) - self._stored
            values = np.stack([residual, self._stored])
            squares.append((self._usable * values**2).sum(axis=(2, 3), dtype=np.float64))
        return squares

    @cached_property
    def order(self) -> tuple[int, ...]:
        """Of each photograph the one whose stated lights fit it best, each used once.

        First every photograph is explained under the lights of every other by one part of a material, then by the
        material that is common to all in the order found.
        """
        grey = self._columns.sum(axis=3)
        measured, squared = self._measured.sum(axis=2), self._weights.sum(axis=2) ** 2
        if len(grey) >= _MIN_IMAGES:
            # The sum of all photographs does not depend on their order: it shows the texture.
            grey = grey * _ratio(measured.sum(axis=0), grey[:, 0].sum(axis=0))
        products = np.einsum("in,jsn->sij", squared * measured, grey, optimize=True)
        sizes = np.einsum("in,jsn->sij", squared, grey**2, optimize=True)
        order = self._cheapest(-(products**2 / np.maximum(sizes, _NOTHING)).max(axis=0))
        for _ in range(_ORDERS):
            order = self._cheapest(self._residuals(order))
        return order

    def _residuals(self, order: tuple[int, ...]) -> np.ndarray:
        """Squares that remain of each photograph under the lights of each [K, K], but for those of the photograph.

        Of the material that is common to all in an order of the lights.
        """
        fitted = np.empty_like(self._measured)
        fitted[list(order)] = Explanation(self._photographs, self, order)._fitted[1]
        squared = self._weights**2
        products = np.einsum("inc,jnc->ij", squared * self._measured, fitted, optimize=True)
        return np.asarray(np.einsum("inc,jnc->ij", squared, fitted**2, optimize=True) - 2 * products)

    def _cheapest(self, cost: np.ndarray) -> tuple[int, ...]:
        """The order of least cost [K, K]; of those that differ by rounding the stated one."""
        stated = _SAME * float(((self._weights * self._measured) ** 2).sum())
        return tuple(linear_sum_assignment(cost - stated * np.eye(len(cost)))[1].tolist())

    @cached_property
    def _fitted(self) -> tuple[np.ndarray, np.ndarray]:
        """Radiance as explained [K, N, C], by one albedo and by one at each pixel."""
        squared, measured = self._weights**2, self._measured
        gain = np.ones(measured.shape[1:], np.float32)
        even = shades = self._sum(gain)
        for _ in range(_ROUNDS if len(measured) >= _MIN_IMAGES else 0):
            part, whole = ((squared * values * shades).sum(axis=0) for values in (measured, shades))
            gain = _ratio(part, whole)
            shades = self._sum(gain)
        return even, gain * shades

    def _sum(self, gain: np.ndarray) -> np.ndarray:
        """The columns in the amounts that fit best where every pixel has some gain [N, C]; without that gain."""
        scaled = self._columns * (gain * self._weights[:, None])
        target = self._weights * self._measured
        amounts = [_amounts(scaled[..., channel], target[..., channel]) for channel in range(target.shape[2])]
        return np.einsum("ksnc,cs->knc", self._columns, np.stack(amounts).astype(np.float32), optimize=True)

    @cached_property
    def _exposures(self) -> np.ndarray:
        """Signal, as a fraction of full scale, of radiance 1 [K, 1, 1]."""
        scale = self._photographs.encoding.scale
        return np.array([exposure / scale for exposure in self._photographs.exposures], np.float32)[:, None, None]

    @cached_property
    def _stored(self) -> np.ndarray:
        """Stored values as fractions of full scale [K, N, C], but 0 where a pixel does not count."""
        stored = np.stack(self._photographs.stored)
        top = full_scale(stored.dtype) if stored.dtype.kind == "u" else 1.0
        return np.where(self._usable, stored / top, 0).astype(np.float32)

    @cached_property
    def _measured(self) -> np.ndarray:
        """Radiance [K, N, C], likewise."""
        radiance = np.stack([self._photographs.radiance(image) for image in range(len(self._photographs))])
        return np.where(self._usable, radiance, np.float32(0))

    @cached_property
    def _usable(self) -> np.ndarray:
        """True for the pixels that count [K, N, 1]: neither on a rim nor saturated nor wild."""
        photographs = self._photographs
        stored = np.stack(photographs.stored)
        wild = (stored > _WILD * np.quantile(stored, _BRIGHT)).any(axis=2)
        saturated = np.stack([photographs.encoding.saturated(image).any(axis=1) for image in photographs.stored])
        return ~(wild | saturated | photographs.scene.surface.rim)[..., None]

    @cached_property
    def _weights(self) -> np.ndarray:
        """What a small change of radiance is in the stored values [K, N, C]; 0 where a pixel does not count."""
        encoding, stored = self._photographs.encoding, np.maximum(self._stored, _STEP)
        slope = 2 * _STEP / (encoding.linear(stored + _STEP) - encoding.linear(stored - _STEP))
        flat = np.float32(1) if encoding.flat is None else encoding.flat
        return slope.astype(np.float32) * flat * self._exposures * self._usable


@lru_cache(maxsize=1)
def _parts() -> tuple[Brdf, ...]:
    """The parts of which any material is the sum."""
    rough: dict[str, Any] = {"albedo": 1.0, "sigma": _ROUGH}
    highlights: list[dict[str, Any]] = [
        {"diffuse": 0.0, "specular": 1.0, "f0": _F0, "slope": slope} for slope in _SLOPES
    ]
    parts = (Lambert(torch.tensor(1.0)), OrenNayar(**rough), *(CookTorrance(**values) for values in highlights))
    return tuple(part.to(torch.float32, "cpu") for part in parts)


@lru_cache(maxsize=1)
def _skies() -> tuple[Tensor, ...]:
    """The reflectance of each part under an even sky, as `interpolate` reads it."""
    cosines = torch.linspace(0, 1, SKY_COSINES)[:, None]
    return tuple(reflectance(part, cosines) for part in _parts())


def _shading(photographs: Photographs) -> np.ndarray:
    """Radiance of the parts of a material [K, S, N, C]."""
    scene = photographs.scene
    images, pixels = len(scene), len(scene.surface)
    with torch.no_grad():
        points = join_points([scene.points(image) for image in range(images)], [pixels] * images)
        lit = replace(points, ambient=None)
        size = (images * pixels, scene.channels)
        radiance = torch.stack([shade(part, lit).expand(size) for part in _parts()])
        if points.ambient is not None:
            radiance += points.ambient * torch.stack([interpolate(sky, points.wo[..., 2:]) for sky in _skies()])
    return np.ascontiguousarray(radiance.reshape(-1, images, pixels, scene.channels).transpose(0, 1))


def _amounts(columns: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Amounts [S], none of them negative, of columns [K, S, N] that sum up to the values [K, N] as well as they can."""
    matrix = np.moveaxis(columns, 1, 0).reshape(columns.shape[1], -1).astype(np.float64)
    return _solved(matrix @ matrix.T, matrix @ values.reshape(-1))


def _solved(gram: np.ndarray, moment: np.ndarray) -> np.ndarray:
    """Amounts by normal equations [S, S] and [S]."""
    scale = 1 / np.sqrt(np.maximum(np.diag(gram), _NOTHING))
    lower = np.linalg.cholesky(scale[:, None] * gram * scale + 1e-9 * np.eye(len(gram)))
    amounts: np.ndarray = scale * nnls(lower.T, np.linalg.solve(lower, scale * moment))[0]
    return amounts


def _ratio(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    """Their ratio; 0 where there is next to nothing of the whole."""
    seen = whole > _NEGLIGIBLE * whole.max(initial=0)
    return np.where(seen, part / np.where(seen, whole, 1), 0).astype(np.float32)
