"""The command `matest estimate`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from matest.commands import arguments
from matest.commands.console import console, print_json, progress
from matest.errors import InputError, WorkError, printable
from matest.report.picture_size import PictureSize

if TYPE_CHECKING:
    from matest.batch import Outcome

EXAMPLE = "matest estimate renders/vase --model oren-nayar"


def estimate(
    captures: Annotated[
        list[Path], typer.Argument(metavar="CAPTURE...", help="Folders with a capture.toml, or of DiLiGenT or RTI.")
    ],
    out: arguments.Out = None,
    model: arguments.Model = "auto",
    fix: arguments.Fix = None,
    free: arguments.Free = None,
    tie: arguments.Tie = None,
    holdout: Annotated[str, typer.Option(metavar="INDEX,...", help="Images to leave out of the fit.")] = "",
    precision: Annotated[
        float | None,
        typer.Option(metavar="R", help="Stop once every relative standard error is below R.", show_default=False),
    ] = None,
    transfer: arguments.Transfer = None,
    uncertainty: arguments.UncertaintyOf = None,
    refine: arguments.Refine = None,
    maps: Annotated[
        str | None,
        typer.Option(
            metavar="PARAM,...",
            help="Parameters with a value at every pixel: albedo,sigma; written to maps/.",
            show_default=False,
        ),
    ] = None,
    regions: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="Regions whose values pixels take that do not tell their own. Default: as many as stand apart.",
            show_default=False,
        ),
    ] = None,
    smooth_maps: Annotated[
        int,
        typer.Option(
            metavar="RADIUS", help="Radius in pixels of a filter of the map; written beside it.", show_default=False
        ),
    ] = 0,
    seed: arguments.Seed = 0,
    allow_outside: arguments.AllowOutside = False,
    device: Annotated[str, typer.Option(help="Where to compute: cpu, cuda.")] = "cpu",
    pictures: arguments.Pictures = PictureSize.PREVIEW,
    as_json: arguments.Json = False,
) -> None:
    """Estimate the material of photographed objects, with error bars.

    The result goes to CAPTURE/matest (or OUT; with several captures OUT/<capture name>/ each): result.json,
    material.json, report.html, profile.csv and pictures. Each of several objects has a folder there by its name.
    """
    from matest import batch
    from matest.capture.description import capture_sources
    from matest.estimation.specification import check_options

    options = arguments.options(
        model, fix, free, tie, transfer,
        holdout=arguments.indices(holdout), precision=precision, seed=seed, device=device,
        uncertainty=arguments.uncertainty(uncertainty), refine=() if refine is None else refine,
        maps=() if maps is None else maps,
        regions=regions,
        smooth_maps=smooth_maps,
    )  # fmt: skip
    check_options(options)
    jobs = batch.jobs(
        captures,
        out,
        options,
        " ".join(["matest", *sys.argv[1:]]),
        pictures,
        arguments.root(captures[0], allow_outside),
    )
    if len(captures) == 1:
        capture_sources(captures[0])
    outcomes = []
    for job in jobs:
        with progress(job.label) as say:
            outcomes.append(batch.run(job, say))
    if len(outcomes) == 1 and (error := outcomes[0].error):
        raise WorkError(error) if outcomes[0].failed else InputError(error)
    if as_json:
        _print_as_json(outcomes)
    else:
        _print_tables(outcomes)
    if worst := max(outcome.exit_code for outcome in outcomes):
        raise typer.Exit(worst)


def _print_as_json(outcomes: Sequence[Outcome]) -> None:
    plain = {
        outcome.job.label: outcome.estimate.to_dict() if outcome.estimate else {"error": outcome.error}
        for outcome in outcomes
    }
    print_json(next(iter(plain.values())) if len(plain) == 1 else plain)


def _print_tables(outcomes: Sequence[Outcome]) -> None:
    from matest.report.tables import estimate_table, summary_table

    terminal = console()
    for outcome in outcomes:
        if outcome.estimate is None:
            typer.echo(f"matest: {printable(outcome.error)}", err=True)
        else:
            place = outcome.job.out
            terminal.print(estimate_table(outcome.estimate))
            terminal.print(f"Result in {place} (open {place / 'report.html'})", soft_wrap=True)
    if len(outcomes) > 1:
        terminal.print(summary_table({outcome.job.label: outcome.estimate or outcome.error for outcome in outcomes}))
