"""Maps: parameters with a value at every pixel of the object, the rest of the material in common."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from matest.brdf import Brdf
from matest.errors import InputError
from matest.estimation.calibration import Calibration
from matest.estimation.options import Options
from matest.estimation.parameter_map import ParameterMap, TexelStatus, with_maps
from matest.estimators import Problem, Solution, Statistics
from matest.estimators.calibrated import body_albedos
from matest.estimators.moments import SCORES
from matest.estimators.texels.maps import MapFit, fit_maps
from matest.estimators.texels.regions import AMPLITUDE_TOLD, MISFIT_CHI2, SHAPE_TOLD
from matest.inference.budget import SAMPLES, Budget
from matest.inference.map_calibration import MapBudget, over_all
from matest.inference.map_jackknife import FEWEST_IMAGES, map_jackknife
from matest.inference.map_residuals import MapResiduals
from matest.inference.quantities import ParameterEstimate
from matest.parameters import Role
from matest.progress import Progress
from matest.samples.account import CalibratedSamples
from matest.samples.uncertainty import Uncertainty
from matest.scene import Surface

# The name that stands for the albedo of the body, whatever a model calls it.
ALBEDO = "albedo"
# Texels from which the parameters in common are found before all texels have their say.
SOME_TEXELS = 2_000
# Texels whose residuals are looked at.
_JUDGED_TEXELS = 1_000
# Share of the pixels that tell a parameter, below which its mean is not reported.
_FEW_TELL = 0.01
# Name of what texels of little known shape add, among errors of the calibration.
_BIAS = "bias"
# Standard deviations of a 95 % interval.
_QUANTILE = 1.96


@dataclass(frozen=True, eq=False)
class Mapped:
    """A fit with maps.

    Attributes:
        solution: of the parameters in common; those that are mapped are held at their means.
        maps: by name of the parameter.
        fit: of all texels.
        means: standard errors of the means of its unknowns [T].
        residuals: what they tell.
        budget: what adds to the noise of the parameters in common: of the calibration, of what the model misses, and of
            the bias that texels of little known shape leave; None: nothing does.
    """

    solution: Solution
    maps: Mapping[str, ParameterMap]
    fit: MapFit
    means: Tensor
    residuals: MapResiduals
    budget: Budget | None = None

    @property
    def material(self) -> Brdf:
        """The model with a value at every pixel of what is mapped, and of what is tied to it."""
        material, ties = self.solution.problem.material(self.solution.unknowns), self.fit.texels.problem.ties
        tied = {name: self.maps[source] for name, source in ties.items() if source in self.maps}
        return with_maps(material, {**self.maps, **tied})

    def parameters(self, parameters: Mapping[str, ParameterEstimate]) -> dict[str, ParameterEstimate]:
        """The parameters of the model, with the mean of those that are mapped."""
        return {name: self._mean(name, each) if name in self.maps else each for name, each in parameters.items()}

    @property
    def notes(self) -> list[str]:
        """Sentences on regions that were found, and on a shape in common that differs from pixel to pixel."""
        words, declared = ",".join(self.maps), self.fit.texels.problem.declared
        found = len(self.fit.regions.features)
        regions = [
            f"Pixels that do not tell their own value take that of their region: there are {found}, told apart by "
            "their albedos; --regions N asks for another number."
        ]
        return regions * (found > 1) + [
            f"{one.name} differs from pixel to pixel, by about ±{one.spread:.2g}{_unit(declared(one.name).unit)} rms: "
            f"that explains {one.explained:.0%} of what residuals have beyond the noise. Until it has a map of its "
            f"own, values are off by more than their error bars: --maps {words},{one.name.rpartition('.')[2]}."
            for one in self.residuals.varying[:1]
        ]

    def _mean(self, name: str, estimate: ParameterEstimate) -> ParameterEstimate:
        """The mean of a map, in the place of the value that was held; none where hardly a pixel tells its own."""
        if self.maps[name].determined < _FEW_TELL:
            doc = f"{estimate.doc}; no pixel tells it, so that its map has the value that describes all best"
            return replace(estimate, value=None, std=None, interval95=None, status="not determined", doc=doc)
        domain = self.fit.texels.problem.domain(name)
        values = self.maps[name].mean.tolist()
        stds = self.means[self.fit.texels.at(name)].tolist()
        intervals = [
            [max(v - _QUANTILE * s, domain.lower), min(v + _QUANTILE * s, domain.upper)]
            for v, s in zip(values, stds, strict=True)
        ]
        is_one = not isinstance(estimate.value, list) and len(values) == 1
        most = SHAPE_TOLD if name in self.fit.texels.shapes else AMPLITUDE_TOLD
        told = all(s <= most * abs(v) for v, s in zip(values, stds, strict=True))
        return replace(
            estimate,
            value=values[0] if is_one else values,
            std=stds[0] if is_one else stds,
            interval95=intervals[0] if is_one else intervals,
            status="determined" if told else "not determined",
            doc=f"{estimate.doc}; mean over the pixels of its map, of which {self.maps[name].determined:.0%} tell it",
        )


def fit_with_maps(
    solution: Solution,
    samples: CalibratedSamples,
    surface: Surface,
    options: Options,
    stated: Uncertainty,
    progress: Progress,
) -> Mapped:
    """The fit in which every pixel of the object has its own values of some parameters.

    Args:
        solution: with one value for all pixels.
        samples: that were fitted.
        surface: that they are of.
        options: `maps` names the parameters, `regions` says how many regions share what pixels do not tell.
        stated: what the capture states of its calibration.
        progress: called with a word on what is being done.

    Raises:
        InputError: a parameter that is not estimated, or cannot have a map.
    """
    problem = solution.problem
    names = [name for word in options.maps for name in mapped_names(problem, word)]
    few, tiles = samples.some_texels(SOME_TEXELS, options.seed), samples.texel_tiles()
    fit = fit_maps(
        problem, solution.unknowns, [name for name in problem.free if name in names], few, tiles, samples.texels,
        regions=options.regions, seed=options.seed, progress=progress,
    )  # fmt: skip
    further = _further_errors(fit, samples, options, stated)
    std, means = fit.std, fit.mean_std
    scatters = {_BIAS: fit.bias_scatter} if bool(fit.bias_scatter.any()) else {}
    if further:
        # What errors of the calibration do to residuals the scatter between photographs has too: the larger counts.
        places = np.stack(np.divmod(surface.pixels, surface.shape[1]), axis=1)
        relative = torch.stack([over_all(errors, places) for errors in further]).amax(0).to(std)
        std = torch.hypot(std, relative * fit.theta.abs())
        means = torch.hypot(means, torch.stack([errors.means for errors in further]).amax(0))
        scatters |= max(further, key=lambda errors: float(errors.means.sum())).common.scatters
    maps = {name: _map(name, fit, std) for name in fit.texels.mapped}
    residuals = MapResiduals.of(fit, samples, _JUDGED_TEXELS, options.seed)
    budget = Budget(fit.information, scatters) if scatters else None
    return Mapped(_in_common(fit, maps, solution), maps, fit, means, residuals, budget)


def _further_errors(fit: MapFit, samples: CalibratedSamples, options: Options, stated: Uncertainty) -> list[MapBudget]:
    """What adds to the noise: errors of the calibration that are stated, and what the model misses."""
    calibration = Calibration.of(options, stated, samples, fit.texels.problem)
    further = [calibration.map_budget(fit, samples, options.seed)]
    if fit.chi2 > MISFIT_CHI2 and samples.groups.images >= FEWEST_IMAGES:
        further.append(map_jackknife(fit, samples, SAMPLES // samples.groups.images, options.seed))
    return [errors for errors in further if errors is not None]


def mapped_names(problem: Problem, word: str) -> list[str]:
    """The free parameters that a word of `--maps` stands for.

    Raises:
        InputError: none, or one that cannot differ from pixel to pixel.
    """
    able = mappable(problem)
    bodies = [name for name in able if name in body_albedos(problem.brdf)]
    if word == ALBEDO and bodies:
        return bodies
    found = [name for name in problem.free if word in (name, name.rpartition(".")[2])]
    if not found and (held := _held(problem, word)):
        raise InputError(
            f"--maps {word}: {held[0]} is held at a value; leave --fix away or add --free {held[0]}, or "
            f"{_choices(able)}."
        )
    if not found:
        raise InputError(f"--maps {word}: {problem.brdf.expression} estimates no such parameter; {_choices(able)}.")
    if found[0] not in able:
        raise InputError(f"--maps {word}: it is one number for the whole capture; {_choices(able)}.")
    return found[:1]


def _held(problem: Problem, word: str) -> list[str]:
    """The parameters that a word of `--maps` stands for and that are held, but for the scale of the lights."""
    bodies = body_albedos(problem.brdf) if word == ALBEDO else ()
    return [
        name
        for name in problem.held
        if problem.brdf.declared[name].role is not Role.GAUGE
        and (word in (name, name.rpartition(".")[2]) or name in bodies)
    ]


def mappable(problem: Problem) -> list[str]:
    """The free parameters that can differ from pixel to pixel."""
    return [name for name in problem.free if name not in problem.gauges and not problem.declared(name).periodic]


def _unit(unit: str) -> str:
    """Beside a number."""
    return "" if unit == "1" else f" {unit}"


def _choices(names: Sequence[str]) -> str:
    return f"name one of {', '.join(names)}" if names else "name another model"


def _map(name: str, fit: MapFit, std: Tensor) -> ParameterMap:
    """The map of a parameter, from the standard errors of all unknowns [T, N]."""
    rows = fit.texels.at(name)
    value, std = fit.theta[rows].T, std[rows].T
    status = torch.where(fit.own[rows].all(0), TexelStatus.DETERMINED, TexelStatus.SHARED)
    status[(fit.held[rows] & fit.own[rows]).any(0)] = TexelStatus.AT_BOUND
    status[value.isnan().any(1)] = TexelStatus.UNSEEN
    return ParameterMap(name, value, std, status.to(torch.uint8))


def _in_common(fit: MapFit, maps: Mapping[str, ParameterMap], before: Solution) -> Solution:
    """The solution of the parameters in common, the texels having followed them."""
    problem, places = fit.texels.problem, fit.texels.common_places
    blocks = tuple(block for block in problem.blocks if block.name not in maps)
    held: dict[str, Tensor] = {name: each.mean if len(each.mean) > 1 else each.mean[0] for name, each in maps.items()}
    totals = fit.totals.sum(0)
    # Texels take degrees of freedom of their samples; where they take all, residuals are no measure of the fit.
    totals[SCORES.index("values")] = fit.degrees_left or totals[SCORES.index("values")]
    if not fit.degrees_left:
        totals[SCORES.index("chi2")] = totals[SCORES.index("values")]
    statistics = Statistics(
        labels=torch.zeros(1, dtype=torch.int64),
        informations=fit.information[None],
        gradients=fit.scores[None],
        scores=totals[None],
    )
    return replace(
        before,
        problem=replace(problem, blocks=blocks, held={**problem.held, **held}),
        unknowns=fit.unknowns[places],
        statistics=statistics,
        converged=fit.converged,
        residual_scale=fit.residual_scale,
        tiles=(),
    )
