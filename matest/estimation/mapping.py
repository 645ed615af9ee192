"""Maps: an albedo at every pixel of the object, the rest of the material in common."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from matest.brdf import Brdf
from matest.errors import InputError
from matest.estimation.options import Options
from matest.estimation.parameter_map import ParameterMap, TexelStatus, with_maps
from matest.estimators import Problem, Solution, Statistics
from matest.estimators.calibrated import body_albedos
from matest.estimators.maps import TexelFit, fit_maps
from matest.estimators.moments import SCORES
from matest.inference.quantities import ParameterEstimate
from matest.progress import Progress
from matest.samples.account import CalibratedSamples

# The name that stands for the albedo of the body, whatever a model calls it.
ALBEDO = "albedo"
# Texels from which the parameters in common are found before all texels have their say.
_TEXELS = 2_000
# Standard deviations of a 95 % interval.
_QUANTILE = 1.96
# Relative standard error up to which a texel is determined.
_DETERMINED = 0.5


@dataclass(frozen=True, eq=False)
class Mapped:
    """A fit with maps.

    Attributes:
        solution: of the parameters in common; those that are mapped are held at their means.
        maps: by name of the parameter.
        fit: of all texels.
    """

    solution: Solution
    maps: Mapping[str, ParameterMap]
    fit: TexelFit

    @property
    def material(self) -> Brdf:
        """The model with a value at every pixel of what is mapped."""
        return with_maps(self.solution.problem.material(self.solution.unknowns), self.maps)

    def error_of(self, samples: CalibratedSamples) -> float | None:
        """The relative error on samples that were not fitted; None where there is none."""
        totals = self.fit.totals_over(samples.single_pixels())
        squared, signal = (float(totals[SCORES.index(f"squared_{kind}")]) for kind in ("residual", "signal"))
        return math.sqrt(squared / signal) if signal > 0 else None

    def parameters(self, parameters: Mapping[str, ParameterEstimate]) -> dict[str, ParameterEstimate]:
        """The parameters of the model, with the mean of those that are mapped."""
        return {name: self._mean(name, each) if name in self.maps else each for name, each in parameters.items()}

    def _mean(self, name: str, estimate: ParameterEstimate) -> ParameterEstimate:
        """The mean of a map, in the place of the value that was held."""
        each = self.maps[name]
        values, spreads = each.mean.tolist(), self.fit.mean_factor_std.tolist()
        base = self.fit.problem.values(self.fit.unknowns)[name].expand(len(values)).tolist()
        stds = [spread * one for spread, one in zip(spreads, base, strict=True)]
        intervals = [[v - _QUANTILE * s, v + _QUANTILE * s] for v, s in zip(values, stds, strict=True)]
        return replace(
            estimate,
            value=values,
            std=stds,
            interval95=intervals,
            status="determined",
            doc=f"{estimate.doc}; mean over the pixels of its map",
        )


def fit_with_maps(solution: Solution, samples: CalibratedSamples, options: Options, progress: Progress) -> Mapped:
    """The fit in which every pixel of the object has its own albedo.

    Args:
        solution: with one albedo for all pixels.
        samples: that were fitted.
        options: `maps` names the parameter.
        progress: called with a word on what is being done.

    Raises:
        InputError: a parameter that does not multiply the reflectance, or is not estimated.
    """
    problem = solution.problem
    names = _mapped(problem, options.maps[0])
    few, _ = samples.of_pixels(_TEXELS, options.seed)
    fit = fit_maps(problem, solution.unknowns, names, few, samples.single_pixels(), samples.texels, progress)
    values = problem.values(fit.unknowns)
    maps = {name: _map(name, fit, values[name].expand(problem.channels)) for name in names}
    return Mapped(_in_common(fit, maps, solution), maps, fit)


def _map(name: str, fit: TexelFit, mean: Tensor) -> ParameterMap:
    """The map of a parameter whose value was `mean` [C] for a factor of 1."""
    upper = fit.problem.domain(name).upper
    value = (fit.factors * mean.to(fit.factors)).clamp(max=upper)
    std = fit.factor_std.to(fit.factors) * mean.to(fit.factors)
    status = torch.where((std < _DETERMINED * value).all(dim=1), TexelStatus.DETERMINED, TexelStatus.SHARED)
    status[(value >= upper).any(dim=1)] = TexelStatus.AT_BOUND
    status[value.isnan().any(dim=1)] = TexelStatus.UNSEEN
    return ParameterMap(name, value, std, status.to(torch.uint8))


def _mapped(problem: Problem, name: str) -> list[str]:
    """The free parameters that a name stands for.

    Raises:
        InputError: none, or one that is no factor of what it scales.
    """
    factors = [factor for product in problem.brdf.structure.products for factor in product]
    plain = [path for path in problem.free if path in problem.amplitudes and not _is_complement(factors, path)]
    bodies = [path for path in plain if path in body_albedos(problem.brdf)]
    if name == ALBEDO and bodies:
        return bodies
    found = [path for path in problem.free if name in (path, path.rpartition(".")[2])]
    if not found:
        raise InputError(f"--maps {name}: {problem.brdf.expression} estimates no such parameter; {_choices(plain)}.")
    if found[0] not in plain:
        raise InputError(
            f"--maps {name}: only what multiplies the reflectance has a map, not what shapes it; {_choices(plain)}."
        )
    return found[:1]


def _is_complement(factors: Sequence, name: str) -> bool:
    """Whether one minus a parameter scales something too."""
    return any(factor.name == name and factor.complement for factor in factors)


def _choices(names: Sequence[str]) -> str:
    return f"name one of {', '.join(names)}" if names else "name another model"


def _in_common(fit: TexelFit, maps: Mapping[str, ParameterMap], before: Solution) -> Solution:
    """The solution of the parameters in common, the texels having followed them."""
    problem = fit.problem
    blocks = tuple(block for block in problem.blocks if block.name not in maps)
    held = {**problem.held, **{name: each.mean for name, each in maps.items()}}
    common = replace(problem, blocks=blocks, held=held)
    places = [torch.arange(problem.size)[problem.where[block.name]] for block in blocks]
    kept = torch.cat([torch.zeros(0, dtype=torch.int64), *places])
    information, gradient = fit.sums_in_common
    totals = fit.sums.totals.clone()
    # Every texel takes a degree of freedom of its samples.
    totals[SCORES.index("values")] -= int(fit.sums.seen.sum())
    statistics = Statistics(
        labels=torch.zeros(1, dtype=torch.int64),
        informations=information[kept][:, kept][None],
        gradients=gradient[kept][None],
        scores=totals[None],
    )
    return replace(
        before,
        problem=common,
        unknowns=fit.unknowns[kept],
        statistics=statistics,
        converged=fit.converged,
        residual_scale=fit.residual_scale,
        tiles=(),
    )
