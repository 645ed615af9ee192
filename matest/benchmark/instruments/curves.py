"""Error against time: what an estimator would hand over, had it been stopped at any time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from matest.benchmark.instruments.task import Trace, Values, arrival, distance
from matest.brdf import CookTorrance

# A curve is drawn through no more points than this.
POINTS = 40


class Step(NamedTuple):
    """A result.

    Attributes:
        seconds: since the start.
        error: root mean square, over the unknowns, of the distance from the truth in units of the Cramér-Rao bound.
        off: largest relative distance of a parameter from the optimum of the likelihood.
    """

    seconds: float
    error: float
    off: float


@dataclass(frozen=True)
class Curve:
    """Runs of an estimator; whoever reads it takes the best at every time.

    Attributes:
        runs: the results of each in the order of time; empty where the estimator is not there.
        note: what it was, for a person.
    """

    runs: Sequence[Sequence[Step]] = ()
    note: str = ""

    def arrival(self, what: str, limit: float) -> float | None:
        """Seconds after which `what`, "error" or "off", stays below the limit in some run; None if in none."""
        arrivals = [arrival([(step.seconds, getattr(step, what)) for step in run], limit) for run in self.runs]
        return min((seconds for seconds in arrivals if seconds is not None), default=None)

    def points(self) -> list[tuple[float, float]]:
        """Seconds and the smallest error of a run then, at most `POINTS` times, evenly spaced in their logarithm."""
        times = np.unique([step.seconds for run in self.runs for step in run])
        if len(times) > POINTS:
            grid = np.geomspace(times[0], times[-1], POINTS)
            times = times[np.unique(np.abs(np.log(times / grid[:, None])).argmin(1))]
        return [(at, min(_at(run, at) for run in self.runs)) for at in times.tolist()]

    @property
    def end(self) -> float | None:
        """Smallest error of a run at its end."""
        return min((run[-1].error for run in self.runs if run), default=None)


def _at(run: Sequence[Step], at: float) -> float:
    """The error of the last result until then; infinite before the first."""
    return next((step.error for step in reversed(run) if step.seconds <= at), math.inf)


@dataclass(frozen=True)
class Yardstick:
    """What results are measured with.

    Attributes:
        truth: value of every parameter.
        bound: the Cramér-Rao bound of the standard error of every unknown.
        optimum: of the likelihood.
    """

    truth: Values
    bound: Values
    optimum: Values

    def step(self, seconds: float, *results: Mapping[str, Tensor]) -> Step:
        """One result; of several as good as each other the root mean square error, and the largest distance."""
        square = sum(self._error(in_order(values)) ** 2 for values in results) / len(results)
        off = max(distance(in_order(values), in_order(self.optimum)) for values in results)
        return Step(seconds, math.sqrt(square), off)

    def run(self, trace: Trace) -> list[Step]:
        """All results of a solver."""
        return [self.step(seconds, values) for seconds, values in zip(trace.seconds, trace.values, strict=True)]

    def _error(self, values: Values) -> float:
        off = [(values[name].double() - self.truth[name].double()) / std for name, std in self.bound.items()]
        return float(torch.cat([part.flatten() for part in off]).square().mean().sqrt())


def in_order(values: Mapping[str, Tensor]) -> Values:
    """The same material with the narrower of two lobes first."""
    if "slope_2" not in values:
        return dict(values)
    lobes = {name: values[name] for name in ("slope", "slope_2", "weight_2")}
    ordered = CookTorrance(lobes="2").replace(lobes).ordered.parameters
    return {**values, **{name: ordered[name] for name in lobes}}
