"""A suite, and how much of it a run measures."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from matest.benchmark.record import Progress, Record

if TYPE_CHECKING:
    from rich.console import RenderableType

# Solvers that matest can race, by the names that `--against` takes.
PEERS = ("adam", "l-bfgs", "least_squares", "levenberg-marquardt", "mitsuba", "dr.jit")


@dataclass(frozen=True)
class Effort:
    """How much a run measures.

    Attributes:
        quick: fewer and smaller measurements.
        shared: a full run of all suites, in which each suite that could go on for hours has its share of half an hour.
        against: names of the peers to race.
        seconds: time after which a suite begins no further measurement that it can do without.
    """

    quick: bool = False
    shared: bool = False
    against: tuple[str, ...] = PEERS
    seconds: float = math.inf

    def races(self, solver: str) -> bool:
        """Whether to race a solver, named after one or more peers ("adam, mini-batches")."""
        return any(part.strip() in self.against for part in solver.split(","))


@dataclass(frozen=True)
class Suite:
    """One subject of measurement, in a file of its own in `suites/` that ends in `SUITE = Suite(…)`.

    Attributes:
        measure: yields its records.
        table: shows them in 80 columns.
        share: seconds that it gets of a full run of all suites; infinite: no limit.
    """

    measure: Callable[[Effort, Progress], Iterator[Record]]
    table: Callable[[list[Record]], RenderableType]
    share: float = math.inf

    def run(self, effort: Effort, progress: Progress = lambda *_: None) -> Iterator[Record]:
        """The records of the suite."""
        return self.measure(replace(effort, seconds=self.share) if effort.shared else effort, progress)
