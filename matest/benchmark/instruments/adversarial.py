"""Directions and parameter values that crowd toward every boundary of the domain, mixed with ordinary ones."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from matest.parameters import Parameter

# Cosines and distances to an end of a domain go down to 1e-30, sines and differences of directions to 1e-20.
_SMALLEST, _CLOSEST = 30.0, 20.0
# Upper end of parameters that have none.
_LARGEST = 10.0


def direction_pairs(n: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """`n` pairs of unit vectors [n, 3] in float64.

    Toward grazing (and at it, and just below), toward the normal (and at it), light and viewer equal, mirrored or
    opposite (exactly and nearly), azimuths 0, π/2 and π apart (exactly and nearly); the rest anywhere.
    """
    sin_i, cos_i = _polar(n, generator)
    sin_o, cos_o = _polar(n, generator)
    azimuth = _azimuth(n, generator)
    wi = _vector(sin_i, cos_i, azimuth)
    mirror = wi * torch.tensor([-1.0, -1.0, 1.0], dtype=torch.float64)
    grazing_i, grazing_o = _cosine_near_zero(n, generator), _cosine_near_zero(n, generator)
    lights = torch.stack([wi, wi, wi, wi, wi, _vector(_other(grazing_i), grazing_i, azimuth)])
    views = torch.stack(
        [
            _vector(sin_o, cos_o, _turned(azimuth, generator)),
            wi,
            _beside(wi, generator),
            mirror,
            _beside(mirror, generator),
            _vector(_other(grazing_o), grazing_o, -azimuth),
        ]
    )
    kind = _kind([5, 1, 1, 1, 1, 1], n, generator)
    return _pick(lights, kind), _pick(views, kind)


def parameter_values(declared: dict[str, Parameter], n: int, generator: torch.Generator) -> dict[str, Tensor]:
    """Values [n, 1] in float64 of every parameter: both ends of its domain, close to them, and anywhere between."""
    values = {}
    for name, parameter in declared.items():
        lower, upper = parameter.domain.lower, min(parameter.domain.upper, _LARGEST)
        width = upper - lower
        drawn = torch.stack(
            [
                lower + width * _uniform(n, generator),
                lower + width * _small(n, _SMALLEST, generator),
                upper - width * _small(n, _SMALLEST, generator),
                torch.full((n,), lower, dtype=torch.float64),
                torch.full((n,), upper, dtype=torch.float64),
            ]
        )
        values[name] = _pick(drawn[..., None], _kind([4, 3, 3, 1, 1], n, generator))
    return values


def _polar(n: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """Sine and cosine of polar angles, each accurate where it is small."""
    theta = 0.5 * math.pi * _uniform(n, generator)
    sine, cosine = _small(n, _CLOSEST, generator), _cosine_near_zero(n, generator)
    zero = torch.zeros(n, dtype=torch.float64)
    sines = torch.stack([theta.sin(), _other(cosine), sine, zero])
    cosines = torch.stack([theta.cos(), cosine, _other(sine), zero + 1])
    kind = _kind([4, 4, 3, 1], n, generator)
    return _pick(sines[..., None], kind)[:, 0], _pick(cosines[..., None], kind)[:, 0]


def _cosine_near_zero(n: int, generator: torch.Generator) -> Tensor:
    """Cosines from 1 to 1e-30, exactly 0, and negative ones."""
    small = _small(n, _SMALLEST, generator)
    return small * _kind([1, 1, 6], n, generator).sub(1)


def _azimuth(n: int, generator: torch.Generator) -> Tensor:
    """Unit vectors [n, 2] in the tangent plane, half of them along an axis."""
    phi = 2 * math.pi * _uniform(n, generator)
    axes = torch.tensor([[1, 0], [0, 1], [-1, 0], [0, -1]], dtype=torch.float64)
    along = axes[torch.randint(4, (n,), generator=generator)]
    return _pick(torch.stack([_unit(phi), along]), _kind([1, 1], n, generator))


def _turned(azimuth: Tensor, generator: torch.Generator) -> Tensor:
    """`azimuth` turned by 0, π/2 or π, exactly or nearly, or by any angle."""
    n = len(azimuth)
    quarters = torch.stack([azimuth, _rotated(azimuth), -azimuth])
    base = _pick(quarters, _kind([1, 1, 1], n, generator))
    nearly = _small(n, _CLOSEST, generator) * _kind([1, 1], n, generator).mul(2).sub(1)
    angle = torch.stack([2 * math.pi * _uniform(n, generator), nearly, torch.zeros_like(nearly)])
    turn = _unit(_pick(angle[..., None], _kind([1, 1, 1], n, generator))[:, 0])
    return turn[:, :1] * base + turn[:, 1:] * _rotated(base)


def _beside(vector: Tensor, generator: torch.Generator) -> Tensor:
    """Unit vectors close to `vector`, on the same side of the horizon."""
    size = _small(len(vector), _CLOSEST, generator)[:, None]
    shift = size * torch.randn(vector.shape, generator=generator, dtype=torch.float64)
    moved = torch.cat([vector[:, :2] + shift[:, :2], vector[:, 2:] * shift[:, 2:].exp()], dim=-1)
    return torch.nn.functional.normalize(moved, dim=-1)


def _small(n: int, decades: float, generator: torch.Generator) -> Tensor:
    """Log-uniform from 1 down by so many decades."""
    return 10.0 ** (-decades * _uniform(n, generator))


def _uniform(n: int, generator: torch.Generator) -> Tensor:
    return torch.rand(n, generator=generator, dtype=torch.float64)


def _kind(weights: list[float], n: int, generator: torch.Generator) -> Tensor:
    """Indices drawn in proportion to `weights`."""
    return torch.multinomial(torch.tensor(weights, dtype=torch.float64), n, replacement=True, generator=generator)


def _pick(candidates: Tensor, kind: Tensor) -> Tensor:
    """Of `candidates` [k, n, m] the one that `kind` [n] says: [n, m]."""
    return candidates[kind, torch.arange(len(kind))]


def _other(part: Tensor) -> Tensor:
    """Sine for a cosine, cosine for a sine."""
    return ((1 - part) * (1 + part)).sqrt()


def _unit(angle: Tensor) -> Tensor:
    return torch.stack([angle.cos(), angle.sin()], dim=-1)


def _rotated(vector: Tensor) -> Tensor:
    return torch.stack([-vector[:, 1], vector[:, 0]], dim=-1)


def _vector(sine: Tensor, cosine: Tensor, azimuth: Tensor) -> Tensor:
    return torch.cat([sine[:, None] * azimuth, cosine[:, None]], dim=-1)
