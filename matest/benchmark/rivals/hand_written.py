"""Levenberg-Marquardt as one would write it by hand for a single model: vectorised torch, analytic Jacobian."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import torch
from torch import Tensor

from matest.benchmark.instruments.contest import GLOSSY
from matest.benchmark.instruments.task import Task, Trace, Values
from matest.scene import Points

# Steps after which Levenberg-Marquardt gives up.
_ITERATIONS = 60
# The shape parameter changes by at most this factor at a step.
_FACTOR = 2.0


class Unknowns(NamedTuple):
    """Names of some amplitudes a channel, bounded by 0 and 1, and of one shape parameter with its bounds."""

    amplitudes: tuple[str, ...]
    shape: str
    lower: float
    upper: float


class Model(NamedTuple):
    """A model prepared for some samples.

    `evaluate` gives, for amplitudes [A, C] and shape, the radiance [n, C] and its derivatives by them [A + 1, n, C].
    """

    unknowns: Unknowns
    evaluate: Callable[[Tensor, Tensor], tuple[Tensor, Tensor]]


DIELECTRIC = Unknowns(("diffuse", "specular"), "slope", 1e-3, 1.0)


class Normal(NamedTuple):
    """Weighted sum of squares, JᵀWJ [P, P] and JᵀWr [P], in double precision."""

    cost: Tensor
    information: Tensor
    gradient: Tensor


def levenberg_marquardt(task: Task) -> Trace:
    """Fit from the task's start; what depends on the geometry alone is computed once, and counts as time."""
    trace = Trace()
    model = MODELS[task.start.expression](task.points)
    like, channels, count = task.radiance, task.radiance.shape[1], len(model.unknowns.amplitudes)

    def evaluate(unknowns: Tensor) -> Normal:
        amplitudes, shape = unknowns[:-1].to(like).reshape(count, channels), unknowns[-1].to(like)
        radiance, jacobian = model.evaluate(amplitudes, shape)
        residual = task.radiance - radiance
        weighted = jacobian * task.weight
        normal = torch.einsum("anc,bnc->cab", weighted, jacobian).double()
        slope = torch.einsum("anc,nc->ca", weighted, residual).double()
        return assembled((task.weight * residual.square()).sum(dtype=torch.float64), normal, slope)

    descend(model.unknowns, evaluate, task, trace)
    return trace


def optimum(task: Task, truth: Values) -> Values:
    """The optimum of the likelihood, in double precision from the truth."""
    exact = replace(task.double(), start=task.start.replace(truth))
    return levenberg_marquardt(exact).values[-1]


def assembled(cost: Tensor, normal: Tensor, slope: Tensor) -> Normal:
    """Normal equations of the amplitudes of each channel, one after another, and the shape that they share.

    They come from JᵀWJ [C, A + 1, A + 1] and JᵀWr [C, A + 1] of amplitudes and shape in every channel.
    """
    channels, rows = slope.shape
    size = (rows - 1) * channels + 1
    information, gradient = torch.zeros(size, size).double(), torch.zeros(size).double()
    for channel in range(channels):
        place = torch.tensor([*(row * channels + channel for row in range(rows - 1)), size - 1])
        information[place[:, None], place[None, :]] += normal[channel]
        gradient[place] += slope[channel]
    return Normal(cost, information, gradient)


def descend(named: Unknowns, evaluate: Callable[[Tensor], Normal], task: Task, trace: Trace) -> None:
    """Levenberg-Marquardt steps from the task's start, in double precision; every better one goes to the trace."""
    channels, count = task.radiance.shape[1], len(named.amplitudes)
    start = {name: value.double().cpu() for name, value in task.start.parameters.items()}
    unknowns = torch.cat([*(start[name].expand(channels) for name in named.amplitudes), start[named.shape].reshape(1)])
    lower = torch.tensor([0.0] * (count * channels) + [named.lower]).double()
    upper = torch.tensor([1.0] * (count * channels) + [named.upper]).double()
    cost, information, gradient = evaluate(unknowns)
    damping = 1e-3
    for _ in range(_ITERATIONS):
        damped = information + damping * information.diagonal().diag() + 1e-12 * torch.eye(len(gradient)).double()
        step = torch.linalg.solve(damped, gradient)
        tried = torch.minimum(torch.maximum(unknowns + step, lower), upper)
        # A lobe that a long step makes too narrow is gone, and nothing brings it back.
        tried[-1] = tried[-1].clamp(unknowns[-1] / _FACTOR, unknowns[-1] * _FACTOR)
        there = evaluate(tried)
        if there.cost < cost:
            finished = float(cost - there.cost) < 1e-7 * float(cost)
            unknowns, (cost, information, gradient) = tried, there
            amplitudes = unknowns[:-1].reshape(count, channels)
            trace.add({**dict(zip(named.amplitudes, amplitudes, strict=True)), named.shape: unknowns[-1]})
            damping /= 10
            if finished:
                break
        elif damping > 1e6:
            break
        else:
            damping *= 10


class Facets(NamedTuple):
    """A body and a lobe of Beckmann's facets under one light, all but the slope; in columns of torch or of Dr.Jit.

    Attributes:
        body: radiance of a white Lambertian body.
        carried: radiance of the lobe but for exp(-tan²α/m²), m⁻² and Smith's masking.
        tan2: tan²α of the half vector.
        cots: cot θ of the directions that Smith's masking depends on.
    """

    body: Any
    carried: Any
    tan2: Any
    cots: Sequence[Any]

    def lobe(self, slope: Any, exp: Callable, erf: Callable) -> tuple[Any, Any]:
        """The lobe, and the derivative of its logarithm by the slope.

        Smith's G1 = 2/(1 + erf a + exp(-a²)/(a √π)) at a = cot θ / m.
        """
        square = slope * slope
        lobe, bend = self.carried * (exp(-self.tan2 / square) / square), 2 * self.tan2 / (square * slope) - 2 / slope
        for cot in self.cots:
            a = cot / slope
            tail = exp(-a * a) / (a * math.sqrt(math.pi))
            masking = 2 / (1 + erf(a) + tail)
            lobe = lobe * masking
            bend = bend - masking * tail / (2 * slope)
        return lobe, bend

    def model(self) -> Model:
        """In torch."""

        def evaluate(amplitudes: Tensor, slope: Tensor) -> tuple[Tensor, Tensor]:
            lobe, bend = self.lobe(slope, torch.exp, torch.erf)
            radiance = amplitudes[0] * self.body + amplitudes[1] * lobe
            return radiance, torch.stack([self.body, lobe, lobe * amplitudes[1] * bend])

        return Model(DIELECTRIC, evaluate)


def facets(points: Points, f0: float, *, smith: bool) -> Facets:
    """The geometry of a dielectric of fixed f0, with Smith's masking or V-cavities, which depend on it alone."""
    wi, wo = points.wi[:, 0], points.wo
    half = torch.nn.functional.normalize(wi + wo, dim=-1)
    cos_i, cos_o, cos_h = wi[:, 2:].clamp(min=1e-6), wo[:, 2:].clamp(min=1e-6), half[:, 2:]
    cos_d = (wo * half).sum(-1, keepdim=True).clamp(1e-6, 1)
    light = points.irradiance[:, 0] * wi[:, 2:].clamp(min=0)
    eta = (1 + math.sqrt(f0)) / (1 - math.sqrt(f0))
    g = (eta**2 + cos_d.square() - 1).sqrt()
    ratio = (g - cos_d) / (g + cos_d)
    other = (cos_d * (g + cos_d) - 1) / (cos_d * (g - cos_d) + 1)
    fresnel = 0.5 * ratio.square() * (1 + other.square())
    carried = light * fresnel / (4 * math.pi * cos_i * cos_o * cos_h**4)
    if not smith:
        carried = carried * (2 * cos_h * torch.minimum(cos_i, cos_o) / cos_d).clamp(max=1)
    tan2 = (1 - cos_h.square()).clamp(min=0) / cos_h.square()
    cots = [cos / (1 - cos.square()).clamp(min=1e-12).sqrt() for cos in (cos_i, cos_o)] if smith else []
    return Facets(light / math.pi, carried, tan2, cots)


def cook_torrance(points: Points, f0: float = 0.04) -> Model:
    """Beckmann's distribution and V-cavities."""
    return facets(points, f0, smith=False).model()


def cook_torrance_smith(points: Points, f0: float = 0.04) -> Model:
    """The same with Smith's masking."""
    return facets(points, f0, smith=True).model()


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

    return Model(Unknowns(("albedo",), "sigma", 0.0, math.pi / 2), evaluate)


# By expression.
MODELS: dict[str, Callable[[Points], Model]] = {
    "oren-nayar": oren_nayar,
    "cook-torrance": cook_torrance,
    GLOSSY: cook_torrance_smith,
}
