"""A suite, how much of it a run measures, and the records that it gives."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

from matest.progress import Progress, silent

if TYPE_CHECKING:
    from rich.console import RenderableType

__all__ = ["PEERS", "QUICK", "Effort", "Progress", "Record", "Suite"]

# Solvers that matest can race, by the names that `--against` takes.
PEERS = ("adam", "l-bfgs", "least_squares", "levenberg-marquardt", "mitsuba", "dr.jit")
# The metric of the suite `limits` that tells a quick run from a full one.
QUICK = "quick"


@dataclass(frozen=True)
class Record:
    """One figure.

    Attributes:
        suite, case, metric: what was measured, of which case.
        value: the figure; None where it could not be measured.
        unit: "ns", "1"…; "pass" is the time of one element-wise product of two tensors in the same run.
        better: which way is better.
        limit: the target, if there is one.
        note: for a person: where the worst case was, or why there is no value.
    """

    suite: str
    case: str
    metric: str
    value: float | None
    unit: str
    better: Literal["lower", "higher"] = "lower"
    limit: float | None = None
    note: str = ""

    @property
    def misses(self) -> bool:
        """Whether the value is on the wrong side of its limit."""
        if self.value is None or self.limit is None:
            return False
        return self.value > self.limit if self.better == "lower" else self.value < self.limit

    def to_dict(self) -> dict[str, Any]:
        """The record as a line of JSON, without the note."""
        return {name: value for name, value in asdict(self).items() if name != "note"}


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

    def run(self, effort: Effort, progress: Progress = silent) -> Iterator[Record]:
        """The records of the suite."""
        return self.measure(replace(effort, seconds=self.share) if effort.shared else effort, progress)
