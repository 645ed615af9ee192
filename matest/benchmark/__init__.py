"""Benchmarks: figures of run time and of error, measured in one run, one record each."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from functools import partial
from typing import NamedTuple

from rich.console import RenderableType

from matest.benchmark import tables
from matest.benchmark.record import Progress, Record
from matest.benchmark.rivals import solvers
from matest.benchmark.suites import (
    efficiency,
    estimate,
    frontier,
    limits,
    memory,
    models,
    outliers,
    peers,
    scaling,
    start,
    stress,
)
from matest.errors import InputError, nearest


class Suite(NamedTuple):
    """`run(quick, progress)` yields the records of a suite, `table(records)` shows them.

    A full run of all suites gives one that could go on for hours `seconds` of its half hour, as `within(seconds,
    progress)`.
    """

    run: Callable[[bool, Progress], Iterator[Record]]
    table: Callable[[list[Record]], RenderableType]
    within: Callable[[float, Progress], Iterator[Record]] | None = None
    seconds: float = 0.0


SUITES = {
    "models": Suite(models.run, tables.models_table, models.within, 200),
    "stress": Suite(stress.run, tables.stress_table, stress.within, 150),
    "efficiency": Suite(efficiency.run, efficiency.efficiency_table, efficiency.within, 180),
    "outliers": Suite(outliers.run, outliers.outliers_table, outliers.within, 120),
    "estimate": Suite(estimate.run, estimate.estimate_table),
    "peers": Suite(peers.run, peers.peers_table, peers.within, 300),
    "frontier": Suite(frontier.run, frontier.frontier_table),
    "scaling": Suite(scaling.run, scaling.scaling_table),
    "memory": Suite(memory.run, memory.memory_table),
    "start": Suite(start.run, start.start_table),
}


# Suites that peers take part in.
RACES = {"peers": peers.run, "frontier": frontier.run}


def suites(text: str, against: str = "") -> dict[str, Suite]:
    """The suites named in `text`, separated by commas; all of them if it is empty. The limits of the machine go first.

    Args:
        text: names of suites.
        against: names of the peers that `peers` and `frontier` race; all of them if it is empty. These are the only
            suites then that run without being named.

    Raises:
        InputError: an unknown name.
    """
    raced = _named(against, solvers.PEERS, "peer")
    names = _named(text, SUITES, "suite") or (list(RACES) if raced else [])
    if raced and not {*names} & {*RACES}:
        raise InputError(f"--against goes with --suite {' or '.join(RACES)}; got --suite {text}.")
    chosen = {name: SUITES[name] for name in names}
    for name in RACES if raced else ():
        if name in chosen:
            chosen[name] = chosen[name]._replace(run=partial(RACES[name], against=raced))
    if not names:
        chosen = {name: suite._replace(run=_shared(suite)) for name, suite in SUITES.items()}
    return {"limits": Suite(limits.run, limits.limits_table), **chosen}


def _named(text: str, known: Collection[str], what: str) -> list[str]:
    names = [name.strip() for name in text.split(",") if name.strip()]
    for name in names:
        if name not in known:
            raise InputError(f"unknown {what} '{name}'; {nearest(name, known)}")
    return names


def _shared(suite: Suite) -> Callable[[bool, Progress], Iterator[Record]]:
    """`run` as one of all suites."""

    def run(quick: bool, progress: Progress) -> Iterator[Record]:
        if quick or suite.within is None:
            return suite.run(quick, progress)
        return suite.within(suite.seconds, progress)

    return run


__all__ = ["SUITES", "Record", "Suite", "suites"]
