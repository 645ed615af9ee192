"""One simulated capture: the estimate against the truth, in units of the Cramér-Rao bound."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

import matest
from matest.benchmark.instruments.optimum import excess
from matest.benchmark.instruments.simulated import CLEAN, Conditions, Draw, draw
from matest.estimation.options import Options
from matest.estimation.result import Estimate
from matest.estimation.specification import specify
from matest.estimators import Problem, accumulate
from matest.estimators.covariance import fisher
from matest.identifiability.forecast import unknowns_at
from matest.workers import single_threaded_torch

# Parameters nearer than this many standard errors to an end of their domain do not count.
_FROM_BOUND = 3.0
# Nor do those that the samples tell less of than an even draw from the domain would (its std is width/√12), or, where
# a parameter varies over decades, to no better than half its value.
_KNOWS_NOTHING, _KNOWS_LITTLE = 1 / math.sqrt(12), 0.5
# Parameters that are held at their true value.
_HELD = ("f0",)


@dataclass(frozen=True)
class Figure:
    """One unknown of one capture.

    Attributes:
        label: `sigma`, `albedo[0]`.
        truth: its value.
        bound: the Cramér-Rao bound of its standard error.
        value: the estimate; None where none was given.
        interval: of 95 %; None likewise.
    """

    label: str
    truth: float
    bound: float
    value: float | None
    interval: tuple[float, float] | None

    @property
    def error(self) -> float:
        """Of the estimate, in units of the bound; NaN where there is none."""
        return math.nan if self.value is None else (self.value - self.truth) / self.bound

    @property
    def covered(self) -> bool:
        """Whether the interval holds the truth."""
        return self.interval is not None and self.interval[0] <= self.truth <= self.interval[1]


@dataclass(frozen=True)
class Trial:
    """One simulated capture.

    Attributes:
        expression: of the model.
        seed: of the draw.
        figures: the unknowns that these samples determine and whose truth lies off the ends of its domain.
        excess: χ² above the lowest on a dense grid; None where no grid was computed.
        errors: what the error bars rest on.
        about: object, lights and noise, for a person.
    """

    expression: str
    seed: int
    figures: tuple[Figure, ...]
    excess: float | None
    errors: str
    about: str

    @property
    def worst(self) -> float:
        """The largest error of an unknown, in units of its bound."""
        return max((abs(figure.error) for figure in self.figures if figure.value is not None), default=0.0)

    @property
    def uncovered(self) -> int:
        """Number of intervals that miss the truth."""
        return sum(figure.interval is not None and not figure.covered for figure in self.figures)

    @property
    def summary(self) -> str:
        """Estimate (truth), error in units of the bound, of every unknown."""
        parts = [
            f"{f.label} not given ({f.truth:.4g})"
            if f.value is None
            else f"{f.label} {f.value:.4g} ({f.truth:.4g}), {f.error:+.1f}{'' if f.covered else ' outside'}"
            for f in self.figures
        ]
        above = [] if self.excess is None else [f"χ² {self.excess:+.2g} from the grid's lowest"]
        return "; ".join([*parts, *above, f"error bars: {self.errors}"])

    def only(self, name: str) -> Trial:
        """The same capture with the unknowns of one parameter."""
        return replace(self, figures=tuple(f for f in self.figures if f.label.partition("[")[0] == name))


def trial(expression: str, seed: int, conditions: Conditions = CLEAN, grid: bool = True) -> Trial:
    """Draw, photograph, estimate and compare.

    The bound is that of an observer who knows which pixels are outliers and which saturated, and who uses every other
    lit pixel off the rim, weighed by the noise at its true radiance.

    Args:
        expression: of the model.
        seed: of the draw.
        conditions: of the camera.
        grid: whether to look for an optimum below the estimate on a dense grid of the shape parameters.
    """
    # Images are too small to be worth several threads.
    with single_threaded_torch():
        try:
            return _trial(draw(expression, seed), conditions, grid)
        except Exception as error:
            error.add_note(f"in the capture of {expression} with seed {seed}, {conditions}")
            raise


def described(found: Trial) -> str:
    """A trial as a sentence."""
    return f"{found.expression}, seed {found.seed} ({found.about}): {found.summary}"


def _trial(drawn: Draw, conditions: Conditions, grid: bool) -> Trial:
    expression = drawn.material.expression
    held = {name: drawn.material.parameters[name].tolist() for name in _HELD if name in drawn.material.declared}
    capture = drawn.photograph(conditions)
    problem = specify(
        expression, Options(fix=held), channels=capture.channels, relative=False, scene=capture.scene
    ).problem
    truth = unknowns_at(problem, drawn.material.parameters)
    samples = drawn.ideal(conditions).samples(dtype=torch.float64)
    information = accumulate(problem, truth, samples.tiles(merge=False), truth).information * (1 - conditions.outliers)
    found = matest.estimate(capture, expression, fix=held)
    above = None
    if grid:
        above = excess(problem, unknowns_at(problem, found.material.parameters), capture.samples(dtype=torch.float64))
    figures = _figures(problem, truth, information, found)
    return Trial(expression, drawn.seed, figures, above, found.fit.errors, _about(drawn))


def _figures(problem: Problem, truth: Tensor, information: Tensor, found: Estimate) -> tuple[Figure, ...]:
    covariance = fisher(information, torch.ones(problem.size, dtype=torch.bool))
    out = []
    for name, place in problem.where.items():
        domain, declared = problem.domain(name), problem.declared(name)
        # Of some parameters a quantity derived from them and others is known, and reported.
        quantity = next((derived for derived in problem.brdf.derived.values() if derived.sets == name), None)
        label = name if quantity is None else quantity.name
        reported = found.parameters[label]
        single = place.stop - place.start == 1
        values = [reported.value] if not isinstance(reported.value, list) else reported.value
        ends = [reported.interval95] if not isinstance(reported.value, list) else reported.interval95
        for channel, position in enumerate(range(place.start, place.stop)):
            true, std = float(truth[position]), float(covariance.std[position])
            little = min(_KNOWS_NOTHING * domain.width, _KNOWS_LITTLE * true if declared.log else math.inf)
            off = min(true - domain.lower, domain.upper - true)
            if bool(covariance.undetermined[position]) or std > little or off < _FROM_BOUND * std:
                continue
            if quantity is not None:
                at = {**problem.held, name: truth[position]}
                true, std = float(quantity.value(at)), std * abs(quantity.slopes(at)[name])
            # What is not determined is a single None.
            value, interval = (None, None) if values == [None] else (values[channel], ends[channel])
            out.append(
                Figure(
                    label=label if single else f"{label}[{channel}]",
                    truth=true,
                    bound=std,
                    value=value,
                    interval=None if interval is None else (interval[0], interval[1]),
                )
            )
    return tuple(out)


def _about(drawn: Draw) -> str:
    scene, noise = drawn.scene, drawn.noise
    shape = "sphere" if scene.surface.mesh is None else "vase"
    lights = f"{len(scene)} light" + ("s" if len(scene) > 1 else "")
    return f"{shape}, {lights}, {scene.channels} channels, read {noise.read:.2g}, gain {noise.gain:.2g}"
