"""How large residuals are by the angles that a reflectance depends on."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from matest.samples import Batch, Tile
from matest.samples.residual_scale import ResidualScale, half_angle
from matest.scene.points import Points

# Classes of an angle, and samples of a class that are enough.
_CLASSES = 30
_FEW = 10


@dataclass(frozen=True, eq=False)
class AngularResiduals:
    """Residuals class by class of an angle, relative to the rms signal of all values; outliers are left out.

    Attributes:
        degrees: the middle of each class that has enough samples, ascending [K].
        mean: of the residuals, positive where the photographs are brighter than the model [K].
        rms: of the residuals [K].
        noise: rms that the noise alone would give [K].
    """

    degrees: Tensor
    mean: Tensor
    rms: Tensor
    noise: Tensor

    def __len__(self) -> int:
        return len(self.degrees)


def residuals_by_angle(
    radiance: Callable[[Tile], Tensor], residual_scale: ResidualScale, batch: Batch
) -> Mapping[str, AngularResiduals]:
    """The residuals of some samples by "half angle" and by "angle of incidence".

    Args:
        radiance: gives that of the model at the samples of a tile [n, C].
        residual_scale: by which outliers are judged.
        batch: the samples, a random part of those that were fitted.
    """
    tile = Tile(batch)
    with torch.no_grad():
        model = radiance(tile)
    squares = tile.about(model, residual_scale)
    counts = (squares.plain & (squares.weight > 0)).to(model)
    signal = float((batch.radiance.square() * counts).sum() / counts.sum().clamp(min=1)) ** 0.5
    columns = torch.stack([counts, (batch.radiance - model) * counts, (batch.radiance - model).square() * counts])
    sums = torch.cat([columns, (batch.variance(model) * counts)[None]]).sum(-1).double().cpu()
    angles = {"half angle": half_angle(batch.points).sqrt().asin(), "angle of incidence": _incidence(batch.points)}
    return {name: _by_class(angle.rad2deg().cpu(), sums, signal or 1.0) for name, angle in angles.items()}


def _incidence(points: Points) -> Tensor:
    """Angle between the normal and the light that is brightest on the surface, rad [n]; 90° where there is no light."""
    cosines = points.wi[..., 2].clamp(0, 1)
    if not cosines.shape[1]:
        return torch.full((len(cosines),), torch.pi / 2)
    brightest = (points.irradiance.mean(-1) * cosines).argmax(1, keepdim=True)
    return cosines.gather(1, brightest)[:, 0].acos()


def _by_class(degrees: Tensor, sums: Tensor, signal: float) -> AngularResiduals:
    """The residuals by an angle [n], from counts, residuals, their squares and the noise variance [4, n]."""
    width = 90 / _CLASSES
    label = (degrees / width).long().clamp(0, _CLASSES - 1)
    totals = torch.zeros(4, _CLASSES, dtype=torch.float64).index_add_(1, label, sums)
    enough = torch.bincount(label, minlength=_CLASSES) >= _FEW
    enough &= totals[0] > 0
    count, residual, square, variance = totals[:, enough]
    middles = (torch.arange(_CLASSES)[enough] + 0.5) * width
    return AngularResiduals(
        middles.double(),
        residual / count / signal,
        (square / count).sqrt() / signal,
        (variance / count).sqrt() / signal,
    )
