"""What residuals of maps tell: the degrees of freedom that texels take, and shapes in common that differ after all."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from matest.estimators.texels.elimination import Elimination
from matest.estimators.texels.fit import TexelFitter, TileFit
from matest.estimators.texels.maps import MapFit
from matest.estimators.texels.small_systems import Factored
from matest.inference.map_calibration import at_some_texels
from matest.samples.account import CalibratedSamples
from matest.workers import single_threaded_torch

# Standard errors of the variance of a shape beyond which it is none of chance.
_BEYOND_CHANCE = 6.0
# Scatter relative to the value that is worth a map.
_WORTH_A_MAP = 0.05
# Share of what residuals have beyond the noise that a shape of each texel explains, if it is the likeliest cause:
# errors of lights and missing lobes look like a shape that differs for a part only.
_LIKELIEST = 0.7
# Information of a texel relative to the mean below which it is rounding.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class VaryingShape:
    """A shape in common that differs from texel to texel.

    Attributes:
        name: of the parameter.
        spread: its standard deviation among the texels, to first order.
        explained: share of the residuals beyond the noise, to first order.
    """

    name: str
    spread: float
    explained: float


@dataclass(frozen=True, eq=False)
class MapResiduals:
    """Residuals of maps.

    Attributes:
        taken: degrees of freedom that the N texels take of each of the I photographs [I].
        varying: shapes in common that differ from texel to texel, the likeliest first.
    """

    taken: Tensor
    varying: list[VaryingShape]

    @classmethod
    @single_threaded_torch()
    @torch.no_grad()
    def of(cls, fit: MapFit, samples: CalibratedSamples, count: int, seed: int) -> MapResiduals:
        """Those of some texels.

        Args:
            fit: of the maps.
            samples: that were fitted.
            count: of texels that say so.
            seed: of the choice of these.
        """
        fitter, here = at_some_texels(fit, samples, count, seed)
        seen = int((~fit.theta[0].isnan()).sum())
        taken = _taken(fit, here) * seen / max(len(here.tile), 1)
        varying = sorted(_varying(fit, fitter, here), key=lambda shape: -shape.explained)
        return cls(taken, varying)


def _taken(fit: MapFit, here: TileFit) -> Tensor:
    """Degrees of freedom that the texels of a tile take of each photograph [I]: the traces of its leverage."""
    by_image = here.problem.by_image(here.theta, fit.texels.rows).information
    total = by_image.sum(2)
    total.diagonal().add_(here.prior.precision.T)
    factored = Factored.of(total)
    return torch.stack(
        [factored.solve(by_image[:, :, k]).diagonal().sum(dtype=torch.float64) for k in range(here.tile.images)]
    )


def _varying(fit: MapFit, fitter: TexelFitter, here: TileFit) -> Iterator[VaryingShape]:
    """Shapes whose scores scatter from texel to texel by more than the noise makes them.

    The score of a shape at texel i, the others following, is that of the noise, of variance χ² Iᵢ, and of what the
    texel's own value is off, Iᵢ δᵢ.
    """
    problem, chi2 = fit.texels.problem, fit.inflation
    elimination = Elimination.of(fitter, here)
    excess = (fit.chi2 - 1) * fit.degrees_left * len(here.tile) / fit.theta.shape[1]
    for k, row in enumerate(fit.texels.common):
        if row.name not in problem.shapes or problem.count(row.name) > 1:
            continue
        scores, information = elimination.scores[k].double(), elimination.information[k, k].double()
        tells = information > _ROUNDING * information.mean()
        scores, information = scores[tells], information[tells]
        squares = information.square().sum()
        variance = float((scores.square() - chi2 * information).sum() / squares)
        chance = chi2 * math.sqrt(2 / max(float(squares), _ROUNDING))
        explained = float((scores.square() / information - 1).sum()) / max(excess, _ROUNDING)
        value = abs(float(fit.unknowns[row.place]))
        if variance > max(_BEYOND_CHANCE * chance, (_WORTH_A_MAP * value) ** 2) and explained > _LIKELIEST:
            yield VaryingShape(row.name, math.sqrt(variance), min(explained, 1.0))
