"""The command `matest export`."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from matest.commands import arguments
from matest.commands.console import console, note, print_json, progress
from matest.errors import InputError, nearest

EXAMPLE = "matest export renders/vase/matest --to gltf -o vase.glb"


def export(
    result: Annotated[Path, typer.Argument(help="A result folder of 'matest estimate' or 'matest fit'.")],
    to: Annotated[
        str,
        typer.Option(
            help="mitsuba: a BSDF in XML, with a Python plugin where Mitsuba lacks the lobes; materialx: nodes of its "
            "physically based library; gltf: metallic-roughness, on a sphere; merl: a table of the reflectance."
        ),
    ],
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="FILE", help="Where to write.", show_default=False)
    ] = None,
    fitted: Annotated[
        bool, typer.Option("--fitted", help="mitsuba: fit its own lobes instead of writing a Python plugin.")
    ] = False,
    as_json: arguments.Json = False,
) -> None:
    """Write an estimated material for another program, with the measured error of the conversion.

    A lobe that the other program has is converted to its conventions; otherwise its nearest one is fitted. Without -o
    the file lies beside the result folder, named like it.
    """
    from matest.estimation.result import load_material, material_is_relative
    from matest.export import TARGETS, mitsuba

    if to not in TARGETS:
        raise InputError(f"--to {to}: there is no such target; {nearest(to, TARGETS)}")
    if fitted and to != "mitsuba":
        raise InputError(f"--fitted goes with --to mitsuba: a conversion to {to} has no plugin; omit it.")
    target = TARGETS[to]
    folder = result if result.is_dir() else result.parent
    file = out or folder.with_name(folder.absolute().name + target.SUFFIX)
    material = load_material(result)
    if file.is_dir() or not file.absolute().parent.is_dir():
        raise InputError(f"{file}: expected a file name in an existing folder; give one with -o.")
    if file.exists() and file.suffix.lower() != target.SUFFIX:
        raise InputError(f"{file}: exists and is no {target.SUFFIX} file; give another name with -o.")
    with progress(str(result)) as say:
        say("writing")
        conversion = mitsuba.write(material, file, fitted=True) if fitted else target.write(material, file)
    if material_is_relative(result):
        note(f"the albedo in {result} is known up to a scale only, and so is the brightness of what was written.")
    if (folder / "maps").is_dir() and to == "merl":
        note(f"a table is of one reflectance: the mean of each of the maps in {folder} stands for it.")
    if (folder / "maps").is_dir():
        note(f"the maps of {result} do not travel: what was written has their means.")
    if as_json:
        content = {
            "file": str(file),
            "files": [str(each) for each in conversion.files],
            "target": to,
            "error": asdict(conversion.error),
            "parameters": dict(conversion.parameters),
            "notes": list(conversion.notes),
        }
        print_json(content)
        return
    lines = [
        f"Written to {' and '.join(map(str, conversion.files))}; error of the conversion {conversion.error}.",
        *conversion.notes,
        *(f"  {name} = {_text(value)}" for name, value in conversion.parameters.items()),
    ]
    console().print("\n".join(lines), soft_wrap=True)


def _text(value: object) -> str:
    """A number to four digits, or several."""
    if isinstance(value, list):
        return " ".join(map(_text, value))
    return f"{value:.4g}" if isinstance(value, float) else str(value)
