"""Directions and parameter values that crowd toward every boundary of the domain, and what float32 loses there."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from matest.brdf import Brdf
from matest.parameters import Parameter

# Decades below 1 that cosines, and distances to an end of a domain, go down to.
_SMALLEST = 30.0
# Decades below 1 that sines, and differences of directions, go down to.
_CLOSEST = 20.0
# Upper end of parameters that have none.
_LARGEST = 10.0
# Allowed error of float32: relative, or as a fraction of the model's peak at the same parameters.
RELATIVE = 1e-4
OF_PEAK = 1e-6
# cos 89.9°: closer to grazing float32 is not held to this.
NEARLY_GRAZING = 1.75e-3
# Sets of parameter values at a time, and directions for each.
DRAWS = 8
DIRECTIONS = 1024
# JSON has no infinity: the error where float32 is not finite.
NOT_FINITE = 1e30


def direction_pairs(n: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """`n` pairs of unit vectors [n, 3] in float64.

    Toward grazing (and at it, and just below), toward the normal (and at it), light and viewer equal, mirrored or
    opposite (exactly and nearly), azimuths 0, π/2 and π apart (exactly and nearly); the rest anywhere.
    """
    polar_i, polar_o = _polar(n, generator), _polar(n, generator)
    azimuth = _azimuth(n, generator)
    wi = _vector(polar_i, azimuth)
    mirror = wi * torch.tensor([-1.0, -1.0, 1.0], dtype=torch.float64)
    grazing_i, grazing_o = _cosine_near_zero(n, generator), _cosine_near_zero(n, generator)
    light = _vector(torch.stack([_other(grazing_i), grazing_i], dim=-1), azimuth)
    pairs = [
        (5, wi, _vector(polar_o, _turned(azimuth, generator))),
        (1, wi, wi),
        (1, wi, _beside(wi, generator)),
        (1, wi, mirror),
        (1, wi, _beside(mirror, generator)),
        (1, light, _vector(torch.stack([_other(grazing_o), grazing_o], dim=-1), -azimuth)),
    ]
    both = _mixed([(weight, torch.cat([light, view], dim=-1)) for weight, light, view in pairs], generator)
    return both[:, :3], both[:, 3:]


def parameter_values(declared: dict[str, Parameter], n: int, generator: torch.Generator) -> dict[str, Tensor]:
    """Values [n, 1] in float64 of every parameter: both ends of its domain, close to them, and anywhere between."""
    values = {}
    for name, parameter in declared.items():
        lower, upper = parameter.domain.lower, min(parameter.domain.upper, _LARGEST)
        width = upper - lower
        drawn = [
            (4, lower + width * _uniform(n, generator)),
            (3, lower + width * _small(n, _SMALLEST, generator)),
            (3, upper - width * _small(n, _SMALLEST, generator)),
            (1, torch.full((n,), lower, dtype=torch.float64)),
            (1, torch.full((n,), upper, dtype=torch.float64)),
        ]
        values[name] = _mixed(drawn, generator)[:, None]
    return values


def worst_error(brdf: Brdf, draws: int, generator: torch.Generator) -> tuple[float, str]:
    """The largest error of float32 as a multiple of the one allowed, and where it is.

    Over `draws` sets of parameter values (rounded up to a multiple of 8), each at 1024 directions of its own.
    """
    worst, where = 0.0, ""
    for _ in range(-(-draws // DRAWS)):
        shape = (DRAWS, DIRECTIONS, 3)
        wi, wo = (vector.reshape(shape).float() for vector in direction_pairs(DRAWS * DIRECTIONS, generator))
        values = parameter_values(brdf.declared, DRAWS, generator)
        single = brdf.replace({name: value[:, None].float() for name, value in values.items()})
        # The conversion to the precision of the directions is the model's own.
        with torch.no_grad():
            exact = single(wi.double(), wo.double())
            peak = single(*(vector.double() for vector in _landmarks())).amax(dim=1, keepdim=True)
            error = (single(wi, wo).double() - exact).abs().nan_to_num(nan=NOT_FINITE, posinf=NOT_FINITE)
        # Below the smallest normal number float32 has no digits to compare.
        smallest = torch.tensor(torch.finfo(torch.float32).tiny, dtype=torch.float64)
        allowed = torch.maximum(RELATIVE * exact, OF_PEAK * peak).maximum(smallest)
        clear = (wi[..., 2:] > NEARLY_GRAZING) & (wo[..., 2:] > NEARLY_GRAZING)
        excess = torch.where(clear, error / allowed, 0.0)[..., 0]
        largest = excess.max().item()
        if largest > worst:
            draw, pair = divmod(int(excess.argmax()), DIRECTIONS)
            inputs = {name: value[draw] for name, value in single.parameters.items()}
            worst = min(largest, NOT_FINITE)
            where = place({**inputs, "wi": wi[draw, pair][None], "wo": wo[draw, pair][None]}, 0)
    return worst, where


def place(inputs: dict[str, Tensor], index: int) -> str:
    """Parameter values and directions of one point, with all their digits."""
    point = {name: value[index].tolist() for name, value in inputs.items()}
    return ", ".join(f"{name} = {x[0] if len(x) == 1 else x}" for name, x in point.items())


def _polar(n: int, generator: torch.Generator) -> Tensor:
    """Sine and cosine [n, 2] of polar angles, each accurate where it is small."""
    theta = 0.5 * math.pi * _uniform(n, generator)
    sine, cosine = _small(n, _CLOSEST, generator), _cosine_near_zero(n, generator)
    zero = torch.zeros(n, dtype=torch.float64)
    angles = [
        (4, theta.sin(), theta.cos()),
        (4, _other(cosine), cosine),
        (3, sine, _other(sine)),
        (1, zero, zero + 1),
    ]
    return _mixed([(weight, torch.stack([sin, cos], dim=-1)) for weight, sin, cos in angles], generator)


def _cosine_near_zero(n: int, generator: torch.Generator) -> Tensor:
    """Cosines from 1 to 1e-30, exactly 0, and negative ones."""
    return _small(n, _SMALLEST, generator) * _kind([1, 1, 6], n, generator).sub(1)


def _azimuth(n: int, generator: torch.Generator) -> Tensor:
    """Unit vectors [n, 2] in the tangent plane, half of them along an axis."""
    phi = 2 * math.pi * _uniform(n, generator)
    axes = torch.tensor([[1, 0], [0, 1], [-1, 0], [0, -1]], dtype=torch.float64)
    along = axes[torch.randint(4, (n,), generator=generator)]
    return _mixed([(1, _unit(phi)), (1, along)], generator)


def _turned(azimuth: Tensor, generator: torch.Generator) -> Tensor:
    """`azimuth` turned by 0, π/2 or π, exactly or nearly, or by any angle."""
    n = len(azimuth)
    base = _mixed([(1, azimuth), (1, _rotated(azimuth)), (1, -azimuth)], generator)
    nearly = _small(n, _CLOSEST, generator) * _kind([1, 1], n, generator).mul(2).sub(1)
    any_angle = 2 * math.pi * _uniform(n, generator)
    turn = _unit(_mixed([(1, any_angle), (1, nearly), (1, torch.zeros_like(nearly))], generator))
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


def _mixed(candidates: Sequence[tuple[float, Tensor]], generator: torch.Generator) -> Tensor:
    """Rows of tensors [n, …], each row drawn from one of them in proportion to its weight."""
    weights, tensors = zip(*candidates, strict=True)
    n = len(tensors[0])
    return torch.stack(tensors)[_kind(list(weights), n, generator), torch.arange(n)]


def _other(part: Tensor) -> Tensor:
    """Sine for a cosine, cosine for a sine."""
    return ((1 - part) * (1 + part)).sqrt()


def _unit(angle: Tensor) -> Tensor:
    return torch.stack([angle.cos(), angle.sin()], dim=-1)


def _rotated(vector: Tensor) -> Tensor:
    return torch.stack([-vector[:, 1], vector[:, 0]], dim=-1)


def _vector(polar: Tensor, azimuth: Tensor) -> Tensor:
    """Directions [n, 3] from sine and cosine of the polar angle and the azimuth."""
    return torch.cat([polar[:, :1] * azimuth, polar[:, 1:]], dim=-1)


def _landmarks() -> tuple[Tensor, Tensor]:
    """Pairs of directions [32, 3] among which models have their peak: mirror, retro, and across the plane."""
    degrees = [0, 15, 30, 45, 60, 75, 80, 89]
    theta = torch.tensor([math.radians(angle) for angle in degrees], dtype=torch.float64)
    zero = torch.zeros_like(theta)
    light = torch.stack([theta.sin(), zero, theta.cos()], dim=-1)
    mirror = torch.stack([-theta.sin(), zero, theta.cos()], dim=-1)
    across = torch.stack([zero, theta.sin(), theta.cos()], dim=-1)
    normal = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64).expand_as(light)
    return light.repeat(4, 1), torch.cat([mirror, light, across, normal])
