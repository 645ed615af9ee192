"""Levenberg-Marquardt as one would write it by hand for a single model: vectorised torch, analytic Jacobian."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor

from matest.benchmark.task import Task, Trace
from matest.scene import Points

_ITERATIONS = 60
# The shape parameter changes by at most this factor at a step.
_FACTOR = 2.0


class Model(NamedTuple):
    """A model of one shape parameter and some amplitudes a channel.

    Attributes:
        amplitudes: their names.
        shape: name of the shape parameter.
        lower, upper: its bounds; those of amplitudes are 0 and 1.
        evaluate: radiance [n, C] and its derivatives [A + 1, n, C] by amplitudes and shape, from amplitudes [A, C] and
            shape.
    """

    amplitudes: tuple[str, ...]
    shape: str
    lower: float
    upper: float
    evaluate: Callable[[Tensor, Tensor], tuple[Tensor, Tensor]]


def levenberg_marquardt(task: Task, prepare: Callable[[Points], Model]) -> Trace:
    """Fit from the task's start; what depends on the geometry alone is computed once, and counts as time."""
    trace = Trace()
    model = prepare(task.points)
    like, channels, count = task.radiance, task.radiance.shape[1], len(model.amplitudes)
    start = task.start.to(like.dtype, like.device).parameters
    unknowns = torch.cat([*(start[name].expand(channels) for name in model.amplitudes), start[model.shape].reshape(1)])
    lower = torch.tensor([0.0] * (count * channels) + [model.lower]).to(like)
    upper = torch.tensor([1.0] * (count * channels) + [model.upper]).to(like)

    def evaluate(unknowns: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        amplitudes, shape = unknowns[:-1].reshape(count, channels), unknowns[-1]
        radiance, jacobian = model.evaluate(amplitudes, shape)
        residual = task.radiance - radiance
        weighted = jacobian * task.weight
        normal = torch.einsum("anc,bnc->cab", weighted, jacobian).double()
        slope = torch.einsum("anc,nc->ca", weighted, residual).double()
        # The amplitudes of each channel, one after another, and the shape that they share.
        size = count * channels + 1
        information, gradient = torch.zeros(size, size).double(), torch.zeros(size).double()
        for channel in range(channels):
            place = torch.tensor([*(row * channels + channel for row in range(count)), size - 1])
            information[place[:, None], place[None, :]] += normal[channel]
            gradient[place] += slope[channel]
        return (task.weight * residual.square()).sum(dtype=torch.float64), information, gradient

    cost, information, gradient = evaluate(unknowns)
    damping = 1e-3
    for _ in range(_ITERATIONS):
        damped = information + damping * information.diagonal().diag() + 1e-12 * torch.eye(len(gradient)).double()
        step = torch.linalg.solve(damped, gradient)
        tried = torch.minimum(torch.maximum(unknowns + step.to(unknowns), lower), upper)
        # A lobe that a long step makes too narrow is gone, and nothing brings it back.
        tried[-1] = tried[-1].clamp(unknowns[-1] / _FACTOR, unknowns[-1] * _FACTOR)
        found = evaluate(tried)
        if found[0] < cost:
            finished = float(cost - found[0]) < 1e-7 * float(cost)
            unknowns, (cost, information, gradient) = tried, found
            amplitudes = unknowns[:-1].reshape(count, channels)
            trace.add({**dict(zip(model.amplitudes, amplitudes, strict=True)), model.shape: unknowns[-1]})
            damping /= 10
            if finished:
                break
        elif damping > 1e6:
            break
        else:
            damping *= 10
    return trace


def cook_torrance(points: Points, f0: float = 0.04) -> Model:
    """Beckmann's distribution, V-cavities, a dielectric of known f0: all but D(m) depends on geometry alone."""
    wi, wo = points.wi[:, 0], points.wo
    half = torch.nn.functional.normalize(wi + wo, dim=-1)
    cos_i, cos_o, cos_h = wi[:, 2:].clamp(min=1e-6), wo[:, 2:].clamp(min=1e-6), half[:, 2:]
    cos_d = (wo * half).sum(-1, keepdim=True).clamp(1e-6, 1)
    masking = (2 * cos_h * torch.minimum(cos_i, cos_o) / cos_d).clamp(max=1)
    light = points.irradiance[:, 0] * wi[:, 2:].clamp(min=0)
    body = light / math.pi
    eta = (1 + math.sqrt(f0)) / (1 - math.sqrt(f0))
    g = (eta**2 + cos_d.square() - 1).sqrt()
    ratio = (g - cos_d) / (g + cos_d)
    other = (cos_d * (g + cos_d) - 1) / (cos_d * (g - cos_d) + 1)
    fresnel = 0.5 * ratio.square() * (1 + other.square())
    carried = light * fresnel * masking / (4 * math.pi * cos_i * cos_o * cos_h**4)
    tan2 = (1 - cos_h.square()).clamp(min=0) / cos_h.square()

    def evaluate(amplitudes: Tensor, slope: Tensor) -> tuple[Tensor, Tensor]:
        lobe = carried * ((-tan2 / slope.square()).exp() / slope.square())
        by_slope = lobe * amplitudes[1] * (2 * tan2 / slope**3 - 2 / slope)
        return amplitudes[0] * body + amplitudes[1] * lobe, torch.stack([body, lobe, by_slope])

    return Model(("diffuse", "specular"), "slope", 1e-3, 1.0, evaluate)


def oren_nayar(points: Points) -> Model:
    """Four images of the geometry, and coefficients of σ (Oren & Nayar 1994, eq. 14-16)."""
    wi, wo = points.wi[:, 0], points.wo
    theta_i, theta_o = (torch.acos(w[:, 2:].clamp(0, 1)) for w in (wi, wo))
    across = wi[:, :2].norm(dim=-1, keepdim=True) * wo[:, :2].norm(dim=-1, keepdim=True)
    cos_phi = (wi[:, :2] * wo[:, :2]).sum(-1, keepdim=True) / across.clamp(min=1e-9)
    alpha, beta = torch.maximum(theta_i, theta_o), torch.minimum(theta_i, theta_o).clamp(max=math.pi / 2 - 1e-6)
    light = points.irradiance[:, 0] * wi[:, 2:].clamp(min=0) / math.pi
    lobe = alpha.sin() - torch.where(cos_phi < 0, (2 * beta / math.pi) ** 3, 0.0)
    in_plane = light * cos_phi * beta.tan() * lobe
    oblique = (1 - cos_phi.abs()) * ((alpha + beta) / 2).tan() * (4 * alpha * beta / math.pi**2).square()
    out_of_plane = light * oblique
    bounce = light * (1 - cos_phi * (2 * beta / math.pi).square())

    def evaluate(amplitudes: Tensor, sigma: Tensor) -> tuple[Tensor, Tensor]:
        albedo, s2 = amplitudes[0], sigma.square()

        def share(constant: float) -> tuple[Tensor, Tensor]:
            """σ²/(σ² + constant) and its derivative by σ."""
            return s2 / (s2 + constant), 2 * sigma * constant / (s2 + constant).square()

        (a, da), (b, db), (c, dc) = share(0.33), share(0.09), share(0.13)
        direct = (1 - 0.5 * a) * light + b * (0.45 * in_plane + 0.125 * out_of_plane)
        direct_slope = -0.5 * da * light + db * (0.45 * in_plane + 0.125 * out_of_plane)
        radiance = albedo * (direct + (0.17 * c * albedo) * bounce)
        by_albedo = direct + (0.34 * c * albedo) * bounce
        by_sigma = albedo * (direct_slope + (0.17 * dc * albedo) * bounce)
        return radiance, torch.stack([by_albedo, by_sigma])

    return Model(("albedo",), "sigma", 0.0, math.pi / 2, evaluate)
