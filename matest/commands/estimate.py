"""The command `matest estimate`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from matest.commands import arguments
from matest.commands.console import console, print_json, progress
from matest.errors import InputError, WorkError
from matest.report.picture_size import PictureSize

if TYPE_CHECKING:
    from collections.abc import Sequence

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
    jobs: Annotated[int, typer.Option(metavar="N", min=1, help="Captures to estimate at once, a process each.")] = 1,
    memory: Annotated[
        str | None,
        typer.Option(metavar="SIZE", help="Memory of all processes together, as 4GB.", show_default=False),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS|local",
            help="Let the workers of a Dask scheduler do the captures, as tcp://host:8786; local: of this machine. A "
            "single capture is split over them.",
            show_default=False,
        ),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Keep results that are complete, of these options and unchanged files.")
    ] = False,
    as_json: arguments.Json = False,
) -> None:
    """Estimate the material of photographed objects, with error bars.

    The result goes to CAPTURE/matest (or OUT; with several captures OUT/<capture name>/ each, and summary.csv and
    summary.json): result.json, material.json, report.html, profile.csv and pictures. Each of several objects has a
    folder there by its name.
    """
    from matest import batch
    from matest.capture.description import capture_sources
    from matest.commands.captures import estimate_all
    from matest.estimation.specification import check_options
    from matest.pool import limited_memory

    if scheduler is not None and (jobs > 1 or memory is not None):
        raise InputError("--scheduler has its own workers and their memory: leave --jobs and --memory out.")
    options = arguments.options(
        model, fix, free, tie, transfer,
        holdout=arguments.indices(holdout), precision=precision, seed=seed, device=device,
        uncertainty=arguments.uncertainty(uncertainty), refine=() if refine is None else refine,
        maps=() if maps is None else maps,
        regions=regions,
        smooth_maps=smooth_maps,
    )  # fmt: skip
    check_options(options)
    root = arguments.root(captures[0], allow_outside)
    work = batch.jobs(captures, out, options, " ".join(["matest", *sys.argv[1:]]), pictures, root, resume)
    limit = arguments.size(memory)
    if len(captures) == 1:
        capture_sources(captures[0])
    if len(captures) > 1 or resume or scheduler is not None or min(jobs, len(work)) > 1:
        rows = estimate_all(work, out if len(captures) > 1 else None, jobs, limit, scheduler, as_json)
        if worst := max(row.exit_code for row in rows):
            raise typer.Exit(worst)
        return
    outcomes = []
    with limited_memory(limit):
        for job in work:
            with progress(job.label) as say:
                outcomes.append(batch.run(job, say))
    _print(outcomes, as_json)
    for outcome in outcomes:
        if outcome.lacks_memory and limit is not None:
            raise WorkError(batch.more_memory(outcome.job))
        if outcome.estimate is None:
            raise WorkError(outcome.error) if outcome.failed else InputError(outcome.error)


def _print(outcomes: Sequence[Outcome], as_json: bool) -> None:
    """The results of a capture, one for each object."""
    from matest.report.tables import estimate_table

    if as_json and len(outcomes) > 1:
        contents = ((outcome.job.label, outcome.estimate, outcome.error) for outcome in outcomes)
        print_json({label: estimate.to_dict() if estimate else {"error": error} for label, estimate, error in contents})
        return
    terminal = console()
    for outcome in outcomes:
        if outcome.estimate is None:
            continue
        if as_json:
            print_json(outcome.estimate.to_dict())
        else:
            place = outcome.job.out
            terminal.print(estimate_table(outcome.estimate))
            terminal.print(f"Result in {place} (open {place / 'report.html'})", soft_wrap=True)
