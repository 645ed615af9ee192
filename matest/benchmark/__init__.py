"""Benchmarks: figures of run time and of error, measured in one run, one record each."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

from rich.console import RenderableType

from matest.benchmark import efficiency, estimate, memory, models, outliers, peers, stress, tables
from matest.benchmark.record import Progress, Record
from matest.errors import InputError, nearest


class Suite(NamedTuple):
    """`run(quick, progress)` yields the records of a suite, `table(records)` shows them."""

    run: Callable[[bool, Progress], Iterator[Record]]
    table: Callable[[list[Record]], RenderableType]


SUITES = {
    "models": Suite(models.run, tables.models_table),
    "stress": Suite(stress.run, tables.stress_table),
    "efficiency": Suite(efficiency.run, efficiency.efficiency_table),
    "outliers": Suite(outliers.run, outliers.outliers_table),
    "estimate": Suite(estimate.run, estimate.estimate_table),
    "peers": Suite(peers.run, peers.peers_table),
    "memory": Suite(memory.run, memory.memory_table),
}


def suites(text: str) -> dict[str, Suite]:
    """The suites named in `text`, separated by commas; all of them if it is empty.

    Raises:
        InputError: an unknown name.
    """
    names = [name.strip() for name in text.split(",") if name.strip()] or list(SUITES)
    for name in names:
        if name not in SUITES:
            raise InputError(f"unknown suite '{name}'; {nearest(name, SUITES)}")
    return {name: SUITES[name] for name in names}


__all__ = ["SUITES", "Record", "Suite", "suites"]
