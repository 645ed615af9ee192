"""The command `matest predict`."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import matest
from matest.commands import arguments
from matest.commands.console import console, note, print_json, progress
from matest.report.picture_size import PictureSize

if TYPE_CHECKING:
    from matest.brdf import Brdf
    from matest.capture import Capture
    from matest.estimation.parameter_map import ParameterMap

EXAMPLE = "matest predict renders/vase/matest renders/vase -o prediction"


def predict(
    result: Annotated[Path, typer.Argument(help="A result folder of 'matest estimate'.")],
    capture: Annotated[Path, typer.Argument(help="The capture whose lights to use.")],
    out: arguments.Out = None,
    transfer: arguments.Transfer = None,
    pictures: arguments.Pictures = PictureSize.PREVIEW,
    name: arguments.Object = None,
    allow_outside: arguments.AllowOutside = False,
    as_json: arguments.Json = False,
) -> None:
    """Shade an estimated material under a capture's lights.

    Prints the error against each photograph; writes linear radiance (NN.exr), pictures and prediction.json to OUT
    (default: RESULT-predict-<capture name>). Where the result has maps and the capture shows the object from the same
    view, every pixel has its own values. Of several objects that is shaded which has the name of the result's.
    """
    from matest.batch import capture_name
    from matest.estimation.prediction import prediction_errors
    from matest.estimation.result import load_material, material_is_relative
    from matest.report.folder import check_destination, write_prediction

    material = load_material(result)
    # A folder named by a dot has a name all the same.
    folder = (result if result.is_dir() else result.parent).absolute()
    folder = Path(os.path.normpath(folder))
    place = out or folder.with_name(f"{folder.name}-predict-{capture_name(capture)}")
    check_destination(place, "prediction.json")
    with progress(str(capture)) as say:
        photographs = matest.load_capture(
            capture,
            transfer=arguments.encoding(transfer),
            root=arguments.root(capture, allow_outside),
            progress=say,
        )
        photographs = photographs.object(name or _object(folder, photographs))
        material, maps = _with_maps(material, result, photographs)
        say("shading")
        errors = prediction_errors(photographs, material)
        write_prediction(material, errors, photographs, place, pictures=pictures, maps=maps)
    if not photographs.relative and material_is_relative(result):
        note(f"the albedo in {result} is known up to a scale only, so brightness and errors here are off by that.")
    if as_json:
        print_json(
            {
                "out": str(place),
                "relative_rmse": dict(zip(photographs.names, errors.images, strict=True)),
                "pooled_relative_rmse": errors.pooled,
                "median_error": dict(zip(photographs.names, errors.medians, strict=True)),
                "pooled_median_error": errors.pooled_median,
                "maps": [*maps],
            }
        )
        return
    from matest.report.tables import prediction_table

    console().print(prediction_table(errors, photographs.names), *_shaded_as(maps), f"Written to {place}", sep="\n")


def _object(result: Path, capture: Capture) -> str | None:
    """The object that a result is of, if a capture shows several and one of that name."""
    from matest.estimation.result import read_result

    if not capture.objects:
        return None
    name = read_result(result)["provenance"].get("object")
    return name if name in capture.objects else None


def _with_maps(material: Brdf, result: Path, capture: Capture) -> tuple[Brdf, dict[str, ParameterMap]]:
    """The material with the maps of a result, and these maps; a note says where they are of another view.

    Their means take their place there.
    """
    from matest.estimation.parameter_map import with_maps
    from matest.report.maps import load_maps, view_difference

    surface = capture.scene.surface
    if difference := view_difference(result, surface):
        note(f"{difference}. Maps belong to the view they were estimated in: their means are used instead.")
        return material, {}
    maps = load_maps(result, surface)
    return with_maps(material, maps), maps


def _shaded_as(maps: Mapping[str, ParameterMap]) -> list[str]:
    """What has a value of its own at every pixel, as a sentence; nothing where nothing has."""
    from matest.estimation.parameter_map import TexelStatus

    if not maps:
        return []
    sentence = f"Every pixel is shaded with its own {' and '.join(maps)}"
    unseen = max(each.shares[TexelStatus.UNSEEN] for each in maps.values())
    return [
        f"{sentence}; {unseen:.1%} of them, of which the maps have no value, take the mean."
        if unseen
        else f"{sentence}."
    ]
