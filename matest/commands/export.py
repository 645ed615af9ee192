"""The command `matest export`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from matest.commands import arguments
from matest.commands.console import console, note, print_json, progress
from matest.errors import InputError, nearest
from matest.outputs import keep_inputs
from matest.progress import Progress

if TYPE_CHECKING:
    from matest.commands.texturing import Merged
    from matest.export.conversion import Conversion
    from matest.export.textured import Textured

EXAMPLE = "matest export renders/vase/matest --to gltf -o vase.glb"
# Plain images of maps, without a material.
_TEXTURES = "textures"
# Targets that textures are written for.
_TEXTURED = ("gltf", "mitsuba", _TEXTURES)
# Largest side of a texture.
_LARGEST = 16_384
# What every file but a table has among so many bytes at its beginning.
_MARK, _MARKED = b"matest", 1 << 16


def export(
    results: Annotated[
        list[Path],
        typer.Argument(
            metavar="RESULT",
            help="A result folder of 'matest estimate' or 'matest fit'; with maps, several views of one mesh.",
        ),
    ],
    to: Annotated[
        str,
        typer.Option(
            help="mitsuba: a BSDF in XML, with a Python plugin where Mitsuba lacks the lobes; materialx: nodes of its "
            "physically based library; gltf: metallic-roughness, on a sphere; merl: a table of the reflectance. Maps "
            "of a capture with a mesh become textures on it in mitsuba and gltf; textures: these alone, with error "
            "bars."
        ),
    ],
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="FILE", help="Where to write.", show_default=False)
    ] = None,
    fitted: Annotated[
        bool, typer.Option("--fitted", help="mitsuba: fit its own lobes instead of writing a Python plugin.")
    ] = False,
    size: Annotated[
        int | None,
        typer.Option(metavar="N", help="Texels a side of textures; default: about the pixels'.", show_default=False),
    ] = None,
    as_json: arguments.Json = False,
) -> None:
    """Write an estimated material for another program, with the measured error of the conversion.

    A lobe that the other program has is converted to its conventions; otherwise its nearest one is fitted. Without -o
    the file lies beside the result folder, named like it. It replaces that of an earlier export and no other.
    """
    from matest.estimation.result import material_is_relative, not_determined
    from matest.export import TARGETS

    if to not in (*TARGETS, _TEXTURES):
        raise InputError(f"--to {to}: there is no such target; {nearest(to, (*TARGETS, _TEXTURES))}")
    if fitted and to != "mitsuba":
        raise InputError(f"--fitted goes with --to mitsuba: a conversion to {to} has no plugin; omit it.")
    _check_textures(results, to, size, fitted=fitted)
    result = results[0]
    folder = result if result.is_dir() else result.parent
    # A folder that is named by dots alone has its name elsewhere.
    folder = folder if folder.name.strip(".") else folder.resolve()
    with progress(str(result)) as say:
        if to == _TEXTURES:
            content, lines = _write_textures(results, out or folder.with_name(f"{folder.name}-textures"), size, say)
        else:
            file = out or folder.with_name(folder.name + TARGETS[to].SUFFIX)
            if file.is_dir() or not file.absolute().parent.is_dir():
                raise InputError(
                    f"{file}: expected a file name in a folder that exists; make it, or give another with -o."
                )
            _keep_others(file)
            conversion, merged = _write(results, to, file, size, say, fitted=fitted)
            content, lines = _content(conversion, file, to, merged), _lines(conversion, merged)
    for each in results:
        if names := not_determined(each):
            note(f"{each} does not determine {', '.join(names)}: what was written for them may be far off.")
    if all(map(material_is_relative, results)):
        note(f"the albedo in {result} is known up to a scale only, and so is the brightness of what was written.")
    if as_json:
        print_json(content)
    else:
        console().print("\n".join(lines), soft_wrap=True)


def _check_textures(results: Sequence[Path], to: str, size: int | None, *, fitted: bool) -> None:
    """Refuse several results and sizes where no textures are written.

    Raises:
        InputError: there are some.
    """
    if len(results) > 1 and to not in _TEXTURED:
        raise InputError(
            f"--to {to} writes one result; several, which are views of one mesh, go with gltf, mitsuba or textures."
        )
    if fitted and (len(results) > 1 or size is not None):
        raise InputError("--fitted writes no textures: give one result without --size, or omit --fitted.")
    if size is not None and to not in _TEXTURED:
        raise InputError(f"--size is that of textures, and --to {to} has none; omit it.")
    if size is not None and not 1 <= size <= _LARGEST:
        raise InputError(f"--size is a number of texels from 1 to {_LARGEST}, such as 1024; got {size}.")


def _keep_others(file: Path) -> None:
    """Refuse to replace a file that is not from an earlier export, which names matest near its beginning.

    Raises:
        InputError: there is one. A measured table says nothing of where it is from.
    """
    if not file.exists():
        return
    earlier = False
    if file.is_file():
        with file.open("rb") as stream:
            earlier = _MARK in stream.read(_MARKED)
    if not earlier:
        raise InputError(
            f"{file}: exists and may not be from an earlier export; remove it, or write elsewhere with -o."
        )


def _write_textures(
    results: Sequence[Path], folder: Path, size: int | None, say: Progress
) -> tuple[dict[str, Any], list[str]]:
    """Write the maps of results as plain textures: what that gives as JSON and as lines.

    Raises:
        InputError: the folder is a result, or the results cannot be put on a mesh.
    """
    from matest.commands.texturing import merge_results
    from matest.export.textured import MESH, write_folder

    if folder.is_file() or (folder / "result.json").exists():
        raise InputError(f"{folder}: expected a folder for textures, which is no result; give another with -o.")
    merged = merge_results(results, size, say)
    keep_inputs([folder / MESH], merged.files)
    say("writing")
    files = write_folder(merged.textured, folder)
    content = {"out": str(folder), "files": [str(each) for each in files], "target": _TEXTURES, "notes": merged.notes}
    lines = [f"Written to {folder}: {', '.join(each.name for each in files)}.", *merged.notes]
    return content | _coverage(merged.textured), lines


def _write(
    results: Sequence[Path], to: str, file: Path, size: int | None, say: Progress, *, fitted: bool
) -> tuple[Conversion, Merged | None]:
    """Write a material for another program, with textures where it has maps and a mesh, which come back too.

    Raises:
        InputError: the material cannot be converted, or several results cannot be put on a mesh.
    """
    from matest.commands.texturing import merge_results
    from matest.estimation.result import load_material
    from matest.export import TARGETS, gltf, mitsuba
    from matest.report.maps import has_maps

    folder = results[0] if results[0].is_dir() else results[0].parent
    mapped, merged = has_maps(folder), None
    if (mapped or len(results) > 1) and to in _TEXTURED and not fitted:
        try:
            merged = merge_results(results, size, say)
        except InputError as error:
            # The maps of one result have means that stand for them.
            if len(results) > 1 or size is not None:
                raise
            note(f"{error} What was written has the means of its maps.")
    elif size is not None:
        raise InputError(f"{folder}: has no maps that become textures, so that --size has no meaning; omit it.")
    elif mapped:
        why = "a table is of one reflectance" if to == "merl" else f"the maps of {folder} do not travel"
        note(f"{why}: what was written has their means.")
    say("writing")
    if merged is not None:
        target = gltf if to == "gltf" else mitsuba
        if to == "mitsuba" and not file.exists():
            _keep_others(file.with_suffix(mitsuba.MESH_SUFFIX))
        keep_inputs([file, file.with_suffix(mitsuba.MESH_SUFFIX)], merged.files)
        return target.write(merged.textured.material, file, textured=merged.textured), merged
    material = load_material(results[0])
    return (mitsuba.write(material, file, fitted=True) if fitted else TARGETS[to].write(material, file)), None


def _coverage(material: Textured) -> dict[str, Any]:
    """What textures cover, as JSON."""
    return {"texels": material.size, "coverage": asdict(material.coverage)}


def _content(conversion: Conversion, file: Path, to: str, merged: Merged | None) -> dict[str, Any]:
    """What was written, as JSON."""
    content = {
        "file": str(file),
        "files": [str(each) for each in conversion.files],
        "target": to,
        "error": asdict(conversion.error),
        "parameters": dict(conversion.parameters),
        "notes": [*conversion.notes, *(merged.notes if merged else ())],
    }
    return content | (_coverage(merged.textured) if merged else {})


def _lines(conversion: Conversion, merged: Merged | None) -> list[str]:
    """What was written, as lines."""
    return [
        f"Written to {_and(conversion.files)}; error of the conversion {conversion.error}.",
        *(merged.notes if merged else ()),
        *conversion.notes,
        *(f"  {name} = {_text(value)}" for name, value in conversion.parameters.items()),
    ]


def _text(value: object) -> str:
    """A number to four digits, or several."""
    if isinstance(value, list):
        return " ".join(map(_text, value))
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _and(files: Sequence[Path]) -> str:
    """Names of files as one reads them."""
    *most, last = map(str, files)
    return f"{', '.join(most)} and {last}" if most else last
