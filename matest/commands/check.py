"""The command `matest check`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from matest.commands import arguments
from matest.commands.console import console, print_json, progress

EXAMPLE = "matest check renders/vase --model oren-nayar --at sigma=0.5"


def check(
    capture: Annotated[Path, typer.Argument(metavar="CAPTURE", help="As for estimate, or a scene.toml.")],
    model: Annotated[
        str | None,
        typer.Option(
            help="A model or sum, see 'matest models'. Default: the scene's, else oren-nayar+cook-torrance.",
            show_default=False,
        ),
    ] = None,
    at: Annotated[
        list[str] | None, typer.Option(metavar="NAME=VALUE", help="Predict for this value of an estimated parameter.")
    ] = None,
    maps: Annotated[
        str | None,
        typer.Option(
            metavar="PARAM,...",
            help="Say what each number of the photographs allows of maps of these parameters: albedo,sigma.",
            show_default=False,
        ),
    ] = None,
    fix: arguments.Fix = None,
    free: arguments.Free = None,
    tie: arguments.Tie = None,
    noise: Annotated[
        str | None,
        typer.Option(
            metavar="READ,GAIN", help="Camera noise, fractions of full scale: variance = READ² + GAIN·signal."
        ),
    ] = None,
    transfer: arguments.Transfer = None,
    uncertainty: arguments.UncertaintyOf = None,
    name: arguments.Object = None,
    allow_outside: arguments.AllowOutside = False,
    as_json: arguments.Json = False,
) -> None:
    """Say before any fit how a capture is understood and what its images can tell of a model.

    The standard error that each parameter will get, predicted from geometry, lights, noise and what is stated of the
    calibration; what stays undetermined, and why; what errors of the calibration would do, and which limits what; and
    the direction of one more light that would help most. The photographs need not exist.
    """
    from matest import identifiability

    stated = arguments.uncertainty(uncertainty)
    options = arguments.options(model, fix, free, tie, transfer, uncertainty=stated, maps=() if maps is None else maps)
    assumed = dict(arguments.assignment(text, "--at") for text in at or [])
    camera_noise = None if noise is None else arguments.noise(noise)
    with progress(str(capture)) as say:
        root = arguments.root(capture, allow_outside)
        plan = identifiability.load_plan(capture, transfer=options.transfer, root=root, name=name, progress=say)
        plan = plan if camera_noise is None else plan.with_noise(*camera_noise)
        prediction = identifiability.check_with(plan, options, assumed, say)
    if as_json:
        print_json(prediction.to_dict())
        return
    from matest.report.identifiability import check_report

    console().print(check_report(prediction))
