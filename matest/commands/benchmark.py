"""The command `matest benchmark`."""

from __future__ import annotations

from typing import Annotated

import typer

from matest.benchmark import PEERS, RACES, SUITES, load, plan
from matest.commands import arguments
from matest.commands.console import console, print_json, progress
from matest.errors import WORK_FAILED

EXAMPLE = "matest benchmark --suite stress --quick"


def benchmark(
    suite: Annotated[
        str,
        typer.Option(metavar="NAME,...", help=f"Only these: {', '.join(SUITES)} (default: all).", show_default=False),
    ] = "",
    quick: Annotated[bool, typer.Option("--quick", help="Fewer and smaller: ten minutes for all suites.")] = False,
    against: Annotated[
        str,
        typer.Option(
            metavar="NAME,...",
            help=f"Race only these: {', '.join(PEERS)} (default: all). Without --suite: {' and '.join(RACES)}.",
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

    {suites}
    All together take half an hour: models, stress, efficiency and outliers then do as much as their share allows, and
    peers race on smaller photographs.
    With --json one line a figure.
    """
    from matest.benchmark.gate import expected, gate_table, worse

    names, effort = plan(suite, against, quick)
    figures = expected(quick, names) if gate else []
    all_records = []
    for name in names:
        suite_of_name, records = load(name), []
        with progress(name) as say:
            for record in suite_of_name.run(effort, say):
                records.append(record)
                if as_json:
                    print_json(record.to_dict())
        if not as_json:
            console().print(suite_of_name.table(records))
        all_records += records
    if gate:
        failed = worse(figures, all_records)
        console(stderr=as_json).print(gate_table(figures, failed))
        if failed:
            raise typer.Exit(WORK_FAILED)


benchmark.__doc__ = (benchmark.__doc__ or "").format(
    suites=" ".join(f"{name}: {measures}." for name, measures in SUITES.items())
)
