"""float32 against float64, on the same float32 directions and parameters."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from matest.benchmark.instruments.adversarial import direction_pairs, parameter_values
from matest.brdf import Brdf

# Allowed error: relative, or as a fraction of the model's peak at the same parameters.
RELATIVE, OF_PEAK = 1e-4, 1e-6
# cos 89.9°: closer to grazing float32 is not held to this.
NEARLY_GRAZING = 1.75e-3
# Directions for each draw of the parameters, and draws at a time.
DIRECTIONS, DRAWS = 1024, 8
# JSON has no infinity: the error where float32 is not finite.
NOT_FINITE = 1e30


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
