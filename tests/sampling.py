"""Directions, parameter values and integrals over the hemisphere that the tests share."""

from __future__ import annotations

import math
from functools import cache

import torch
from scipy.special import roots_legendre
from torch import Tensor

from matest.brdf import Brdf, model
from matest.parameters import Parameter

# Below this a lobe is narrower than anything photographed.
REALISTIC_FLOOR = 0.02


def spherical(theta: Tensor | float, phi: Tensor | float = 0.0) -> Tensor:
    """Unit vectors [..., 3] in float64 from polar angle and azimuth in radians."""
    theta, phi = torch.broadcast_tensors(
        torch.as_tensor(theta, dtype=torch.float64), torch.as_tensor(phi, dtype=torch.float64)
    )
    return torch.stack([theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()], dim=-1)


def degrees(theta: float, phi: float = 0.0) -> Tensor:
    return spherical(math.radians(theta), math.radians(phi))


# The directions of the reference values: one light, a view on the far side and one on the near side of the normal.
LIGHT, FORWARD, BACKWARD = degrees(50, 20), degrees(65, 170), degrees(65, 60)


def random_angles(n: int, seed: int, most: float = 1.55) -> Tensor:
    """[n, 4]: θi, φi, θr, φr in radians, θ up to `most`."""
    uniform = torch.rand(n, 4, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    return uniform * torch.tensor([most, 2 * math.pi, most, 2 * math.pi], dtype=torch.float64)


def random_pairs(n: int, seed: int, most: float = 1.55) -> tuple[Tensor, Tensor]:
    """`n` pairs [n, 3], every second one near the mirror direction, where lobes live."""
    angles = random_angles(n, seed, most)
    near = angles[1::2]
    spread = near[:, 2:] / torch.tensor([most, 2 * math.pi], dtype=torch.float64) - 0.5
    near[:, 2] = (near[:, 0] + 0.3 * spread[:, 0]).clamp(1e-3, most)
    near[:, 3] = near[:, 1] + math.pi + 0.3 * spread[:, 1]
    return spherical(angles[:, 0], angles[:, 1]), spherical(angles[:, 2], angles[:, 3])


def closed_domain_pairs(dtype: torch.dtype) -> tuple[Tensor, Tensor]:
    """All pairs of directions from the normal to grazing and just below, at azimuths from equal to opposite."""
    cos = torch.tensor([-1.0, -1e-9, 0.0, 1e-30, 1e-12, 1e-7, 1e-3, 0.5, 1 - 1e-7, 1.0], dtype=torch.float64)
    azimuth = torch.tensor([0.0, 1.0, math.pi / 2, 3.0, math.pi], dtype=torch.float64)
    cos_i, cos_o, phi = (t.reshape(-1) for t in torch.meshgrid(cos, cos, azimuth, indexing="ij"))
    sin_i, sin_o = (1 - cos_i.square()).sqrt(), (1 - cos_o.square()).sqrt()
    # sin π is not zero in floating point: exactly opposite directions are made exact.
    cos_phi, sin_phi = phi.cos(), torch.where(phi == math.pi, 0.0, phi.sin())
    wi = torch.stack([sin_i, torch.zeros_like(sin_i), cos_i], dim=-1)
    return wi.to(dtype), torch.stack([sin_o * cos_phi, sin_o * sin_phi, cos_o], dim=-1).to(dtype)


def named(expression: str) -> Brdf:
    return model(expression)[0]


def linear(brdf: Brdf) -> list[str]:
    """Amplitudes that the model is jointly linear in: none is squared or multiplied by another of them."""
    chosen: list[str] = []
    for name in brdf.declared:
        products = [[factor.name for factor in factors] for factors in brdf.structure.products]
        with_it = [factors for factors in products if name in factors]
        alone = all(factors.count(name) == 1 and not {*chosen} & {*factors} for factors in with_it)
        if with_it and alone:
            chosen.append(name)
    return chosen


def realistic(declared: Parameter) -> tuple[float, float]:
    """Ends of the range that tests of accuracy draw from."""
    lower = max(declared.domain.lower, REALISTIC_FLOOR if declared.log or declared.unit == "rad" else 0.0)
    return lower, lower + 1 if math.isinf(declared.domain.upper) else declared.domain.upper


def draw(brdf: Brdf, shape: tuple[int, ...], seed: int) -> Brdf:
    """The model with every parameter drawn at random, of the given shape."""
    generator = torch.Generator().manual_seed(seed)
    values = {}
    for name, declared in brdf.declared.items():
        lower, upper = realistic(declared)
        uniform = torch.rand(shape, generator=generator, dtype=torch.float64)
        values[name] = lower * (upper / lower) ** uniform if declared.log else lower + (upper - lower) * uniform
    return brdf.replace(values)


def corners(brdf: Brdf, dtype: torch.dtype) -> Brdf:
    """The model at every combination of lower end, present value and upper end of its parameters: values [k, 1, 1].

    Parameters that only multiply shapes are taken at their ends: between them a term is finite where it is at the end
    at which the factor is not zero.
    """
    shaping = {name for term in brdf.structure.terms for name in term.shape_parameters}
    levels = []
    for name, declared in brdf.declared.items():
        upper = 10.0 if math.isinf(declared.domain.upper) else declared.domain.upper
        present = [brdf.parameters[name].item()] if name in shaping else []
        levels.append(torch.tensor([declared.domain.lower, *present, upper], dtype=dtype))
    grid = torch.cartesian_prod(*levels).reshape(-1, len(levels))
    return brdf.replace({name: grid[:, i].reshape(-1, 1, 1) for i, name in enumerate(brdf.declared)})


def trained(brdf: Brdf) -> tuple[Brdf, list[Tensor]]:
    """The model on fresh leaves that record derivatives, and those leaves in order of declaration."""
    leaves = {name: value.detach().clone().requires_grad_() for name, value in brdf.parameters.items()}
    return brdf.replace(leaves), list(leaves.values())


@cache
def gauss_legendre(n: int, upper: float) -> tuple[Tensor, Tensor]:
    """Nodes and weights on [0, upper]."""
    nodes, weights = (torch.from_numpy(x) for x in roots_legendre(n))
    return upper * (nodes + 1) / 2, upper * weights / 2


def directional_albedo(brdf: Brdf, theta: float, nodes: int = 64) -> Tensor:
    """∫ f cos θr dωr for light at polar angle `theta`: [..., C] for parameters [..., 1, C].

    The azimuth is π + π t³: its nodes crowd around the mirror direction, where the lobe of oblique light is narrow.
    """
    polar, weight = gauss_legendre(nodes, math.pi / 2)
    t, weight_t = gauss_legendre(nodes, 2.0)
    t = t - 1
    theta_o, phi = (x.reshape(-1) for x in torch.meshgrid(polar, math.pi + math.pi * t**3, indexing="ij"))
    solid_angle = (weight * polar.sin() * polar.cos()).outer(weight_t * 3 * math.pi * t * t).reshape(-1, 1)
    return (brdf(spherical(theta), spherical(theta_o, phi)) * solid_angle).sum(-2)
