"""Files of a folder by their names, as the layouts look for them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path, PureWindowsPath

import msgspec

from matest.capture.schema import CameraTable, CaptureFile, GeometryTable
from matest.errors import InputError
from matest.photographs.readers import READERS

# Names of normal maps without their suffix, in lower case, the measured ones first.
_NORMALS = ("normal_gt", "normals", "normal", "normal_map", "normalmap")
# Suffixes of normal maps, the exact ones first: pictures of eight bits lie beside arrays of floats.
_EXACT_FIRST = (".mat", ".exr", ".npy", *READERS)
# Names of masks without their suffix.
_MASKS = ("mask",)
# Suffixes of meshes.
_MESHES = (".ply", ".obj", ".stl", ".glb", ".gltf", ".off")
# Files and folders with cameras of other programs.
_CAMERAS = ("transforms.json", "sparse/0", "sparse")
# Names that a sentence lists, at most.
_SOME = 3


def files_by_name(folder: Path) -> dict[str, Path]:
    """Files of a folder by their names in lower case, in the order of their names; hidden ones are left out."""
    if not folder.is_dir():
        return {}
    return {file.name.lower(): file for file in sorted(folder.iterdir()) if file.is_file() and file.name[0] != "."}


def is_file(path: Path) -> bool:
    """Whether a path leads to a regular file; none that is too long, or has a NUL, does."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def list_of_lights(path: Path, suffix: str) -> tuple[Path, ...]:
    """The one file with a suffix in a folder, or a file that has it; empty where there is none.

    Raises:
        InputError: there are several.
    """
    files = [path] if path.is_file() else [*files_by_name(path).values()]
    lists = [file for file in files if file.suffix.lower() == suffix]
    if len(lists) > 1:
        raise InputError(f"{path}: holds several lists of lights ({some(lists)}); give one of them, not the folder.")
    return tuple(lists)


def normal_map(folder: Path) -> Path | None:
    """The normal map of a folder."""
    return _first(folder, _NORMALS, _EXACT_FIRST)


def mask(folder: Path) -> Path | None:
    """The mask of a folder."""
    return _first(folder, _MASKS, tuple(READERS))


def mesh(folder: Path) -> Path | None:
    """The mesh of a folder.

    Raises:
        InputError: there are several.
    """
    meshes = [file for file in files_by_name(folder).values() if file.suffix.lower() in _MESHES]
    if len(meshes) > 1:
        raise InputError(
            f"{folder}: expected one mesh; got {some(meshes)}. Leave the one that the photographs show in the folder."
        )
    return meshes[0] if meshes else None


def geometry(folder: Path, spheres: bool = True) -> GeometryTable:
    """The geometry that the files of a folder give: a normal map, a mesh, or the sphere whose outline the mask is.

    Args:
        folder: of the photographs.
        spheres: whether a mask alone may be the outline of a sphere.

    Raises:
        InputError: there is none, or several meshes.
    """
    if normals := normal_map(folder):
        return GeometryTable(normals=normals.name)
    if shape := mesh(folder):
        return GeometryTable(mesh=shape.name)
    if spheres and mask(folder):
        return GeometryTable(shape="sphere")
    sphere = ", or the mask of a sphere (mask.png)" if spheres else ""
    raise InputError(
        f"{folder}: expected the shape of the object beside its photographs; put a normal map (normals.exr, "
        f"Normal_gt.mat) or a mesh{sphere} into the folder."
    )


def with_view(tables: CaptureFile, folder: Path) -> CaptureFile:
    """Tables with what a mesh needs beside a list of lights in the axes of the camera.

    That are those axes for the lights, and the camera of a transforms.json or of a model of COLMAP in the folder.
    """
    if tables.geometry.mesh is None:
        return tables
    named = next((name for name in _CAMERAS if (folder / name).exists()), None)
    camera = None if named is None else CameraTable(file=named)
    return msgspec.structs.replace(tables, light_axes="camera", camera=camera)


def images(folder: Path) -> list[Path]:
    """The photographs of a folder, by name: all images but mask and normal maps."""
    others = {*_NORMALS, *_MASKS}
    files = files_by_name(folder).values()
    kinds = {*READERS} - {".mat"}
    return [file for file in files if file.suffix.lower() in kinds and file.stem.lower() not in others]


def images_in_order(file: Path, count: int) -> list[Path]:
    """The photographs beside a list of lights that names none, which go with the lights by the order of their names.

    Args:
        file: the list.
        count: of its lights.

    Raises:
        InputError: another number of photographs, or names whose numbers are in another order than their letters.
    """
    photographs = images(file.parent)
    if len(photographs) != count:
        raise InputError(
            f"{file}: has {count} lights, and the folder {len(photographs)} photographs ({some(photographs)}); each "
            "light belongs to one photograph, in the order of their names."
        )
    numeric = sorted(photographs, key=_numeric)
    if numeric != photographs:
        first, other = next(pair for pair in zip(photographs, numeric, strict=True) if pair[0] != pair[1])
        raise InputError(
            f"{file}: names no photographs, so that their order decides, and that is not clear: by letters "
            f"{first.name} comes where by numbers {other.name} does; give the numbers leading zeros."
        )
    return photographs


def image_named(file: Path, name: str, line: int) -> str:
    """The photograph, relative to a list of lights, that the list names in one of its lines.

    A path that leads nowhere is one of another computer: its last parts decide, without regard to case.

    Raises:
        InputError: there is no such photograph.
    """
    folder, path = file.parent, PureWindowsPath(name)
    parts = [part for part in path.parts if part not in (path.anchor, "..")]
    if len(parts) == len(path.parts) and is_file(folder / name):
        return name
    for start in range(len(parts)):
        present = files_by_name(folder.joinpath(*parts[start:-1])).get(parts[-1].lower())
        if present is not None:
            return present.relative_to(folder).as_posix()
    there = images(folder)
    raise InputError(
        f"{file}: line {line} names '{parts[-1] if parts else name}', and there is no such file in the folder, whose "
        f"photographs are {some(there) if there else 'missing'}; lights go by name, not by order: put it there or "
        "correct the name."
    )


def unlisted(file: Path, names: Sequence[str]) -> list[str]:
    """A sentence on the images beside a list of lights that it does not name, where there are some.

    Args:
        file: the list.
        names: of its photographs, relative to its folder.
    """
    others = [image for image in images(file.parent) if image.name not in {*names}]
    if not others:
        return []
    return [f"Not in {file.name}, and so left out: {some(others)}."]


def some(files: Sequence[Path]) -> str:
    """The names of a few files, and how many more there are."""
    more = len(files) - _SOME
    return ", ".join(file.name for file in files[:_SOME]) + (f" and {more} more" if more > 0 else "")


def _first(folder: Path, stems: Sequence[str], suffixes: Sequence[str]) -> Path | None:
    files = files_by_name(folder)
    names = (stem + suffix for suffix in suffixes for stem in stems)
    return next((files[name] for name in names if name in files), None)


def _numeric(file: Path) -> list[tuple[int, str]]:
    """A key that sorts the numbers in a name by value."""
    return [(int(part), "") if part.isdecimal() else (0, part.lower()) for part in re.split(r"(\d+)", file.name)]
