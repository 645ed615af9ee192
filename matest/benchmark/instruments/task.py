"""What every peer is given: the same samples, noise and start; and when it has arrived."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import torch
from torch import Tensor

from matest.brdf import Brdf
from matest.scene import Points
from matest.shading import shade

# Relative distance from the optimum, of the parameter that is farthest, at which a solver has arrived.
CLOSE = 0.01

Values = dict[str, Tensor]


@dataclass(frozen=True)
class Task:
    """Weighted least squares over n samples.

    Attributes:
        start: the model in the middle of the domain of every parameter that is estimated.
        free: names of those.
        points: geometry and light, prepared.
        radiance: measured [n, C].
        weight: inverse variance of the noise [n, C].
    """

    start: Brdf
    free: tuple[str, ...]
    points: Points
    radiance: Tensor
    weight: Tensor

    def __getitem__(self, index: Tensor) -> Task:
        """Some of the samples."""
        return replace(self, points=self.points[index], radiance=self.radiance[index], weight=self.weight[index])

    def double(self) -> Task:
        """The same in double precision."""
        points = Points(self.points.wi.double(), self.points.wo.double(), self.points.irradiance.double())
        return replace(self, points=points, radiance=self.radiance.double(), weight=self.weight.double())

    def cost(self, brdf: Brdf) -> Tensor:
        """Mean weighted squared residual of the shaded model."""
        return (self.weight * (shade(brdf, self.points) - self.radiance).square()).mean()


@dataclass
class Trace:
    """One run of a solver: what it would hand over, had it been stopped at any time.

    Attributes:
        begin: on the clock of `time.perf_counter`.
        seconds, values: time since then and parameters of every result.
        rate: the learning rate, if there is one.
        note: what it was, for a person; empty: say how many results there are.
    """

    begin: float = field(default_factory=time.perf_counter)
    seconds: list[float] = field(default_factory=list)
    values: list[Values] = field(default_factory=list)
    rate: float | None = None
    note: str = ""

    @property
    def elapsed(self) -> float:
        return time.perf_counter() - self.begin

    @property
    def account(self) -> str:
        """What the run was, in a few words."""
        return self.note or f"{len(self.values)} iterations in all"

    def add(self, values: Mapping[str, Tensor]) -> None:
        self.seconds.append(self.elapsed)
        self.values.append({name: value.detach().clone() for name, value in values.items()})

    def arrival(self, optimum: Values) -> float | None:
        """Seconds after which every parameter stays within `CLOSE` of the optimum; None if it does not."""
        return arrival(zip(self.seconds, (distance(values, optimum) for values in self.values), strict=True), CLOSE)

    def shifted(self, seconds: float) -> Trace:
        """The same, begun so much earlier."""
        return replace(self, seconds=[at + seconds for at in self.seconds])

    def settled(self, optimum: Values, steps: int, close: float = CLOSE) -> bool:
        """Whether the last `steps` entries are all within `close` of the optimum."""
        last = self.values[-steps:]
        return len(last) == steps and all(distance(values, optimum) <= close for values in last)


def distance(values: Mapping[str, Tensor], optimum: Values) -> float:
    """The largest relative distance of a parameter from the optimum."""
    apart = [(values[name].double() / best.double() - 1).abs().max() for name, best in optimum.items()]
    # torch's maximum of a NaN and a number is the NaN.
    return float(torch.stack(apart).max())


def arrival(steps: Iterable[tuple[float, float]], limit: float) -> float | None:
    """The time, out of (time, value), after which a value stays at or below its limit; None if it does not."""
    arrived = None
    for seconds, value in steps:
        # Not "above": a NaN is not within any limit.
        if not value <= limit:
            arrived = None
        elif arrived is None:
            arrived = seconds
    return arrived
