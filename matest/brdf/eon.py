"""The energy-preserving Oren-Nayar model."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from torch import Tensor

from matest.brdf import declarations
from matest.brdf.base import Brdf
from matest.brdf.terms import Term
from matest.directions import Directions
from matest.parameters import parameter, unit_interval

# c1 and c2 of the paper.
_C1 = 0.5 - 2 / (3 * math.pi)
_C2 = 2 / 3 - 28 / (15 * math.pi)


@dataclass(frozen=True, eq=False)
class Eon(Brdf):
    """Fujii's single-scattering model with another roughness, and a diffuse lobe for the light that it loses.

    f = (ρ A/π) (1 + r s/t) + (ρms/π) A r (c1 − G(θi)/π) (c1 − G(θr)/π) / (c1 − c2),   A = 1/(1 + c1 r)
    ρms = ρ² Ē / (1 − ρ(1 − Ē)),   Ē = A (1 + c2 r),   c1 = 1/2 − 2/(3π),   c2 = 2/3 − 28/(15π)
    G(θ) = sin θ (θ − sin θ cos θ) + ⅔ sin θ (cos θ (1 + sin θ + sin² θ)/(1 + sin θ) − 1)

    with s/t as in `Fujii`. `albedo` ρ is the single-scattering albedo, `diffuse_roughness` r in [0, 1]: a number of
    this model's own, not σ in radians. Shapes as `Brdf`.

    The second lobe is written without the vanishing quotient (1 − E)(1 − E)/(1 − Ē) of the paper. Source: Portsmouth,
    Kutz & Hill 2024. Limits: r = 0 is Lambert exactly; ρ = 1 reflects all light in every direction.
    """

    albedo: Tensor = declarations.albedo("single-scattering albedo ρ")
    diffuse_roughness: Tensor = parameter(unit_interval, unit="1", doc="roughness r, 0 to 1", default=0.3)

    name: ClassVar[str] = "eon"
    source: ClassVar[str] = "Portsmouth, Kutz & Hill 2024 (EON)"
    body: ClassVar[bool] = True

    def terms(self, directions: Directions) -> tuple[Term, ...]:
        d, rho, r = directions, self.albedo, self.diffuse_roughness
        a = 1 / (1 + _C1 * r)
        average = a * (1 + _C2 * r)
        rho_ms = rho * rho * average / (1 - rho * (1 - average))
        single = rho * a * (1 + r * d.azimuthal)
        loss_i, loss_o = (_C1 - _g(d.theta_i, d.sin_i, d.cos_i)), (_C1 - _g(d.theta_o, d.sin_o, d.cos_o))
        multiple = rho_ms * a * r * (loss_i * loss_o / (_C1 - _C2))
        return (Term((), (single + multiple) / math.pi),)


def _g(theta: Tensor, sin: Tensor, cos: Tensor) -> Tensor:
    """G/π at polar angle θ: at roughness r the single-scattering albedo is A (1 + r G/π)."""
    segment = theta - sin * cos
    rest = (2 / 3) * (cos * (1 + sin + sin * sin) / (1 + sin) - 1)
    return sin * (segment + rest) / math.pi
