"""The command `matest predict`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import matest
from matest.commands import arguments
from matest.commands.console import console, note, print_json, progress
from matest.report.picture_size import PictureSize

EXAMPLE = "matest predict renders/vase/matest renders/vase -o prediction"


def predict(
    result: Annotated[Path, typer.Argument(help="A result folder of 'matest estimate'.")],
    capture: Annotated[Path, typer.Argument(help="The capture whose lights to use.")],
    out: arguments.Out = None,
    transfer: arguments.Transfer = None,
    pictures: arguments.Pictures = PictureSize.PREVIEW,
    as_json: arguments.Json = False,
) -> None:
    """Shade an estimated material under a capture's lights.

    Prints the error against each photograph; writes linear radiance (NN.exr), pictures and prediction.json to OUT
    (default: RESULT-predict-<capture name>).
    """
    from matest.batch import capture_name
    from matest.estimation.prediction import prediction_errors
    from matest.estimation.result import load_material, material_is_relative
    from matest.report.folder import check_destination, write_prediction

    material = load_material(result)
    folder = result if result.is_dir() else result.parent
    place = out or folder.with_name(f"{folder.name}-predict-{capture_name(capture)}")
    check_destination(place, "prediction.json")
    with progress(str(capture)) as say:
        photographs = matest.load_capture(capture, transfer=arguments.encoding(transfer), progress=say)
        say("shading")
        errors = prediction_errors(photographs, material)
        write_prediction(material, errors, photographs, place, pictures=pictures)
    if not photographs.relative and material_is_relative(result):
        note(f"the albedo in {result} is known up to a scale only, so brightness and errors here are off by that.")
    if as_json:
        by_image = dict(zip(photographs.names, errors.images, strict=True))
        print_json({"out": str(place), "relative_rmse": by_image, "pooled_relative_rmse": errors.pooled})
        return
    from matest.report.tables import prediction_table

    console().print(prediction_table(errors, photographs.names), f"Written to {place}")
