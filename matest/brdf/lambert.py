"""Lambert's law."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from torch import Tensor

from matest.brdf import declarations
from matest.brdf.base import Brdf
from matest.brdf.terms import Term, lambertian
from matest.directions import Directions


@dataclass(frozen=True, eq=False)
class Lambert(Brdf):
    """f = albedo / π: the radiance of the surface does not depend on the direction of view."""

    albedo: Tensor = declarations.albedo("albedo")

    name: ClassVar[str] = "lambert"
    source: ClassVar[str] = "Lambert 1760"
    body: ClassVar[bool] = True

    def terms(self, directions: Directions) -> tuple[Term, ...]:
        return (lambertian(("albedo",), directions.cos_i * directions.cos_o),)
