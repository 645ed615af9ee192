"""Oren and Nayar's model itself: the integral over Gaussian V-cavities, eq. 5-13."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import torch
from scipy.special import roots_legendre
from torch import Tensor

from matest.brdf import declarations, groove
from matest.brdf.base import Brdf
from matest.brdf.terms import Term, mixture
from matest.directions import Directions
from matest.parameters import option

# Slopes × orientations of grooves, for direct light and for the second bounce, which is smoother and costs more.
_NODES = {"16x16": ((16, 16), (12, 12)), "24x32": ((24, 32), (16, 16)), "48x64": ((48, 64), (24, 32))}
# Exponent that crowds the slope nodes π/2 · u^1.5 near 0, u Gauss-Legendre's: they then resolve a σ of one degree.
_CROWDING = 1.5
# σ below this, in radians, is replaced by it: the weights of the nodes divide by σ.
_SIGMA_FLOOR = 1e-3
# Values that are computed at once: float32 arrays of them (128 kB) fit into the cache of one core.
_TILE = 1 << 15

Groove = Callable[[Tensor, Tensor, Tensor, Tensor], Tensor]


@dataclass(frozen=True, eq=False)
class OrenNayarExact(Brdf):
    """Lambertian V-cavities of every slope and orientation, by numerical integration.

    f = ∫ P(t) (1/2π) ∫ (Lrp¹ + Lrp²)/(E0 cos θi) dψ sin t dt,   P(t) ∝ exp(−t²/(2σ²)) on [0, π/2]

    `albedo` ρ is the albedo of a facet, `sigma` σ (rad) the width of the Gaussian slope-area distribution;
    `interreflection` as in `OrenNayar`. Shapes as `Brdf`.

    The nodes do not depend on σ: their columns depend on geometry alone and their weights on σ alone, and a fit takes
    one pass over the samples. `nodes` = slopes × orientations. Largest and rms deviation from the converged integral
    up to 80° from the normal, σ 1° to 70°, in units of the Lambert radiance: `16x16` 7e-3 and 1e-3, `24x32`
    (default) 3e-3 and 4e-4, `48x64` 4e-4 and 1e-4.

    The functional approximation (eq. 14-16, `OrenNayar`) is 0.03 (rms) to 0.19 (largest, up to 75°) of the Lambert
    radiance away from this integral, eq. 17 (`OrenNayarQualitative`) 0.1 to 0.4: fit and predict with the same model.

    Source: Oren & Nayar 1994, eq. 5-13. Limits: σ → 0 is Lambert; two bounces, so even ρ = 1 reflects less than all
    light (90 % at σ = 30°).
    """

    albedo: Tensor = declarations.albedo()
    sigma: Tensor = declarations.sigma()
    interreflection: Tensor = declarations.interreflection()
    nodes: str = option("24x32", choices=tuple(_NODES), doc="slopes and orientations in the integral")

    name: ClassVar[str] = "oren-nayar-exact"
    source: ClassVar[str] = "Oren & Nayar 1994, eq. 5-13"
    body: ClassVar[bool] = True

    def terms(self, directions: Directions) -> tuple[Term, ...]:
        once, twice = _NODES[self.nodes]
        spread = self.sigma.clamp(min=_SIGMA_FLOOR)
        return (
            mixture(("albedo",), _columns(directions, *once, _direct), _weights(spread, once[0])),
            mixture(
                ("albedo", "albedo", "interreflection"),
                _columns(directions, *twice, groove.interreflection),
                _weights(spread, twice[0]),
            ),
        )


def _direct(_: Tensor, cos_t: Tensor, p: Tensor, q: Tensor) -> Tensor:
    return groove.direct(cos_t, p, q)


def _columns(directions: Directions, slopes: int, orientations: int, bounce: Groove) -> Tensor:
    """Mean over orientations of grooves of every slope node, [..., Q].

    Orientations are counted from the direction halfway between the azimuths of L and V: the rule itself is isotropic.
    """
    d = directions
    cos_half, sin_half = d.half_azimuth
    tan_i, tan_o = groove.tangents(d.cos_i, d.sin_i), groove.tangents(d.cos_o, d.sin_o)
    parts = torch.broadcast_tensors(tan_i * cos_half, tan_i * sin_half, tan_o * cos_half, tan_o * sin_half)
    lead = parts[0].shape[:-1]
    t, _ = _slopes(slopes)
    psi = groove.half_range(orientations)
    like = parts[0]
    tan_t, cos_t = (x.to(like.device, like.dtype)[:, None] for x in (t.tan(), t.cos()))
    sin2_t = t.sin().square().to(like.device, like.dtype)[:, None]
    cos_psi, sin_psi = psi.cos().to(like.device, like.dtype), psi.sin().to(like.device, like.dtype)
    rows = [part.reshape(-1, 1).split(max(_TILE // (slopes * orientations), 1)) for part in parts]
    columns = []
    for i_cos, i_sin, o_cos, o_sin in zip(*rows, strict=True):
        # L stands half the difference of azimuths on one side of ψ = 0, V on the other.
        p = 0.5 + (0.5 * tan_t) * (i_cos * cos_psi + i_sin * sin_psi)[:, None]
        q = 0.5 + (0.5 * tan_t) * (o_cos * cos_psi - o_sin * sin_psi)[:, None]
        columns.append(bounce(sin2_t, cos_t, p, q).mean(-1))
    return torch.cat(columns).reshape(*lead, slopes)


def _weights(sigma: Tensor, slopes: int) -> Tensor:
    """P(t) sin t dt / π at every slope node, normalised on the nodes: [..., Q] for σ [...]."""
    t, log_measure = (x.to(sigma.device, sigma.dtype) for x in _slopes(slopes))
    # As a softmax: a lobe of any width is normalised without underflow.
    return torch.softmax(log_measure - 0.5 * (t / sigma[..., None]).square(), dim=-1) / math.pi


def _slopes(count: int) -> tuple[Tensor, Tensor]:
    """Slope nodes t [Q] in radians, and log(sin t dt) at each."""
    x, w = (torch.from_numpy(array) for array in _legendre(count))
    u = (x + 1) / 2
    t = math.pi / 2 * u**_CROWDING
    return t, (t.sin() * w * u ** (_CROWDING - 1)).log()


# Cache arrays, not tensors: a tensor from inference mode cannot take part in a later differentiation.
_legendre = lru_cache(maxsize=8)(roots_legendre)
