"""One V-shaped groove: direct light, shadowing, masking and the second bounce between its two facets.

Facets are tilted by t toward the azimuths ψ and ψ + π. With the tangents x_i = tan θi cos(ψ − φi), x_o likewise for the
viewer, everything follows from P = ½(1 + tan t · x_i) and Q = ½(1 + tan t · x_o): ⟨s,a⟩ = 2 cos θi cos t · P, and the
opposite facet has 1 − P, 1 − Q. A facet is shadowed (masked) in part where its P (Q) exceeds 1.

Source: Oren & Nayar 1994, eq. 4-11.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

# Smallest squared distance: at ms = mv = 0 its square root would have no derivative.
_SQUARED_FLOOR = 1e-30


def direct(cos_t: Tensor, p: Tensor, q: Tensor) -> Tensor:
    """Mean over both facets of f / (ρ/π) for light that is reflected once.

    min(PQ, P, Q) · 4 cos t is eq. 6 with its geometric attenuation factor. Shadow and mask both start at the bottom of
    the groove, so only the larger one counts (the print is ambiguous; a ray-traced groove confirms this).
    """
    facet = _attenuated(p.clamp(min=0), q.clamp(min=0))
    opposite = _attenuated((1 - p).clamp(min=0), (1 - q).clamp(min=0))
    return 2 * cos_t * (facet + opposite)


def interreflection(sin2_t: Tensor, cos_t: Tensor, p: Tensor, q: Tensor) -> Tensor:
    """Mean over both facets of f / (ρ²/π) for light that reaches the viewer from one facet by way of the other.

    Eq. 11 is the mixed difference d(1,mv) + d(1,ms) − d(ms,mv) − d(1,1) of d(x,y)² = x² + 2xy cos 2t + y², with the
    shadowed and masked widths ms, mv from the bottom as fractions of the facet. It is (1 − ms)(1 − mv) · 2 sin² t · κ.
    The code computes κ without these factors, so that it keeps its digits in flat grooves and near grazing. Where a
    facet is shadowed or masked only one facet contributes, and elsewhere both have the same κ: it is computed once.

    `sin2_t` is sin² t.
    """
    ms = 1 - 1 / torch.maximum(p, 1 - p).clamp(min=1)
    mv = 1 - 1 / torch.maximum(q, 1 - q).clamp(min=1)
    e = 2 * sin2_t
    # d(x,y)² = (x − y)² + 4xy cos² t: nothing cancels, however steep the groove.
    four = 4 * cos_t * cos_t
    d_sv = ((ms - mv).square() + four * (ms * mv)).clamp(min=_SQUARED_FLOOR).sqrt()
    d_1v = ((1 - mv).square() + four * mv).sqrt()
    d_1s = ((1 - ms).square() + four * ms).sqrt()
    d_11 = 2 * cos_t
    # (x + y − d) / (2e)
    short_sv = ms * mv / (ms + mv + d_sv)
    short_1v = mv / (1 + mv + d_1v)
    short_1s = ms / (1 + ms + d_1s)
    short_11 = 1 / (2 + d_11)
    tau = (short_1v + short_sv - mv) / (d_1v + d_sv) + (short_1s + (short_11 - 1)) / (d_1s + d_11)
    side = d_1v + d_11
    kappa = 2 * (2 * (short_1v + (short_11 - 1)) + side + (mv + (3 - 2 * e)) * tau) / (side * (d_sv + d_1s))
    lit, seen = p.clamp(0, 1), q.clamp(0, 1)
    return (2 * sin2_t * cos_t) * (lit + seen - 2 * lit * seen) * kappa


def _attenuated(p: Tensor, q: Tensor) -> Tensor:
    """min(pq, p, q), without a product of two huge numbers."""
    return torch.minimum(p.clamp(max=1) * q, p)


def tangents(cos: Tensor, along: Tensor) -> Tensor:
    """x = tan θ cos(ψ − φ) from the cosine and the tangential component along ψ; bounded at grazing."""
    return along / cos.clamp(min=1e-6)


def half_range(azimuths: int) -> Tensor:
    """Midpoints of `azimuths` equal parts of [0, π): grooves of every orientation, in float64."""
    return (torch.arange(azimuths, dtype=torch.float64) + 0.5) * (math.pi / azimuths)
