"""Maps of a material: files for other programs, and pictures for people."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from matest.estimation.parameter_map import ParameterMap, map_file
from matest.estimation.result import Estimate
from matest.photographs.images import write_image
from matest.photographs.photometry import srgb
from matest.scene import Surface

# Relative standard error at the bright end of the colours.
BRIGHTEST = 0.1


def write_maps(estimate: Estimate, surface: Surface, folder: Path) -> None:
    """`maps/NAME.exr` and `NAME_std.exr` [H, W, C], `NAME_status.png` [H, W], and previews of the former two as PNG.

    Smoothed maps are `NAME_smooth.exr` and `NAME_smooth_std.exr` beside them.
    Where no photograph shows a pixel, its value, standard error and status (`TexelStatus`) are 0.
    """
    for name, each in estimate.maps.items():
        (folder / "maps").mkdir(exist_ok=True)
        value, std = (_image(part.numpy(), surface) for part in (each.value, each.std))
        write_image(folder / map_file(name), np.nan_to_num(value))
        write_image(folder / map_file(name, "std"), np.nan_to_num(std))
        status = np.zeros(surface.shape, np.uint8)
        status.flat[surface.pixels] = each.status.numpy()
        write_image(folder / picture_file(name, "status"), status)
        write_image(folder / picture_file(name), srgb(np.nan_to_num(_coloured(value))))
        write_image(folder / picture_file(name, "std"), _relative(each, surface))
    for name, each in estimate.smooth_maps.items():
        for kind, part in (("smooth", each.value), ("smooth_std", each.std)):
            write_image(folder / map_file(name, kind), surface.image(np.nan_to_num(part.float().numpy())))


def picture_file(name: str, kind: str = "") -> str:
    """The preview of a map in a result folder."""
    return map_file(name, kind).replace(".exr", ".png")


def _image(values: np.ndarray, surface: Surface) -> np.ndarray:
    """Values [N, C] of the object's pixels as an image."""
    image = np.full((surface.shape[0] * surface.shape[1], values.shape[1]), np.nan, np.float32)
    image[surface.pixels] = values
    return image.reshape(*surface.shape, -1)


def _coloured(image: np.ndarray) -> np.ndarray:
    """An image of three channels."""
    return image if image.shape[2] == 3 else np.repeat(image.mean(axis=2, keepdims=True), 3, axis=2)


def _relative(each: ParameterMap, surface: Surface) -> np.ndarray:
    """The relative standard error in colours, dark where it is small; white off the object."""
    relative = (each.std / each.value).mean(dim=1, keepdim=True).numpy()
    level = _image(np.nan_to_num(relative / BRIGHTEST, nan=1.0).clip(0, 1), surface)
    colours = cv2.applyColorMap((255 * np.nan_to_num(level)).astype(np.uint8), cv2.COLORMAP_VIRIDIS)[..., ::-1]
    return np.where(np.isnan(level), np.uint8(255), colours)
