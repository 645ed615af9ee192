"""He and Torrance's wave-optical model, unpolarised: a reference."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor

from matest.brdf import declarations
from matest.brdf.base import Brdf
from matest.brdf.li_torrance import mirror_kernel, surface_terms
from matest.brdf.terms import Term, lambertian
from matest.directions import Directions
from matest.parameters import option

# Terms of the series in the sum: all that matter for g up to about 50, evenly spaced ones for larger g.
_TERMS = 256
# Pairs of directions evaluated at once: an array of them and their terms then takes 0.5 MB.
_TILE = 256
# Cosines below this are replaced by it: the quotients by cosines stay finite.
_COS_FLOOR = 1e-4
# τ cot θ/(2σ0) above this is replaced by it: erfc and exp(−q²) underflow in double precision beyond about 26.
_COT_LIMIT = 26.0


@dataclass(frozen=True, eq=False)
class HeTorrance(Brdf):
    """Kirchhoff scattering by a surface of Gaussian heights, and an even diffuse part.

    f = k_dd F S G D/(π cos θi cos θr) + k_ud/π,   G = ((L+V)²/(cos θi + cos θr))²
    D = (π²τ²/4λ²) Σ g^m e^(−g)/(m! m) exp(−vxy² τ²/(4m)),   vxy = (2π/λ)|(L+V)xy|,   g = ((2π σ/λ)(cos θi + cos θr))²

    `height_rms` σ0, `correlation_length` τ, `wavelength` λ in µm; S and the effective σ are Smith's exact functions.
    F is Schlick's with `f0`, as in `LiTorrance`, so the two models differ in the surface alone. With `coherent=on` the
    mirror-like part k_dd F S e^(−g) from a source of `solid_angle` (sr), as in `Coherent`. Shapes as `Brdf`.

    The series is summed in double precision over the 256 terms around its largest; where more terms matter they are
    smooth, and evenly spaced ones represent all. A thousand times the cost of `LiTorrance`: for comparison, not for
    rendering.

    Source: He, Torrance, Sillion & Greenberg 1991, with the e^(−q²) that the print leaves out of S. Limits: for g ≫ 1
    D is Li and Torrance's; coherent and diffuse light together are 1 at normal incidence and F = 1.
    """

    k_dd: Tensor = declarations.amplitude("scale of the directional light")
    k_ud: Tensor = declarations.amplitude("reflectance by even scattering", 0.2)
    f0: Tensor = declarations.f0()
    height_rms: Tensor = declarations.height_rms("rms height σ0", 0.5)
    correlation_length: Tensor = declarations.correlation_length()
    wavelength: Tensor = declarations.wavelength()
    solid_angle: Tensor = declarations.solid_angle(when={"coherent": ("on",)})
    coherent: str = option("off", choices=("off", "on"), doc="mirror-like reflection")

    name: ClassVar[str] = "he-torrance"
    source: ClassVar[str] = "He, Torrance, Sillion & Greenberg 1991"
    body: ClassVar[bool] = True

    def terms(self, directions: Directions) -> tuple[Term, ...]:
        d = directions
        dtype = d.cos_i.dtype
        height, length, wavelength = (
            value.double() for value in (self.height_rms, self.correlation_length, self.wavelength)
        )
        cos_i, cos_o = (cos.double().clamp(min=_COS_FLOOR) for cos in (d.cos_i, d.cos_o))
        cot_i, cot_o = cos_i / d.sin_i.double(), cos_o / d.sin_o.double()
        half_inverse = length / (2 * height)
        effective = height * effective_roughness(half_inverse, cot_i, cot_o)
        total = cos_i + cos_o
        g = (2 * math.pi * effective / wavelength * total).square()
        across2 = d.tan2_half.double() * d.half_z.double().square() * (math.pi * length / wavelength).square()
        shape = (math.pi * length / (2 * wavelength)).square() * series(g, across2)
        geometry = (d.half_squared.double() / total).square()
        masking = smith_masking(half_inverse * cot_i) * smith_masking(half_inverse * cot_o)
        lobe = (geometry * masking * shape / (math.pi * cos_i * cos_o)).to(dtype)
        if self.coherent == "on":
            mirror = masking * torch.exp(-g) * 2 / total
            lobe = lobe + mirror.to(dtype) * mirror_kernel(d, self.solid_angle)
        return lambertian(("k_ud",), d.cos_i * d.cos_o), *surface_terms(lobe, d)


def series(g: Tensor, across2: Tensor) -> Tensor:
    """Σ over m ≥ 1 of g^m e^(−g)/(m! m) exp(−b/m) for g and b = `across2` of any shape, double precision."""
    g, b = torch.broadcast_tensors(g.clamp(min=1e-12), across2)
    parts = [_series(*rows) for rows in zip(g.reshape(-1, 1).split(_TILE), b.reshape(-1, 1).split(_TILE), strict=True)]
    return torch.cat(parts).reshape(g.shape)


def _series(g: Tensor, b: Tensor) -> Tensor:
    # The term is largest at log(g/m) + b/m² = 0; the others fall off like a Gaussian of variance m or g.
    with torch.no_grad():
        peak = g * torch.exp(0.5 * lambert_w(2 * b / g.square()))
        lowest = (g - 12 * g.sqrt() - 20).floor().clamp(min=1)
        highest = peak + 12 * peak.sqrt() + 60
        step = ((highest - lowest) / (_TERMS - 1)).clamp(min=1)
    m = lowest + step * torch.arange(_TERMS, dtype=g.dtype, device=g.device)
    # log m! + log m = log Γ(m+1) + log m
    exponent = m * g.log() - g - torch.lgamma(m + 1) - m.log() - b / m
    return (torch.exp(exponent) * step).sum(-1)


def lambert_w(x: Tensor) -> Tensor:
    """Lambert's W with W e^W = x for x ≥ 0, by five steps of Halley's iteration."""
    w = torch.log1p(x) * (1 - torch.log1p(torch.log1p(x)) / (2 + torch.log1p(x)))
    for _ in range(5):
        exp = torch.exp(w)
        excess = w * exp - x
        w = w - excess / (exp * (w + 1) - 0.5 * (w + 2) * excess / (w + 1))
    return w


def effective_roughness(half_inverse: Tensor, cot_i: Tensor, cot_o: Tensor) -> Tensor:
    """σ/σ0 of the part of a surface that is both lit and seen: (1 + (z0/σ0)²)^(−½).

    (z0/σ0) exp(½(z0/σ0)²) = (Ki + Kr)/√(8π), K = tan θ erfc(τ cot θ/(2σ0))

    `half_inverse` τ/(2σ0), cotangents positive, any shape. Source: He et al. 1991, solved by Lambert's W.
    """
    hidden = sum(torch.erfc((half_inverse * cot).clamp(max=_COT_LIMIT)) / cot for cot in (cot_i, cot_o))
    return (1 + lambert_w(torch.as_tensor(hidden).square() / (8 * math.pi))).rsqrt()


def smith_masking(q: Tensor) -> Tensor:
    """Smith's S1 = (1 − ½ erfc q)/(Λ + 1), Λ = ½ (e^(−q²)/(√π q) − erfc q), of one direction; q = τ cot θ/(2σ0) > 0.

    Source: Smith 1967 in the form of He et al. 1991, with the e^(−q²) that their print leaves out.
    """
    q = q.clamp(max=_COT_LIMIT)
    hidden = 0.5 * torch.exp(-q * q) * (1 / (math.sqrt(math.pi) * q) - torch.special.erfcx(q))
    return (1 - 0.5 * torch.erfc(q)) / (hidden + 1)
