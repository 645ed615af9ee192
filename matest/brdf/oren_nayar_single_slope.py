"""Oren and Nayar's surfaces whose V-cavities all have the same slope, §3.1-3.2."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from torch import Tensor

from matest.brdf import declarations, groove
from matest.brdf.base import Brdf
from matest.brdf.terms import Term
from matest.directions import Directions
from matest.parameters import interval, option, parameter

# Number of orientations in the mean over azimuth: as many as the finest rule of `OrenNayarExact`.
_ORIENTATIONS = 64
_PARALLEL = {"isotropic": ("false",)}


@dataclass(frozen=True, eq=False)
class OrenNayarSingleSlope(Brdf):
    """Lambertian V-cavities of one slope: parallel grooves, or grooves of every orientation.

    f = mean over both facets of (Lrp¹ + Lrp²)/(E0 cos θi), ρ and ρ² apart

    `albedo` ρ is the albedo of a facet, `facet_angle` t (rad) its tilt, `azimuth` ψ (rad) the direction across the
    grooves, counted from the tangent toward the bitangent; values half a turn apart are the same surface. For a mesh or
    normal map the tangent is the projection of the world's x axis, or of its y axis where the normal is within 26° of
    x. `interreflection` as in `OrenNayar`.

    With `isotropic=true` the mean over ψ is taken (64 midpoints of half a turn) and there is no `azimuth`. Shapes as
    `Brdf`.

    Source: Oren & Nayar 1994, §3.1 (eq. 4-11) and §3.2. Limits: t = 0 is Lambert exactly. The slope is kept below 89°,
    where facets stand upright. Kinks where a facet begins to be shadowed or masked.
    """

    albedo: Tensor = declarations.albedo()
    facet_angle: Tensor = parameter(interval(0, math.radians(89)), unit="rad", doc="tilt of every facet", default=0.3)
    azimuth: Tensor = parameter(
        interval(0, math.pi), unit="rad", doc="direction across the grooves", default=0.0, when=_PARALLEL, periodic=True
    )
    interreflection: Tensor = declarations.interreflection()
    isotropic: str = option("false", choices=("false", "true"), doc="grooves of every orientation")

    name: ClassVar[str] = "oren-nayar-single-slope"
    source: ClassVar[str] = "Oren & Nayar 1994, §3.1-3.2"
    body: ClassVar[bool] = True

    def terms(self, directions: Directions) -> tuple[Term, ...]:
        cos_t, sin_t = self.facet_angle.cos(), self.facet_angle.sin()
        if self.isotropic == "true":
            # One more axis, of orientations.
            d = directions
            cos_half, sin_half = d.half_azimuth
            psi = groove.half_range(_ORIENTATIONS).to(d.cos_i)
            cos_psi, sin_psi = psi.cos(), psi.sin()
            along_i = (d.sin_i * (cos_half * cos_psi + sin_half * sin_psi)).unsqueeze(-2)
            along_o = (d.sin_o * (cos_half * cos_psi - sin_half * sin_psi)).unsqueeze(-2)
            cos_i, cos_o = d.cos_i.unsqueeze(-2), d.cos_o.unsqueeze(-2)
            cos_t, sin_t = cos_t[..., None], sin_t[..., None]
        else:
            along_i, along_o = directions.along(self.azimuth)
            cos_i, cos_o = directions.cos_i, directions.cos_o
        half_tan = 0.5 * sin_t / cos_t
        p = 0.5 + half_tan * groove.tangents(cos_i, along_i)
        q = 0.5 + half_tan * groove.tangents(cos_o, along_o)
        once = groove.direct(cos_t, p, q) / math.pi
        twice = groove.interreflection(sin_t * sin_t, cos_t, p, q) / math.pi
        if self.isotropic == "true":
            once, twice = once.mean(-1), twice.mean(-1)
        return Term(("albedo",), once), Term(("albedo", "albedo", "interreflection"), twice)
