"""Benchmarks: figures of run time and of error, measured in one run, one record each."""

from __future__ import annotations

from collections.abc import Collection
from importlib import import_module

from matest.benchmark.suite import PEERS, Effort, Record, Suite
from matest.errors import InputError, nearest

# Names of the suites, and what each measures, for the help. The suite is the `SUITE` of the file of its name in
# `suites/`. That file is imported when the suite runs: it needs torch, the help must not.
SUITES = {
    "models": "values and gradients at a million pairs of directions, against one element-wise pass",
    "stress": "non-finite results at ten million adversarial points a model, and float32 against float64",
    "efficiency": "errors on 2,000 simulated captures a model against the Cramér-Rao bound",
    "outliers": "the same with spoilt pixels",
    "selection": "the components that auto finds, and its time against naming the model",
    "calibration": "errors that a calibration off by little causes: as they are, stated, and estimated",
    "diagnosis": "whether what is wrong with a capture is named",
    "maps": "values at every pixel: time and memory, errors, error bars, and Adam at the same",
    "estimate": "time of 12 photographs of a megapixel against decoding them",
    "peers": "time to 1 % against other solvers",
    "frontier": "error of every solver over time",
    "scaling": "growth of the time with pixels, images and parameters",
    "memory": "peak of 12 and of 120 photographs",
    "start": "fresh processes",
    "fuzz": "damaged files for every reader",
    "command": "the whole command on captures that state no noise, against decoding",
    "export": "what conversions to other programs cost, and what Mitsuba renders of them beside our shader",
    "faults": "what killed processes, full disks and vanishing files leave of results",
}
# Suites that race the peers.
RACES = ("peers", "frontier")
# The suite that comes first in every run: the limits of the machine, which other suites compare with.
FIRST = "limits"


def load(name: str) -> Suite:
    """The suite of a name."""
    return import_module(f"{__name__}.suites.{name}").SUITE


def plan(suites: str, against: str = "", quick: bool = False) -> tuple[list[str], Effort]:
    """What to run: names of suites, the limits of the machine first, and how much of each.

    Args:
        suites: names, separated by commas; empty: all suites.
        against: names of the peers that `peers` and `frontier` race; empty: all peers. With peers but without
            suites, these two run.
        quick: fewer and smaller measurements.

    Raises:
        InputError: an unknown name.
    """
    peers = _listed(against, PEERS, "peer")
    names = _listed(suites, SUITES, "suite") or (list(RACES) if peers else [])
    if peers and not {*names} & {*RACES}:
        raise InputError(f"--against goes with --suite {' or '.join(RACES)}; got --suite {suites}.")
    effort = Effort(quick, shared=not names and not quick, against=tuple(peers) or PEERS)
    return [FIRST, *(names or SUITES)], effort


def _listed(text: str, catalogue: Collection[str], what: str) -> list[str]:
    names = [name.strip() for name in text.split(",") if name.strip()]
    for name in names:
        if name not in catalogue:
            raise InputError(f"unknown {what} '{name}'; {nearest(name, catalogue)}")
    return list(dict.fromkeys(names))


__all__ = ["FIRST", "PEERS", "RACES", "SUITES", "Effort", "Record", "Suite", "load", "plan"]
