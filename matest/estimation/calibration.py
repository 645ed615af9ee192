"""Errors of the calibration that an estimate refines, or only allows for in its error bars."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

from torch import Tensor

from matest.errors import InputError
from matest.estimation.options import Options
from matest.estimators import Problem, Solution
from matest.estimators.calibrated import body_albedos
from matest.estimators.refinement import MIN_UNKNOWNS, fit_calibrated
from matest.estimators.texels.maps import MapFit
from matest.inference.budget import SAMPLES, Budget, budget
from matest.inference.map_calibration import BESIDE_MAPS, MapBudget, map_budget
from matest.inference.posterior import Posterior
from matest.inference.quantities import Number
from matest.progress import Progress
from matest.samples.account import CalibratedSamples
from matest.samples.calibration import Family
from matest.samples.residual_scale import NOISE_ALONE, ResidualScale
from matest.samples.uncertainty import FOUND, PARTS, Uncertainty, whole

# Families that need the pixels around each sample, or all samples of a pixel: the others do without.
_APART = ("normal_noise", "albedo_noise", "blur")
# Share of the variance of an estimate above which it is mostly due to one family.
MOSTLY = 0.5
# Families that "all" stands for; what the others do, these can do too.
_TOGETHER = (
    "shift",
    "radius",
    "tilt",
    "normals",
    "albedo_field",
    "direction",
    "intensity",
    "ambient",
    "vignetting",
    "transfer",
    "curve",
    "black",
    "blur",
)


@dataclass(frozen=True)
class NuisanceEstimate:
    """The errors of one family of the calibration.

    Attributes:
        value: of each; None: they were not refined.
        std: standard errors; None likewise.
        size: rms of the errors as a whole; None likewise.
        prior_std: one standard deviation of the errors as a whole, beside the fit.
        origin: of that: "stated", "estimated" from the errors themselves, "assumed", or "found" in the residuals.
        refined: whether they were estimated with the material.
        unit: "1", "rad", "px", "px²".
        doc: what they are.
        adds: standard error that those that were not refined add to each parameter, by name.
        limits: the parameters whose variance is mostly theirs.
    """

    value: Number
    std: Number
    size: float | None
    prior_std: float
    origin: str
    refined: bool
    unit: str
    doc: str
    adds: dict[str, Number] = field(default_factory=dict)
    limits: list[str] = field(default_factory=list)

    @property
    def count(self) -> int:
        """Number of errors that were refined."""
        return len(self.value) if isinstance(self.value, list) else 0


@dataclass(frozen=True, eq=False)
class Calibration:
    """Which errors an estimate reckons with.

    Attributes:
        stated: standard deviation of the errors of every family that is stated.
        refined: standard deviation of those of the families to refine, stated or assumed.
        found: size of those that explain residuals, and were neither stated nor refined.
        seen: families of `refined` that are refined since they explain residuals.
    """

    stated: Mapping[str, float]
    refined: Mapping[str, float]
    found: Mapping[str, float] = field(default_factory=dict)
    seen: tuple[str, ...] = ()

    @classmethod
    def of(cls, options: Options, capture: Uncertainty, samples: CalibratedSamples, problem: Problem) -> Calibration:
        """What options and capture say, as far as it has an effect on samples of a problem.

        Raises:
            InputError: errors to refine that have none.
        """
        possible = families_of(samples, problem)
        given = _spreads(capture.merged(options.uncertainty))
        stated = {name: spread for name, spread in given.items() if name in possible}
        refinable = [name for name, family in possible.items() if not family.of_pixels]
        words = [word for word in options.refine if word != FOUND]
        if options.refines_all:
            names = [name for name in refinable if name in _TOGETHER or name in stated]
        else:
            names = [name for word in words for name in PARTS.get(word, (word,)) if name in refinable]
            if missing := [word for word in words if not {*PARTS.get(word, (word,))} & {*names}]:
                raise InputError(f"--refine {missing[0]}: {_REASONS.get(whole(missing[0]), _NO_EFFECT)}")
        return cls(stated, {name: stated.get(name, possible[name].assumed) for name in names})

    def refine(self, solution: Solution, samples: CalibratedSamples, seed: int, progress: Progress) -> Solution:
        """The solution with the errors of the families to refine among the unknowns."""
        if not self.refined:
            return solution
        families = samples.calibration([*self.refined])
        problem = solution.problem.calibrated(families, self.refined, samples.groups, centred(samples))
        return fit_calibrated(problem, solution, samples, seed, [*self.stated], progress)

    def refining(self, sizes: Mapping[str, float]) -> Calibration:
        """The same with further families refined, by name how large their errors seem to be."""
        further = {name: self.stated.get(name, size) for name, size in sizes.items()}
        return replace(self, refined={**self.refined, **further}, seen=tuple(sizes))

    def with_found(self, sizes: Mapping[str, float]) -> Calibration:
        """The same with errors that explain residuals, by family their size."""
        known = {*self.stated, *self.refined}
        return replace(self, found={name: size for name, size in sizes.items() if name not in known})

    @property
    def _rest(self) -> dict[str, float]:
        """Standard deviations of the errors that were not refined."""
        stated = {name: spread for name, spread in self.stated.items() if name not in self.refined}
        return {**stated, **self.found}

    def budget(
        self,
        fitted: Problem,
        unknowns: Tensor,
        samples: CalibratedSamples,
        seed: int,
        residual_scale: ResidualScale = NOISE_ALONE,
        count: int = SAMPLES,
    ) -> Budget | None:
        """How an estimate moves with the errors that are known of and are not refined; None: there are none.

        Args:
            fitted: what is estimated, with the errors that are refined.
            unknowns: of it [P].
            samples: that were fitted, or will be.
            seed: of the part of them that is read.
            residual_scale: by which outliers are judged.
            count: of samples in that part.
        """
        rest = self._rest
        if not rest:
            return None
        apart = [[name] for name in rest if name in _APART]
        budgets = []
        for names in filter(None, [[name for name in rest if name not in _APART], *apart]):
            families, spreads = samples.calibration([*self.refined, *names]), {name: rest[name] for name in names}
            problem = fitted.calibrated(families, {**self.refined, **spreads}, samples.groups, centred(samples))
            problem = problem.with_priors(fitted.spreads)
            budgets.append(budget(unknowns, problem, spreads, samples, seed, residual_scale, count))
        return replace(budgets[0], scatters={name: part for one in budgets for name, part in one.scatters.items()})

    def map_budget(self, fit: MapFit, samples: CalibratedSamples, seed: int) -> MapBudget | None:
        """How maps and what is beside them move with the errors that are stated; None: there are none."""
        stated = {name: spread for name, spread in self.stated.items() if name not in BESIDE_MAPS}
        if not stated:
            return None
        families = samples.calibration([*stated])
        problem = fit.texels.problem.calibrated(families, stated, samples.groups, centred(samples))
        return map_budget(fit, problem, stated, samples, SAMPLES // max(samples.groups.images, 1), seed)

    def estimates(
        self, solution: Solution, posterior: Posterior, samples: CalibratedSamples
    ) -> dict[str, NuisanceEstimate]:
        """The errors of every family that was refined or allowed for."""
        families = samples.calibration([*self.refined, *self._rest]).families
        return {family.name: self._estimate(family, solution, posterior) for family in families}

    def _estimate(self, family: Family, solution: Solution, posterior: Posterior) -> NuisanceEstimate:
        """The errors of one family."""
        name, estimate, size = family.name, posterior.nuisance.get(family.name), None
        spread = self.stated.get(name, self.found.get(name, 0.0))
        origin = "found" if name in self.found else "stated"
        if estimate is not None:
            spread = solution.problem.spreads[name] / family.spread
            if name not in self.stated:
                few = "found" if name in self.seen else "assumed"
                origin = "estimated" if family.count >= MIN_UNKNOWNS else few
            errors = solution.unknowns[solution.problem.where[name]]
            size = float(errors.square().mean().sqrt()) / family.spread
        adds, limits = _part_of_error_bars(posterior, name)
        return NuisanceEstimate(
            value=None if estimate is None else estimate.value,
            std=None if estimate is None else estimate.std,
            size=size,
            prior_std=spread,
            origin=origin,
            refined=estimate is not None,
            unit=family.unit,
            doc=family.doc,
            adds=adds,
            limits=limits,
        )


def _part_of_error_bars(posterior: Posterior, family: str) -> tuple[dict[str, Number], list[str]]:
    """The standard error that a family adds to each determined parameter, and those of which it is most."""
    share, problem = posterior.bars.shares.get(family), posterior.problem
    if share is None:
        return {}, []
    adds: dict[str, Number] = {}
    limits = []
    for name in problem.free:
        if posterior.estimates[name].status == "determined":
            part, whole = share[problem.where[name]], posterior.bars.covariance.std[problem.where[name]]
            adds[name] = part.tolist() if len(part) > 1 else float(part)
            if bool((part.square() > MOSTLY * whole.square()).any()):
                limits.append(name)
    return adds, limits


# Why some errors cannot be refined.
_NO_EFFECT = "it has no effect on these photographs of this model; leave it out."
_REASONS = {
    "normal_noise": "errors of the normals of single pixels are no unknowns; --refine normals has those of a smooth "
    "field.",
    "albedo": "the model has no diffuse body whose albedo could vary; leave it out.",
    "albedo_noise": "the albedo of single pixels is no unknown; --refine albedo has that of a smooth field.",
}

# Errors of single lights, and those of all together that a map of light has instead.
_OF_A_MAP = {"direction": "rotation", "intensity": "scale or exposure"}


def without_effect(stated: Iterable[str], *, surrounded: bool) -> list[str]:
    """Sentences on stated errors, by name, that error bars do not hold.

    Args:
        stated: names.
        surrounded: whether a map of light stands for lights.
    """
    return [
        f"The stated uncertainty of {name} has no effect: a map of light is turned and scaled as a whole; state "
        f"{_OF_A_MAP[name]} instead."
        for name in stated
        if surrounded and name in _OF_A_MAP
    ]


def _spreads(uncertainty: Uncertainty) -> dict[str, float]:
    """The standard deviations that are stated, by family, in the units of its unknowns."""
    spreads = {}
    for name, value in uncertainty.stated.items():
        numbers = value if isinstance(value, tuple) else (value,)
        for family, number in zip(PARTS.get(name, (name,)), numbers, strict=True):
            # The unknown of the blur is a variance.
            spreads[family] = number**2 if family == "blur" else number
    return spreads


def centred(samples: CalibratedSamples) -> tuple[str, ...]:
    """Families whose mean is part of the unknown scale of the lights."""
    return ("intensity", "exposure") if samples.relative else ()


def implausible(solution: Solution) -> list[str]:
    """Families of refined errors that came out larger than those of a calibration are."""
    problem = solution.problem
    sizes = {name: float(solution.unknowns[problem.where[name]].square().mean().sqrt()) for name in problem.spreads}
    families = {name: problem.family(name) for name in sizes}
    return [name for name, size in sizes.items() if size > families[name].largest * families[name].spread]


def families_of(samples: CalibratedSamples, problem: Problem) -> dict[str, Family]:
    """The families of errors that have an effect on samples of a problem, by name."""
    names = [name for name in samples.calibration_names if _has_effect(name, problem)]
    return {family.name: family for family in samples.calibration(names).families}


def _has_effect(name: str, problem: Problem) -> bool:
    """Whether errors of a family change what a model predicts, and can be computed."""
    if name in ("albedo_field", "albedo_noise"):
        return bool(body_albedos(problem.brdf))
    return name != "ambient" or not problem.brdf.structure.anisotropic
