"""The command `matest init`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from matest.commands import arguments
from matest.commands.console import console, note, print_json, progress

EXAMPLE = "matest init coin --transfer srgb"


def init(
    folder: Annotated[
        Path, typer.Argument(metavar="FOLDER", help="Photographs with a list of lights and a shape, or that list.")
    ],
    transfer: arguments.Transfer = None,
    as_json: arguments.Json = False,
) -> None:
    """Write the capture.toml of a folder.

    The folder is read as 'matest estimate' reads it: DiLiGenT (light_directions.txt), RTI (.lp, .dome), with a normal
    map, a mesh or the mask of a sphere beside the photographs. What the files say is not asked, and what they leave
    open is said. A capture.toml that is there is never written over.
    """
    from matest.capture.initial import initialise

    with progress(str(folder)) as say:
        written = initialise(folder, transfer=arguments.encoding(transfer), progress=say)
    if as_json:
        print_json({"file": str(written.file), "understood": written.understood, "notes": written.notes})
        return
    if written.understood:
        from matest.report.identifiability import understanding_table

        console().print(understanding_table(written.file.absolute().parent.name, written.understood))
    for sentence in written.notes:
        note(sentence)
    console().print(f"Written to {written.file}", soft_wrap=True)
