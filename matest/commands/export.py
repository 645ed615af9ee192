"""The command `matest export`."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from matest.commands import arguments
from matest.commands.console import console, note, print_json, progress
from matest.errors import InputError, nearest

EXAMPLE = "matest export renders/vase/matest --to merl -o vase.binary"


def export(
    result: Annotated[Path, typer.Argument(help="A result folder of 'matest estimate' or 'matest fit'.")],
    to: Annotated[str, typer.Option(help="merl: a table of the reflectance, for viewers of measured BRDFs.")],
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="FILE", help="Where to write.", show_default=False)
    ] = None,
    as_json: arguments.Json = False,
) -> None:
    """Write an estimated material for another program, with the measured error of the conversion.

    Without -o the file lies beside the result folder, named like it.
    """
    from matest.estimation.result import load_material, material_is_relative
    from matest.export import TARGETS

    if to not in TARGETS:
        raise InputError(f"--to {to}: there is no such target; {nearest(to, TARGETS)}")
    target = TARGETS[to]
    folder = result if result.is_dir() else result.parent
    file = out or folder.with_name(folder.absolute().name + target.SUFFIX)
    material = load_material(result)
    if file.is_dir() or not file.absolute().parent.is_dir():
        raise InputError(f"{file}: expected a file name in an existing folder; give one with -o.")
    with progress(str(result)) as say:
        say("writing")
        error = target.write(material, file)
    if material_is_relative(result):
        note(f"the albedo in {result} is known up to a scale only, and so is the brightness of what was written.")
    if (folder / "maps").is_dir() and to == "merl":
        note(f"a table is of one reflectance: the mean of each of the maps in {folder} stands for it.")
    if as_json:
        print_json({"file": str(file), "target": to, "error": asdict(error)})
        return
    console().print(
        f"Written to {file}; error of the conversion {error.relative_rmse:.2%} of the rms brightness, median "
        f"{error.median:.2%}.",
        soft_wrap=True,
    )
