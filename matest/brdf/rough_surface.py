"""What Li and Torrance's components share: a rough surface with Gaussian heights and Gaussian autocorrelation."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from matest.brdf.base import Brdf
from matest.brdf.microfacet import beckmann_anisotropic
from matest.directions import Directions
from matest.parameters import interval, option, parameter, unit_interval

_LENGTH = interval(1, 100)
_ISOTROPIC, _ANISOTROPIC = {"anisotropy": ("none",)}, {"anisotropy": ("printed", "corrected")}
# Cosines below this count as this; 1 − cos θ is kept above the second: its logarithm meets an exponent.
_COS_FLOOR, _REST_FLOOR = 1e-4, 1e-12
# Exponents τ/σ are kept here: smoother surfaces have no masking, and none is this jagged.
_EXPONENTS = (0.1, 1e3)


@dataclass(frozen=True, eq=False)
class RoughSurface(Brdf):
    """Parameters of a rough surface: reflectance at normal incidence and the two lengths of its roughness.

    `f0`; `height_rms` σ and `correlation_length` τ in µm: only their ratio has an effect, except on coherent light.
    `masking=off` takes S = 1 and σe = σ (smooth surfaces, guideline C). With `anisotropy` τ differs along tangent and
    bitangent (`correlation_length_x`, `_y`), and the azimuthal law of S is that of eq. 25 as `printed`, or `corrected`
    to the slope along the azimuth.
    """

    f0: Tensor = parameter(
        unit_interval, unit="1", doc="reflectance at normal incidence", default=0.04, held=0.04, log=True
    )
    height_rms: Tensor = parameter(interval(0.01, 2), unit="µm", doc="rms height σ", default=1.0, held=1.0, log=True)
    correlation_length: Tensor = parameter(
        _LENGTH, unit="µm", doc="correlation length τ", default=5.0, log=True, when=_ISOTROPIC
    )
    correlation_length_x: Tensor = parameter(
        _LENGTH, unit="µm", doc="correlation length along the tangent", default=5.0, log=True, when=_ANISOTROPIC
    )
    correlation_length_y: Tensor = parameter(
        _LENGTH, unit="µm", doc="correlation length along the bitangent", default=10.0, log=True, when=_ANISOTROPIC
    )
    masking: str = option("on", choices=("on", "off"), doc="shadowing, masking and effective roughness")
    anisotropy: str = option("none", choices=("none", "printed", "corrected"), doc="law of the azimuth")

    def roughness(self, directions: Directions) -> Roughness:
        """Slopes 2 σe/τ and S/(4 cos θi cos θr) at directions."""
        lengths = [self.correlation_length] * 2
        if self.anisotropy != "none":
            lengths = [self.correlation_length_x, self.correlation_length_y]
        ratios = [self.height_rms / length for length in lengths]
        cos_i, cos_o = directions.cos_i.clamp(min=_COS_FLOOR), directions.cos_o.clamp(min=_COS_FLOOR)
        if self.masking == "off":
            product = cos_i * cos_o
            return Roughness(2 * ratios[0], 2 * ratios[1], 0.25 / product, torch.ones_like(product))
        if self.anisotropy == "none":
            k_i = k_o = 1 / ratios[0]
        else:
            k_i, k_o = (_along(ratios, share, self.anisotropy) for share in directions.along_tangent)
        k_i, k_o = k_i.clamp(*_EXPONENTS), k_o.clamp(*_EXPONENTS)
        log_i, log_o = _log_rest(cos_i), _log_rest(cos_o)
        masked = 0.25 * (-torch.expm1(k_i * log_i) / cos_i) * (-torch.expm1(k_o * log_o) / cos_o)
        shrunk = 0.1 * (k_i * _log_unmasked(1.6 * k_i * log_i) + k_o * _log_unmasked(1.6 * k_o * log_o))
        effective = torch.exp(shrunk.clamp(min=_LOG_LIMIT))
        return Roughness(2 * ratios[0] * effective, 2 * ratios[1] * effective, masked, effective)


_LOG_LIMIT = math.log(1e-4)


class Roughness(NamedTuple):
    """Effective roughness at directions.

    Attributes:
        slope_x: 2 σe/τ along the tangent, the slope of the Beckmann distribution.
        slope_y: along the bitangent; the same where the surface is isotropic.
        masked: S/(4 cos θi cos θr).
        effective: σe/σ.
    """

    slope_x: Tensor
    slope_y: Tensor
    masked: Tensor
    effective: Tensor

    def lobe(self, directions: Directions) -> Tensor:
        """S D/(π cos θi cos θr) = S Dn/(4 cos θi cos θr), Dn Beckmann's normalised distribution."""
        return beckmann_anisotropic(directions, self.slope_x, self.slope_y) * self.masked


def _along(ratios: list[Tensor], share_x: Tensor, law: str) -> Tensor:
    """k = τ/σ along an azimuth with cos²φ = `share_x`."""
    if law == "printed":
        return (share_x / ratios[0].square() + (1 - share_x) / ratios[1].square()).sqrt()
    return (share_x * ratios[0].square() + (1 - share_x) * ratios[1].square()).rsqrt()


def _log_rest(cos: Tensor) -> Tensor:
    """log(1 − cos θ), accurate at grazing and bounded at normal incidence."""
    grazing = torch.log1p(-cos.clamp(max=0.5))
    return torch.where(cos < 0.5, grazing, (1 - cos).clamp(min=_REST_FLOOR).log())


def _log_unmasked(exponent: Tensor) -> Tensor:
    """log(1 − e^x) for x ≤ 0, bounded where x vanishes."""
    return torch.log(-torch.expm1(exponent.clamp(max=-1e-6)))
