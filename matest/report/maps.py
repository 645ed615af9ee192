"""Maps of a material in a result folder: written for other programs, and read back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from matest.errors import InputError
from matest.estimation.parameter_map import ParameterMap, TexelStatus, map_file
from matest.estimation.result import Estimate, read_result
from matest.photographs.images import read_image, write_image
from matest.report.map_figures import picture_file, pictures
from matest.report.previews import drawing
from matest.scene import Surface

# Longest side of a map on the page, pixels.
MAP_SIDE = 420
# The normals of the object that maps belong to, in world coordinates; black off the object.
VIEW = "maps/normals.png"
_STATUS = "_status.png"
# Share of the rim's pixels, which are two deep, by which the object may differ: about a pixel all around.
_RIM_SHARE = 0.5
# Degrees by which the normals of most pixels may differ: more than rounding to 8 bits, and a small object moved by a
# pixel, make of them.
_TURN = 3.0


def write_maps(estimate: Estimate, surface: Surface, folder: Path, *, previews: bool = True) -> dict[str, str]:
    """`maps/NAME.exr` and `NAME_std.exr` [H, W, C], `NAME_status.png` [H, W], and previews of them as PNG.

    The preview of the status is `NAME_known.png`: a palette inside `NAME_status.png` would make cv2.imread give colours
    instead of codes. Smoothed maps are `NAME_smooth.exr` and `NAME_smooth_std.exr` beside them.
    Where no photograph shows a pixel, its value, standard error and status (`TexelStatus`) are 0. `normals.png` tells
    which pixels are the object's and from where it is seen.

    Returns:
        Small pictures for a page as data URIs, by the file of the preview that each shows.
    """
    small: dict[str, str] = {}
    for name, each in estimate.maps.items():
        (folder / "maps").mkdir(exist_ok=True)
        for kind, values in (("", each.value), ("std", each.std)):
            write_image(folder / map_file(name, kind), surface.image(np.nan_to_num(values.float().numpy())))
        write_image(folder / f"maps/{name}{_STATUS}", surface.image(each.status.numpy()))
    for name, each in estimate.smooth_maps.items():
        for kind, part in (("smooth", each.value), ("smooth_std", each.std)):
            write_image(folder / map_file(name, kind), surface.image(np.nan_to_num(part.float().numpy())))
    if previews:
        for file, picture in pictures(estimate, surface):
            write_image(folder / file, picture)
            small[file] = drawing(picture, MAP_SIDE)
    if estimate.maps:
        # As integer normal maps are: 0 to full scale for -1 to 1.
        codes = (127.5 * (surface.normals.double().numpy() + 1)).round().astype(np.uint8)
        write_image(folder / VIEW, surface.image(codes))
    return small


def files_of_map(name: str) -> list[str]:
    """The files that a result folder with a map of a parameter may have, from the folder."""
    kinds = ("", "std", "smooth", "smooth_std")
    files = [write(name, kind) for write in (map_file, picture_file) for kind in kinds]
    return [VIEW, f"maps/{name}{_STATUS}", picture_file(name, "known"), *files]


def load_maps(folder: str | Path, surface: Surface) -> dict[str, ParameterMap]:
    """The maps of a result folder over the N pixels of a surface, by name of the parameter; empty where it has none.

    Pixels that the maps do not cover have the status `UNSEEN`; `with_maps` gives them the mean.

    Args:
        folder: of `matest estimate --maps`, or its `material.json`.
        surface: `capture.scene.surface` of a capture that shows the object as the one of the estimate does.

    Raises:
        InputError: no result folder, another view of the object, a file that is missing or damaged.
    """
    folder = _result_folder(folder)
    if difference := view_difference(folder, surface):
        raise InputError(
            f"{difference}: maps belong to the view that they were estimated in. Use them with a capture of that view, "
            "or their means, which matest.load_material gives."
        )
    files = sorted((folder / "maps").glob(f"*{_STATUS}"))
    return {name: _read(folder, name, surface) for name in (file.name.removesuffix(_STATUS) for file in files)}


def has_maps(folder: Path) -> bool:
    """Whether a result folder has maps.

    Raises:
        InputError: its result names some that are not there.
    """
    there = (folder / "maps").is_dir()
    if not there and (folder / "result.json").is_file() and (lost := read_result(folder).get("maps")):
        raise InputError(
            f"{folder / 'maps'}: is missing, while result.json names maps of {' and '.join(lost)}; copy the whole "
            "result folder, or estimate with --maps again."
        )
    return there


def view_difference(folder: str | Path, surface: Surface) -> str:
    """In what a surface differs from the one that a result folder has maps of, as a clause; empty where it has none.

    Raises:
        InputError: no result folder, a file that is missing or damaged.
    """
    folder = _result_folder(folder)
    if not has_maps(folder):
        return ""
    file = folder / VIEW
    if not file.is_file():
        raise InputError(f"{file}: is missing beside the maps, whose pixels it tells; estimate with --maps again.")
    codes = read_image(file)
    if codes.shape[:2] != surface.shape:
        (theirs, ours) = (f"{width}×{height}" for height, width in (codes.shape[:2], surface.shape))
        return f"{folder}: its maps are of images of {theirs} pixels, and these have {ours}"
    mapped = codes.any(axis=2)
    apart = int((mapped != surface.mask).sum())
    if apart > _RIM_SHARE * int(surface.rim.sum()):
        return f"{folder}: its maps show the object at other pixels ({apart:,} differ)"
    both = mapped.flat[surface.pixels]
    normals = codes.reshape(-1, codes.shape[2])[surface.pixels[both]] / 127.5 - 1
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    cosines = (normals * surface.normals.double().numpy()[both]).sum(axis=1)
    turn = float(np.degrees(np.arccos(np.median(cosines).clip(-1, 1))))
    return f"{folder}: its maps show the object from another side (turned by {turn:.0f}°)" if turn > _TURN else ""


def map_shape(folder: Path) -> tuple[int, int]:
    """Height and width of the maps of a result folder.

    Raises:
        InputError: it has none, or they cannot be read.
    """
    if not (folder / VIEW).is_file():
        raise InputError(f"{folder}: has no maps; estimate with --maps, such as --maps albedo.")
    height, width, _ = read_image(folder / VIEW).shape
    return height, width


def _result_folder(path: str | Path) -> Path:
    """The folder of a result.

    Raises:
        InputError: there is none.
    """
    path = Path(path)
    folder = path.parent if path.is_file() else path
    if not folder.is_dir():
        raise InputError(f"{path}: expected a result folder of 'matest estimate'; check the path.")
    return folder


def _read(folder: Path, name: str, surface: Surface) -> ParameterMap:
    """A map over the pixels of a surface."""
    value, std, codes = (
        _pixels(folder / file, surface) for file in (map_file(name), map_file(name, "std"), f"maps/{name}{_STATUS}")
    )
    if std.shape != value.shape:
        raise InputError(
            f"{folder / map_file(name, 'std')}: expected {value.shape[1]} channel(s) like {name}.exr; got "
            f"{std.shape[1]}. Estimate with --maps again."
        )
    unseen = codes == TexelStatus.UNSEEN
    value, std = (np.where(unseen, np.float32("nan"), part) for part in (value, std))
    return ParameterMap(name, torch.from_numpy(value), torch.from_numpy(std), torch.from_numpy(codes[:, 0].copy()))


def _pixels(file: Path, surface: Surface) -> np.ndarray:
    """The object's pixels of an image [N, C].

    Raises:
        InputError: it is missing, damaged, or of another size.
    """
    if not file.is_file():
        raise InputError(f"{file}: is missing among the maps; estimate with --maps again.")
    image = read_image(file)
    if image.shape[:2] != surface.shape:
        sizes = [f"{width}×{height}" for height, width in (surface.shape, image.shape[:2])]
        raise InputError(f"{file}: expected {sizes[0]} pixels like {Path(VIEW).name}; got {sizes[1]}. Estimate again.")
    return image.reshape(-1, image.shape[2])[surface.pixels]
