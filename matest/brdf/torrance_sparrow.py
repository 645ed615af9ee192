"""Torrance and Sparrow's surface reflection, as Oren and Nayar add it to their body reflection."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from torch import Tensor

from matest.brdf import declarations
from matest.brdf.base import Brdf
from matest.brdf.microfacet import decay, v_cavity
from matest.brdf.terms import Term
from matest.directions import Directions

# σ below this, in radians, is replaced by it: the exponent divides by σ².
_SIGMA_FLOOR = 1e-3


@dataclass(frozen=True, eq=False)
class TorranceSparrow(Brdf):
    """Specular V-cavities with the slope distribution of the body.

    f = ks · G · exp(−α²/(2σ²)) / (cos θi cos θr),  α the angle between half vector and normal

    `specular` ks absorbs the constants of the 1967 model and its Fresnel factor; `sigma` σ (rad) is the body's: tie
    it to `oren-nayar.sigma`. Shapes as `Brdf`.

    Source: Oren & Nayar 1994, section 4 (samples C and D), after Torrance & Sparrow 1967. Limits: not normalised; the
    albedo at ks = 1 is 2.3 at normal incidence for σ = 20° and grows with σ, so ks of real surfaces is a few per cent.
    """

    specular: Tensor = declarations.amplitude("strength of the surface reflection ks", 0.02)
    sigma: Tensor = declarations.sigma()

    name: ClassVar[str] = "torrance-sparrow"
    source: ClassVar[str] = "Oren & Nayar 1994, §4; Torrance & Sparrow 1967"

    def terms(self, directions: Directions) -> tuple[Term, ...]:
        spread = self.sigma.clamp(min=_SIGMA_FLOOR)
        lobe = decay(0.5 * directions.theta2_half / spread.square())
        return (Term(("specular",), 4 * lobe * v_cavity(directions)),)
