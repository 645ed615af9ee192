"""Error bars of a solution, and what they make of each parameter: a number, a bound, or nothing."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import torch
from torch import Tensor

from matest.brdf.base import factor_value, named_by
from matest.capture import Capture
from matest.capture.samples import BLOCKS
from matest.estimators import Problem, Solution, accumulate, at_bound, bounded_step
from matest.likelihood_profile import profiles
from matest.result import ParameterEstimate
from matest.uncertainty import Covariance, correlation_of_residuals, error_of, fisher, jackknife, quantile95

# χ² per value above this says that the model does not hold: stated noise is exact, noise estimated from the pictures
# is known to some per cent.
_HOLDS_STATED, _HOLDS_ESTIMATED = 1.03, 1.10
# Scores of blocks of pixels that scatter this many times as much as independent residuals' do: not independent.
_CORRELATED = 2.0
# With few parameters in few blocks chance does that too: so many times its standard deviation.
_BY_CHANCE = 5.0
# An unknown at an end of its domain is held there by the data if they push by so many standard errors.
_PUSHED = 0.1
# With fewer images, blocks of pixels serve as clusters; with fewer of those, there is nothing to leave out.
_MIN_CLUSTERS = 4
# An amplitude this many standard errors above zero is seen: with a width free to be searched for, and several channels,
# noise alone often looks like two or three.
_VISIBLE = 4.0
# No better known than a value drawn evenly from the domain (its std is width/√12): not determined.
_KNOWS_NOTHING = 1 / math.sqrt(12)
# A bound is near within so many standard errors.
_NEAR = 3.0
# Likewise a value at or near a bound whose interval covers this share of the domain.
_ANYWHERE = 0.95


@dataclass(frozen=True)
class ErrorBars:
    """Error bars of a solution.

    Attributes:
        covariance: with parameters at a bound left out.
        open: the same with them let free: how far inside the domain the truth may lie.
        bound: unknowns at a bound [P].
        chi2: per value.
        correlation: of residuals over blocks of pixels: 1 if they are independent.
        holds: whether the model describes the images to their noise.
        kind: what the error bars rest on.
        flat: for unknowns at a lower bound where the model is flat in them to first order, about how far inside the
            domain the truth may lie.
        intervals: of 95 %, of the unknowns at or near a bound.
    """

    covariance: Covariance
    open: Covariance
    bound: Tensor
    chi2: float
    correlation: float
    holds: bool
    kind: str
    flat: dict[int, float] = field(default_factory=dict)
    intervals: dict[int, tuple[float, float]] = field(default_factory=dict)

    @property
    def reason(self) -> str:
        """Why the model does not hold."""
        if self.correlation > _CORRELATED and self.chi2 < _HOLDS_ESTIMATED:
            times = math.sqrt(self.correlation)
            return f"residuals lean the same way over whole regions, {times:.3g} times as much as by chance"
        return f"residuals are {math.sqrt(self.chi2):.3g} times as large"


def error_bars(solution: Solution, capture: Capture) -> ErrorBars:
    """Error bars of a solution: Fisher's where the model holds, jackknifed ones where it does not."""
    problem, statistics = solution.problem, solution.statistics
    chi2, scale = statistics.reduced_chi2, statistics.misfit
    push = statistics.gradient.abs() / (statistics.information.diagonal() * scale).clamp(min=1e-300).sqrt()
    # A valley that ends at a bound does not push: what lies along it is not determined there either.
    bound = at_bound(problem, solution.unknowns, statistics.gradient) & (push > _PUSHED)
    everything = torch.ones_like(bound)
    closed, opened = (fisher(statistics.information / scale, free) for free in (~bound, everything))
    correlation, by_chance = correlation_of_residuals(
        statistics.gradients / scale, statistics.informations / scale, closed
    )
    allowed = (_HOLDS_STATED if capture.noise_given else _HOLDS_ESTIMATED) + 5 * math.sqrt(
        2 / max(statistics.total("values"), 1)
    )
    holds = chi2 <= allowed and correlation <= max(_CORRELATED, 1 + _BY_CHANCE * by_chance)
    by_image = statistics.grouped(BLOCKS)
    clusters = by_image if len(by_image) >= _MIN_CLUSTERS else statistics
    if holds or len(clusters) < _MIN_CLUSTERS:
        return ErrorBars(closed, opened, bound, chi2, correlation, holds, "fisher")

    def inside(information: Tensor, gradient: Tensor) -> Tensor:
        return bounded_step(problem, solution.unknowns, information, gradient)

    def anywhere(information: Tensor, gradient: Tensor) -> Tensor:
        return fisher(information, everything).matrix @ gradient

    return ErrorBars(
        jackknife(clusters.informations, clusters.gradients, ~bound, inside),
        jackknife(clusters.informations, clusters.gradients, everything, anywhere),
        bound,
        chi2,
        correlation,
        holds,
        "jackknife over images" if clusters is by_image else "jackknife over blocks",
    )


def with_profiles(solution: Solution, bars: ErrorBars) -> ErrorBars:
    """The same error bars with the intervals of what lies at or near a bound by the profile of the likelihood.

    A symmetric interval says little there: the likelihood is cut, and often far from quadratic.
    """
    bars = replace(bars, flat=flat_at_bound(solution))
    problem = solution.problem
    plain = fisher(solution.statistics.information / solution.statistics.misfit, torch.ones_like(bars.bound)).std
    quantile = quantile95(bars.covariance.degrees)
    spreads, widening = {}, {}
    for name, place in problem.where.items():
        found = parameter_estimate(solution, bars, name)
        values = found.value if isinstance(found.value, list) else [found.value]
        for position, value in zip(range(place.start, place.stop), values, strict=False):
            std = float(bars.open.std[position])
            if value is None:
                continue
            room = float(min(value - problem.lower[position], problem.upper[position] - value))
            if position in bars.flat:
                spreads[position], wider = bars.flat[position], _widening(solution, bars)
            elif std > 0 and room < _NEAR * std:
                spreads[position], wider = quantile * std, std / float(plain[position])
            else:
                continue
            widening[position] = wider * quantile / quantile95(math.inf)
    intervals = {
        profile.position: profile.interval(spreads[profile.position])
        for profile in (profiles(solution, widening, bars.flat) if widening else ())
    }
    for name in _unseen(solution, bars):
        place = problem.where[name]
        for position in {*range(place.start, place.stop)} & {*intervals}:
            # The width that was searched for made the most of the noise.
            intervals[position] = (float(problem.lower[position]), intervals[position][1])
    return replace(bars, intervals=intervals)


def _unseen(solution: Solution, bars: ErrorBars) -> set[str]:
    """Amplitudes of lobes that are not there for all that the images tell."""
    problem = solution.problem
    factors = {
        problem.ties.get(named_by(factor), named_by(factor))
        for shape in problem.shapes
        if _faint(solution, bars, shape)
        for product in problem.brdf.carriers(shape)
        for factor in product
    }
    return factors & {*problem.amplitudes}


def flat_at_bound(solution: Solution) -> dict[int, float]:
    """95 % reach inside the domain of unknowns near a lower bound where the model does not change to first order.

    Oren-Nayar depends on σ²: at σ = 0 the information on σ is zero although σ² is well known. Information on s = σ² is
    that on σ at a small ε divided by 4ε², so that σ < √(1.96 std(s)) with std(s) = 2ε std(σ at ε).
    """
    problem = solution.problem
    reach = {}
    for name in problem.shapes:
        domain, place = problem.domain(name), problem.where[name]
        epsilon = 0.02 * domain.width
        if (
            problem.declared(name).log
            or problem.declared(name).periodic
            or float(solution.unknowns[place].max()) > epsilon
        ):
            continue
        moved = solution.unknowns.clone()
        moved[place] = domain.lower + epsilon
        statistics = accumulate(problem, moved, solution.tiles, solution.unknowns, solution.misfit)
        covariance = fisher(
            statistics.information / solution.statistics.misfit, torch.ones(problem.size, dtype=torch.bool)
        )
        for position in range(place.start, place.stop):
            square = (float(solution.unknowns[position]) - domain.lower) ** 2
            spread = quantile95(math.inf) * 2 * epsilon * float(covariance.std[position])
            # Zero lies inside the interval: the parameter sits at its bound for all that these images tell.
            if square < spread and not bool(covariance.undetermined[position]):
                reach[position] = math.sqrt(square + spread)
    return reach


def parameter_estimates(solution: Solution, bars: ErrorBars) -> dict[str, ParameterEstimate]:
    """Every parameter of the model: estimated, tied or fixed."""
    problem = solution.problem
    values = problem.values(solution.unknowns)
    out = {}
    for name, declared in problem.brdf.declared.items():
        source = problem.ties.get(name, name)
        value = values[name]
        if source in problem.where:
            found = parameter_estimate(solution, bars, source)
            status = "tied" if source != name else found.status
            out[name] = replace(found, status=status, unit=declared.unit, doc=declared.doc)
        elif not declared.gauge or float(value) != 1:
            out[name] = ParameterEstimate(value.tolist(), None, None, declared.unit, "fixed", declared.doc)
    for name in problem.brdf.declared:
        if problem.declared(name).ratio is not None:
            label, numerator = _ratio_names(problem, name)
            out[label] = _ratio(solution, bars, name, out[name])
            if numerator in problem.arbitrary and name in problem.where:
                for length in (numerator, name):
                    out[length] = replace(out[length], value=None, std=None, interval95=None, status="not determined")
    return out


def reported_labels(problem: Problem) -> list[str]:
    """A name for every row of `reported_correlation`."""
    return [reported_name(problem, label) for label in problem.labels]


def reported_correlation(solution: Solution, bars: ErrorBars) -> list[list[float]]:
    """Correlation of the estimates; a length of which only the ratio to another is known stands for that ratio."""
    problem = solution.problem
    sign = torch.tensor([-1.0 if known_by_ratio(problem, label) else 1.0 for label in problem.labels])
    return (bars.covariance.correlation * sign[:, None] * sign[None, :]).tolist()


def reported_name(problem: Problem, name: str) -> str:
    """The name under which what is known of a parameter is reported: its own, or that of its ratio to another."""
    ratio = name in problem.brdf.declared and problem.declared(name).ratio is not None
    return _ratio_names(problem, name)[0] if ratio and known_by_ratio(problem, name) else name


def known_by_ratio(problem: Problem, name: str) -> bool:
    """Whether only the ratio of a parameter to another has an effect."""
    declared = problem.brdf.declared.get(name)
    if declared is None or declared.ratio is None:
        return name in problem.arbitrary
    return numerator_of(problem, name) in problem.arbitrary


def seen_together(solution: Solution, bars: ErrorBars) -> set[str]:
    """Names under which parameters are reported of which the images see only combinations."""
    problem, told = solution.problem, solution.statistics.information.diagonal() > 0
    locked = bars.covariance.undetermined & told
    return {reported_name(problem, name) for name, place in problem.where.items() if bool(locked[place].any())}


def numerator_of(problem: Problem, name: str) -> str:
    """The parameter whose ratio to this one is reported."""
    return _ratio_names(problem, name)[1]


def _ratio_names(problem: Problem, name: str) -> tuple[str, str]:
    """Under which name the ratio to a parameter is reported, and its numerator (in a sum: paths)."""
    ratio = problem.declared(name).ratio
    assert ratio is not None
    component = name.removesuffix(name.rpartition(".")[2])
    return component + ratio[0], component + ratio[1]


def _ratio(solution: Solution, bars: ErrorBars, name: str, denominator: ParameterEstimate) -> ParameterEstimate:
    """The ratio of a parameter `Parameter.ratio` names to this one, with its error bar to first order."""
    problem, numerator = solution.problem, numerator_of(solution.problem, name)
    values = problem.values(solution.unknowns)
    top, bottom = float(values[numerator]), float(values[name])
    ratio = top / bottom
    doc = f"{numerator} / {name}"
    source = problem.ties.get(name, name)
    if source not in problem.where:
        return ParameterEstimate(ratio, None, None, "1", denominator.status, doc)
    if numerator in problem.where:
        relative = torch.zeros(problem.size, dtype=torch.float64)
        relative[problem.where[numerator].start], relative[problem.where[source].start] = 1 / top, -1 / bottom
        information = solution.statistics.information / solution.statistics.misfit
        found = error_of(information, relative)
        if found is None or found > 0.5:
            return ParameterEstimate(None, None, None, "1", "not determined", doc)
        std = ratio * found * _widening(solution, bars)
        reach = quantile95(bars.covariance.degrees) * std
        return ParameterEstimate(ratio, std, [max(ratio - reach, 0.0), ratio + reach], "1", "determined", doc)
    if denominator.value is None:
        return ParameterEstimate(None, None, None, "1", denominator.status, doc)
    std_bottom = denominator.std
    spread = None if std_bottom is None else ratio * float(std_bottom) / bottom  # type: ignore[arg-type]
    ends = [top / end for end in reversed(denominator.interval95)]
    return ParameterEstimate(ratio, spread, ends, "1", denominator.status, doc)


def parameter_estimate(solution: Solution, bars: ErrorBars, name: str) -> ParameterEstimate:
    """Value, error bar and interval of a free parameter, channel by channel."""
    problem, place = solution.problem, solution.problem.where[name]
    domain, declared = problem.domain(name), problem.declared(name)
    reach = quantile95(bars.covariance.degrees)
    values: list[float | None] = []
    stds: list[float | None] = []
    intervals: list[list[float] | None] = []
    states = []
    faint = _faint(solution, bars, name)
    for position in range(place.start, place.stop):
        value = float(solution.unknowns[position])
        flat = position in bars.flat
        at_end = bool(bars.bound[position]) or flat
        covariance = bars.open if at_end else bars.covariance
        std = float(covariance.std[position])
        # Under an unknown light scale only a value in proportion to the others can be called large.
        width = declared.domain.width if declared.periodic else domain.width
        scale = float(solution.unknowns[place].max()) if math.isinf(width) else width
        largest = min(_KNOWS_NOTHING * scale, 0.5 * value if declared.log else math.inf)
        interval = [max(domain.lower, value - reach * std), min(domain.upper, value + reach * std)]
        if position in bars.intervals:
            interval = list(bars.intervals[position])
        if flat:
            values.append(domain.lower)
            stds.append(None)
            intervals.append([domain.lower, interval[1]])
            states.append("at bound")
            continue
        near_end = at_end or position in bars.intervals
        anywhere = near_end and math.isfinite(width) and interval[1] - interval[0] > _ANYWHERE * width
        if bool(covariance.undetermined[position]) or faint or (std > largest and not at_end) or anywhere:
            values.append(None)
            stds.append(None)
            intervals.append(None)
            states.append("not determined")
            continue
        values.append(value)
        stds.append(None if at_end else std)
        intervals.append(interval)
        states.append("at bound" if at_end else "determined")
    status = next(state for state in ("not determined", "at bound", "determined") if state in states)
    single = len(values) == 1
    return ParameterEstimate(
        values[0] if single else values,
        stds[0] if single else stds,
        intervals[0] if single else intervals,
        declared.unit,
        status,
        declared.doc,
    )


def _widening(solution: Solution, bars: ErrorBars) -> float:
    """How much wider honest error bars are than those of the noise alone: the largest factor."""
    problem = solution.problem
    everything = torch.ones(problem.size, dtype=torch.bool)
    plain = fisher(solution.statistics.information / solution.statistics.misfit, everything).std
    return float((bars.open.std / plain).nan_to_num(1.0, posinf=1.0).clamp(min=1.0).max())


def _faint(solution: Solution, bars: ErrorBars, name: str) -> bool:
    """Whether a shape parameter belongs to lobes that are not there."""
    problem = solution.problem
    if name not in problem.shapes:
        return False
    values = problem.values(solution.unknowns)
    information = solution.statistics.information / solution.statistics.misfit
    # How much wider honest error bars are than those of the noise alone.
    wider = (bars.open.std / fisher(information, torch.ones(problem.size, dtype=torch.bool)).std).nan_to_num(1.0)

    def seen(factor: str, product: tuple[str, ...]) -> bool:
        """Whether a factor differs from zero in any channel, the other factors of its product and all shapes given."""
        value = factor_value(factor, values).reshape(-1)
        source = problem.ties.get(named_by(factor), named_by(factor))
        if source in problem.gauges or source not in problem.where:
            return source in problem.gauges or bool((value != 0).any())
        others = {problem.ties.get(named_by(other), named_by(other)) for other in product} - {source}
        beside = torch.zeros(problem.size, dtype=torch.bool)
        for name in {*problem.amplitudes} - others:
            beside[problem.where[name]] = True
        std = (fisher(information, beside).std * wider)[problem.where[source]]
        return bool((value > _VISIBLE * std).any())

    # A lobe is a product: it is gone when any one of its factors is.
    products = problem.brdf.carriers(name)
    return not any(all(seen(factor, product) for factor in product) for product in products)
