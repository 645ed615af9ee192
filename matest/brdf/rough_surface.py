"""The rough surface of Li and Torrance's components: Gaussian heights with Gaussian autocorrelation."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import torch
from torch import Tensor

from matest.brdf import declarations
from matest.brdf.base import Brdf
from matest.brdf.microfacet import beckmann, beckmann_anisotropic
from matest.directions import Directions
from matest.errors import InputError
from matest.parameters import Derived, Role, option

_ISOTROPIC = {"anisotropy": ("none",)}
_ANISOTROPIC = {"anisotropy": ("printed", "corrected")}
# Cosines below this are replaced by it: at grazing the roughness of eq. 8 vanishes.
_COS_FLOOR = 1e-4
# Cosines above this are replaced by it in log(1 − cos θ), which stays finite in float32.
_COS_CEILING = 1 - 2**-24
# Range of the exponents τ/σ: no surface is rougher than at its lower end; at its upper end nothing is masked.
_EXPONENTS = (0.1, 1e3)
# Logarithm of the smallest effective roughness σe/σ.
_LOG_LIMIT = math.log(1e-4)


def _slope_ratio(name: str, length: str, when: Mapping[str, tuple[str, ...]]) -> Derived:
    """σ/τ: incoherent reflection depends on the two lengths through this ratio alone."""
    return Derived(
        name,
        unit="1",
        doc=f"height_rms / {length}",
        value=lambda values: values["height_rms"] / values[length],
        sets=length,
        inverse=lambda ratio, others: others["height_rms"] / ratio,
        when=when,
    )


@dataclass(frozen=True, eq=False)
class RoughSurface(Brdf):
    """Parameters of a rough surface: reflectance at normal incidence and the two lengths of its roughness.

    `f0`; `height_rms` σ and `correlation_length` τ in µm. Only their ratio has an effect, except on coherent light; an
    estimate reports it as `slope_ratio`.
    `masking=off` takes S = 1 and σe = σ (smooth surfaces, guideline C; or directions within `unmasked_angle`). With
    `anisotropy` τ differs along tangent and bitangent (`correlation_length_x`, `_y`), and the azimuthal law of S is
    that of eq. 25 as `printed`, or `corrected` to the slope along the azimuth.
    """

    f0: Tensor = declarations.f0()
    height_rms: Tensor = declarations.height_rms(held=1.0, role=Role.YARDSTICK)
    correlation_length: Tensor = declarations.correlation_length(when=_ISOTROPIC)
    correlation_length_x: Tensor = declarations.correlation_length(
        "correlation length along the tangent", when=_ANISOTROPIC
    )
    correlation_length_y: Tensor = declarations.correlation_length(
        "correlation length along the bitangent", 10.0, when=_ANISOTROPIC
    )
    masking: str = option("on", choices=("on", "off"), doc="shadowing, masking and effective roughness")
    anisotropy: str = option("none", choices=("none", "printed", "corrected"), doc="law of the azimuth")

    quantities: ClassVar[tuple[Derived, ...]] = (
        _slope_ratio("slope_ratio", "correlation_length", _ISOTROPIC),
        _slope_ratio("slope_ratio_x", "correlation_length_x", _ANISOTROPIC),
        _slope_ratio("slope_ratio_y", "correlation_length_y", _ANISOTROPIC),
    )

    def roughness(self, directions: Directions) -> Roughness:
        """Slopes 2 σe/τ and S/(4 cos θi cos θr) at directions."""
        isotropic = self.anisotropy == "none"
        lengths = (self.correlation_length,) if isotropic else (self.correlation_length_x, self.correlation_length_y)
        ratios = [self.height_rms / length for length in lengths]
        cos_i, cos_o = directions.cos_i.clamp(min=_COS_FLOOR), directions.cos_o.clamp(min=_COS_FLOOR)
        if self.masking == "off":
            masking = 0.25 / (cos_i * cos_o)
            effective = torch.ones_like(masking)
        else:
            if isotropic:
                k_i = k_o = (1 / ratios[0]).clamp(*_EXPONENTS)
            else:
                along = (_exponent_along(ratios, share, self.anisotropy) for share in directions.along_tangent)
                k_i, k_o = (k.clamp(*_EXPONENTS) for k in along)
            masking, effective = _masking(cos_i, cos_o, k_i, k_o)
        slopes = [2 * ratio * effective for ratio in ratios]
        return Roughness(slopes[0], slopes[-1], masking, effective)


def _masking(cos_i: Tensor, cos_o: Tensor, k_i: Tensor, k_o: Tensor) -> tuple[Tensor, Tensor]:
    """S/(4 cos θi cos θr) and σe/σ (eq. 6, 8) for k = τ/σ along the azimuths of both directions."""
    # x = k log(1 − cos θ). Both factors 1 − eˣ are formed as −expm1(x); the two signs cancel.
    x_i = k_i * torch.log1p(-cos_i.clamp(max=_COS_CEILING))
    x_o = k_o * torch.log1p(-cos_o.clamp(max=_COS_CEILING))
    masking = 0.25 * (torch.expm1(x_i) * torch.expm1(x_o)) / (cos_i * cos_o)
    rest_i, rest_o = torch.expm1(1.6 * x_i), torch.expm1(1.6 * x_o)
    if k_i is k_o:
        log_effective = 0.1 * k_i * torch.log(rest_i * rest_o)
    else:
        log_effective = 0.1 * (k_i * torch.log(-rest_i) + k_o * torch.log(-rest_o))
    return masking, torch.exp(log_effective.clamp(min=_LOG_LIMIT))


def unmasked_angle(slope_ratio: float) -> float:
    """The angle from the normal in radians up to which S > 0.99 for both directions: within it masking may be off.

    cos θ > 1 − 0.005^(σ/τ), `slope_ratio` σ/τ.

    Raises:
        InputError: a ratio that is not positive.

    Source: Li & Torrance 2005, eq. 7, whose print has the exponent τ/σ.
    """
    if not slope_ratio > 0:
        raise InputError(f"slope_ratio is height_rms / correlation_length and must be positive; got {slope_ratio}.")
    return math.acos(1 - 0.005**slope_ratio)


class Roughness(NamedTuple):
    """Effective roughness at directions.

    Attributes:
        slope_x: 2 σe/τ along the tangent, the slope of the Beckmann distribution.
        slope_y: along the bitangent; the same where the surface is isotropic.
        masking: S/(4 cos θi cos θr).
        effective: σe/σ.
    """

    slope_x: Tensor
    slope_y: Tensor
    masking: Tensor
    effective: Tensor

    def lobe(self, directions: Directions) -> Tensor:
        """S D/(π cos θi cos θr) = S Dn/(4 cos θi cos θr), Dn Beckmann's normalised distribution."""
        if self.isotropic:
            return beckmann(directions, self.slope_x) * self.masking
        return beckmann_anisotropic(directions, self.slope_x, self.slope_y) * self.masking

    @property
    def isotropic(self) -> bool:
        return self.slope_x is self.slope_y


def _exponent_along(ratios: list[Tensor], share_x: Tensor, law: str) -> Tensor:
    """k = τ/σ along an azimuth with cos²φ = `share_x`."""
    if law == "printed":
        return (share_x / ratios[0].square() + (1 - share_x) / ratios[1].square()).sqrt()
    return (share_x * ratios[0].square() + (1 - share_x) * ratios[1].square()).rsqrt()
