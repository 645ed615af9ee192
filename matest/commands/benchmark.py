"""The command `matest benchmark`."""

from __future__ import annotations

from typing import Annotated

import typer

from matest.commands import arguments
from matest.commands.console import console, print_json, progress
from matest.errors import WORK_FAILED

EXAMPLE = "matest benchmark --suite stress --quick"


def benchmark(
    suite: Annotated[
        str,
        typer.Option(
            metavar="NAME,...",
            help="Only these: models, stress, efficiency, outliers, estimate, peers, frontier, scaling, memory, "
            "start (default: all).",
            show_default=False,
        ),
    ] = "",
    quick: Annotated[bool, typer.Option("--quick", help="Fewer and smaller: two minutes for all suites.")] = False,
    against: Annotated[
        str,
        typer.Option(
            metavar="NAME,...",
            help="Race only these: adam, l-bfgs, least_squares, levenberg-marquardt, mitsuba, dr.jit (default: all). "
            "Without --suite: peers and frontier.",
            show_default=False,
        ),
    ] = "",
    gate: Annotated[
        bool,
        typer.Option("--gate", help="Compare with tests/benchmark_baseline.json; exit code 1 if anything is worse."),
    ] = False,
    as_json: arguments.Json = False,
) -> None:
    """Measure run time and error of the reflectance models and of the estimator.

    models: values and gradients at a million pairs of directions, against one element-wise pass. stress: non-finite
    results at ten million adversarial points a model, and float32 against float64. efficiency: errors on 2,000
    simulated captures a model against the Cramér-Rao bound. outliers: the same with spoilt pixels. estimate: time of
    12 photographs of a megapixel against decoding them. peers: time to 1 % against other solvers. frontier: error of
    every solver over time. scaling: growth of the time with pixels, images and parameters. memory: peak of 12 and of
    120 photographs. start: fresh processes.
    All together take half an hour: models, stress, efficiency and outliers then do as much as their share allows, and
    peers race on smaller photographs.
    With --json one line a figure.
    """
    from matest.benchmark import suites
    from matest.benchmark.gate import expected, gate_table, worse

    chosen = suites(suite, against)
    figures = expected(quick, chosen) if gate else []
    found = []
    for name, one in chosen.items():
        records = []
        with progress(name) as say:
            for record in one.run(quick, say):
                records.append(record)
                if as_json:
                    print_json(record.to_dict())
        if not as_json:
            console().print(one.table(records))
        found += records
    if gate:
        failed = worse(figures, found)
        console(stderr=as_json).print(gate_table(figures, failed))
        if failed:
            raise typer.Exit(WORK_FAILED)
