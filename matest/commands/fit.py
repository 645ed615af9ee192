"""The command `matest fit`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from matest.commands import arguments
from matest.commands.console import console, print_json, progress

EXAMPLE = "matest fit krylon_blue.brdf --model lambert+cook-torrance -o krylon_blue"


def fit(
    table: Annotated[Path, typer.Argument(help="A measured BRDF: MERL .binary, Cornell .brdf, or .csv.")],
    out: arguments.Out = None,
    model: arguments.Model = "auto",
    fix: arguments.Fix = None,
    free: arguments.Free = None,
    tie: arguments.Tie = None,
    loss: Annotated[str, typer.Option(help="likelihood, li-torrance (their eq. 15), log or cube-root.")] = "likelihood",
    noise: Annotated[
        str | None,
        typer.Option(
            metavar="R[,FLOOR]", help="Noise of the values: relative, and a floor in 1/sr. Default: estimated."
        ),
    ] = None,
    channels: Annotated[
        str, typer.Option(help="Of a spectral table: all, rgb, or wavelengths as 450,550 (nm).")
    ] = "all",
    units: Annotated[str | None, typer.Option(help="Angles of a CSV table: rad or deg.")] = None,
    azimuth: Annotated[
        str | None, typer.Option(help="Side where phi_r = phi_i in a CSV table: retro (the light's) or forward.")
    ] = None,
    quantity: Annotated[str | None, typer.Option(help="Values of a CSV table: f, pi-f or f-cos.")] = None,
    seed: arguments.Seed = 0,
    as_json: arguments.Json = False,
) -> None:
    """Fit a model to a measured BRDF, with error bars.

    The result goes to OUT (default: TABLE without its suffix, with -fit): result.json, material.json, report.html and
    pictures: error by incidence, slices in the plane of incidence, estimates with their correlation.
    """
    from matest.estimation.table_fit import fit_table_with
    from matest.report.folder import check_destination
    from matest.report.table_folder import write_fit
    from matest.tables import Declaration, load_table
    from matest.tables.loss import Loss

    options = arguments.options(model, fix, free, tie, None, seed=seed)
    stated = None if noise is None else arguments.table_noise(noise)
    cost = arguments.choice(loss, Loss, "--loss")
    declaration = Declaration(
        units=units, azimuth=azimuth, quantity=quantity, channels=channels  # type: ignore[arg-type]
    )  # fmt: skip
    place = out or table.with_name(f"{table.stem}-fit")
    check_destination(place, "result.json")
    with progress(str(table)) as say:
        say("reading")
        measured = load_table(table, declaration)
        result = fit_table_with(measured, options, cost, stated, say)
        result = write_fit(result, place, " ".join(["matest", *sys.argv[1:]]), say)
    if as_json:
        print_json(result.to_dict())
        return
    from matest.report.tables import fit_table

    console().print(fit_table(result))
    console().print(f"Result in {place} (open {place / 'report.html'})", soft_wrap=True)
