"""What errors of the calibration do to what photographs will tell: those that are stated, and others of a unit each."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import torch
from torch import Tensor

from matest.estimation.calibration import MOSTLY, Calibration, families_of
from matest.estimation.options import Options
from matest.identifiability.forecast import Forecast
from matest.inference.budget import SAMPLES, Budget
from matest.inference.derived import reported_name
from matest.inference.quantities import Number
from matest.photographs.samples import PhotographSamples
from matest.samples.calibration import Family
from matest.samples.uncertainty import Uncertainty

# Errors that nobody states are tried at a degree, a per cent, a pixel.
_UNIT_ERRORS = Uncertainty(
    **dict.fromkeys(("direction", "rotation", "normals", "normal_noise"), math.radians(1)),
    **dict.fromkeys(
        ("intensity", "exposure", "scale", "ambient", "black", "vignetting", "transfer", "albedo", "albedo_noise"), 0.01
    ),
    **dict.fromkeys(("radius", "blur"), 1.0),
    pose=(1.0, math.radians(1)),
)
# Samples that are enough to say roughly what errors do that nobody states.
_SAMPLES = 10_000
# Relative standard error below which an error that nobody states is left out: it has no effect.
_NO_EFFECT = 1e-5
# Parameters of which it is said what limits them: those that it adds most to.
_MAX_LIMITS = 3
# A better calibration that is advised is at least twice and at most ten times as good: what is better yet nobody has.
_BETTER = 2.0, 10.0


@dataclass(frozen=True)
class CalibrationError:
    """What errors of one family of the calibration do to the parameters.

    Attributes:
        size: one standard deviation of the errors as a whole, in `unit`.
        stated: whether it is stated; if not, it is 0.01, 1°, 1 px or 1 px².
        unit: "1", "rad", "px"; of a blur, whose size is a variance, "px²".
        doc: what they are.
        adds: standard error that they add to each determined parameter, by name; if they are not stated, would add.
        relative: the same over the value (over the domain's width where that is 0), the largest of all channels.
    """

    size: float
    stated: bool
    unit: str
    doc: str
    adds: dict[str, Number]
    relative: dict[str, float]

    @property
    def most(self) -> float:
        """The largest relative standard error that they add."""
        return max(self.relative.values(), default=0.0)


@dataclass(frozen=True)
class CalibrationLimit:
    """What limits a parameter whose error bar is mostly due to stated errors, and what knowing them better would bring.

    Attributes:
        parameter: its name; of several channels the one with the largest relative standard error counts.
        family: of the errors that add most.
        relative: predicted standard error of the parameter over its value.
        part: what the family adds, likewise.
        size: one standard deviation that is stated, in `unit`.
        better: a smaller one, at which the family adds about as much as everything else, but for the limits of what
            can be measured.
        then: `relative` with that.
        unit: "1", "rad", "px".
    """

    parameter: str
    family: str
    relative: float
    part: float
    size: float
    better: float
    then: float
    unit: str


@dataclass(frozen=True, eq=False)
class Stated:
    """What is stated of the calibration.

    Attributes:
        options: of the check.
        plan: what the plan itself states.
    """

    options: Options
    plan: Uncertainty

    def budget(self, forecast: Forecast, samples: PhotographSamples) -> Budget | None:
        """How an estimate from predicted samples moves with the errors that are stated; None: there are none."""
        return self._budget(self._sizes(self.plan, forecast, samples), forecast, samples, SAMPLES)

    def errors(self, forecast: Forecast, samples: PhotographSamples, bent: Sequence[str] = ()) -> Errors:
        """What errors of every family do, stated or not.

        Args:
            forecast: of the samples, by the noise alone.
            samples: of `predicted_samples`.
            bent: names of parameters of which nothing is said, since standard errors do not hold for them.
        """
        stated = self._sizes(self.plan, forecast, samples)
        others = self._sizes(_UNIT_ERRORS.merged(self.plan), forecast, samples)
        others = {name: size for name, size in others.items() if name not in {*stated, *_idle(samples)}}
        return Errors(
            forecast=forecast,
            bent=bent,
            families=families_of(samples, forecast.problem),
            stated=stated,
            others=others,
            budget=self._budget(stated, forecast, samples, SAMPLES),
            budget_of_others=self._budget(others, forecast, samples, _SAMPLES),
        )

    def _sizes(self, plan: Uncertainty, forecast: Forecast, samples: PhotographSamples) -> Mapping[str, float]:
        """One standard deviation of the errors of every family that are stated and have an effect."""
        return Calibration.of(self.options, plan, samples, forecast.problem).stated

    def _budget(
        self, sizes: Mapping[str, float], forecast: Forecast, samples: PhotographSamples, count: int
    ) -> Budget | None:
        if not len(samples):
            return None
        return Calibration(sizes, {}).budget(
            forecast.problem, forecast.unknowns, samples, self.options.seed, count=count
        )


def _idle(samples: PhotographSamples) -> list[str]:
    """Families whose errors do nothing, or nothing but what those of another family do."""
    return ["exposure"] * samples.account.one_light_each + ["scale"] * samples.relative


@dataclass(frozen=True, eq=False)
class Errors:
    """What errors of the calibration do to the estimate from some predicted samples.

    Attributes:
        forecast: by the noise alone.
        bent: names of parameters of which nothing is said.
        families: by name.
        stated: one standard deviation of the errors of every family that is stated, by name.
        others: the same of those that are not.
        budget: of the stated errors; None where there are none, or no samples.
        budget_of_others: likewise.
    """

    forecast: Forecast
    bent: Sequence[str]
    families: Mapping[str, Family]
    stated: Mapping[str, float]
    others: Mapping[str, float]
    budget: Budget | None
    budget_of_others: Budget | None

    @property
    def allowed_for(self) -> Forecast:
        """The forecast with what stated errors add."""
        return replace(self.forecast, budget=self.budget)

    @property
    def by_family(self) -> dict[str, CalibrationError]:
        """What the errors of each family do, the largest effect first; those without any are left out."""
        errors = {name: self._of(name) for name in self._shares}
        names = sorted(errors, key=lambda name: -errors[name].most)
        return {name: errors[name] for name in names if name in self.stated or errors[name].most > _NO_EFFECT}

    @property
    def limits(self) -> list[CalibrationLimit]:
        """What limits the parameters to which stated errors add most."""
        limits = [limit for name in self._determined if self.budget and (limit := self._limit(name))]
        return sorted(limits, key=lambda limit: -limit.part)[:_MAX_LIMITS]

    def _of(self, family: str) -> CalibrationError:
        adds = {name: each.std * each.of(self._shares[family]) for name, each in self._determined.items()}
        return CalibrationError(
            size={**self.stated, **self.others}[family],
            stated=family in self.stated,
            unit=self.families[family].unit,
            doc=self.families[family].doc,
            adds={name: part.tolist() if len(part) > 1 else float(part) for name, part in adds.items()},
            relative={name: float((adds[name] / each.reference).max()) for name, each in self._determined.items()},
        )

    def _limit(self, name: str) -> CalibrationLimit | None:
        """What limits a parameter; None: mostly the noise does."""
        parameter = self._determined[name]
        noise = parameter.std / parameter.reference
        parts = {family: noise * parameter.of(self._shares[family]) for family in self.stated}
        added = sum((part.square() for part in parts.values()), torch.zeros_like(noise))
        whole = (noise.square() + added).sqrt()
        channel = int(whole.argmax())
        total = float(whole[channel])
        if not float(added[channel]) > MOSTLY * total**2:
            return None
        family = max(parts, key=lambda each: float(parts[each][channel]))
        part = float(parts[family][channel])
        # The unknown of a blur is a variance; people state its root.
        power = 2 if family == "blur" else 1
        size, rest = self.stated[family] ** (1 / power), math.sqrt(max(total**2 - part**2, 0.0))
        times = (part / max(rest, part / _BETTER[1] ** power)) ** (1 / power)
        better = _round(size / max(times, _BETTER[0]))
        then = math.hypot(rest, part * (better / size) ** power)
        unit = self.families[family].unit.removesuffix("²")
        return CalibrationLimit(name, family, total, part, size, better, then, unit)

    @cached_property
    def _determined(self) -> dict[str, _Determined]:
        """The parameters that the noise alone leaves determined, by reported name."""
        forecast, problem = self.forecast, self.forecast.problem
        out = {}
        for parameter in (parameter for parameter in problem.free if parameter not in self.bent):
            name, place = reported_name(problem, parameter), problem.where[parameter]
            estimate = forecast.posterior.estimates.get(name)
            if estimate is not None and estimate.status == "determined" and estimate.std is not None:
                value, std = (
                    torch.atleast_1d(torch.as_tensor(number, dtype=torch.float64))
                    for number in (estimate.value, estimate.std)
                )
                out[name] = _Determined(place, std, torch.where(value == 0, forecast.references[place], value.abs()))
        return out

    @cached_property
    def _shares(self) -> dict[str, Tensor]:
        """What each family adds to the standard errors of the unknowns, in units of these by the noise alone [P]."""
        everything = torch.ones(self.forecast.problem.size, dtype=torch.bool)
        budgets = [budget for budget in (self.budget, self.budget_of_others) if budget is not None]
        covariances = [pair for budget in budgets for pair in budget.covariances(everything).items()]
        return {name: covariance.diagonal().clamp(min=0).sqrt() / self.forecast.std for name, covariance in covariances}


@dataclass(frozen=True, eq=False)
class _Determined:
    """A parameter that is determined, or a derived quantity that stands for one.

    Attributes:
        place: of its unknowns.
        std: standard error by the noise alone [C or 1].
        reference: what standard errors are compared with [C or 1].
    """

    place: slice
    std: Tensor
    reference: Tensor

    def of(self, unknowns: Tensor) -> Tensor:
        """Its part [C or 1] of a number for each unknown [P]."""
        return unknowns[self.place]


def _round(number: float) -> float:
    """The largest of 1, 2 and 5 times powers of ten up to a number."""
    exponent = math.floor(math.log10(number))
    first = next(digit for digit in (5, 2, 1) if digit <= number / 10.0**exponent * (1 + 1e-9))
    return float(f"{first}e{exponent}")
