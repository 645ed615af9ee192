"""Small pictures of a photograph, and the numbers behind them, for the page to draw with."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

import numpy as np
import simplejpeg

from matest.report.packing import data_uri, packed, packed_noise
from matest.report.raster import Raster

# Longest side of the previews of the photographs with the largest errors, pixels.
LARGE_SIDE = 256
# That of the others.
SMALL_SIDE = 80
# Photographs with large previews.
LARGE_PREVIEWS = 12
# Longest side of what profiles are read from: a chart shows no more.
_PROFILE_SIDE = 100
# That of small previews.
_SMALL_PROFILE_SIDE = 50
# Quality of JPEG: noise stays visible.
_QUALITY = 75
# That of pictures whose colours are a scale: no more than its finest steps are lost, and colours keep to their pixels.
_DRAWING_QUALITY = 90
# Codes of residuals for each unit of asinh(r/2), r in standard deviations of the noise: two thirds of one near 0.
RESIDUAL_CODES = 3.0
# Codes of the root of a brightness: beside a highlight five times as bright, a step is 1 % of what one sees.
BRIGHTNESS_STEPS = 511
# Code of no residual; 0 is a pixel that did not count.
RESIDUAL_ZERO = 128


@dataclass(frozen=True)
class Preview:
    """A photograph and its model as the page shows them; its fields are those that `viewer.js` reads.

    Attributes:
        name: of the photograph.
        number: of it in the capture.
        step: pixels of the photograph from one of the preview to the next.
        width, height: of the preview.
        photo, render: pictures at one exposure, as data URIs.
        residual: code of every pixel, packed 8 bit [height, width].
        stride: pixels of the preview from one of `brightness` to the next.
        columns: of `brightness`.
        brightness: of photograph and model, the mean over the channels as BRIGHTNESS_STEPS · √(value/top), packed
            16 bit [2, rows, columns].
        top: their largest brightness.
        full: whether there are full-size pictures in the result folder.
    """

    name: str
    number: int
    step: int
    width: int
    height: int
    photo: str
    render: str
    residual: str
    stride: int
    columns: int
    brightness: str
    top: float
    full: bool


@dataclass(frozen=True)
class PreviewPlan:
    """How large the previews of photographs are.

    Attributes:
        names: of the photographs.
        large: numbers of those with large previews.
        step: distance of the pixels of the pictures that previews are taken from.
        full: whether these are asked for as pictures to link to.
    """

    names: list[str]
    large: Collection[int]
    step: int
    full: bool

    def every(self, number: int, shape: tuple[int, int]) -> int:
        """Which pixels of a picture of this shape the preview of a photograph shows: every 1st, 2nd, …"""
        return -(-max(shape) // (LARGE_SIDE if number in self.large else SMALL_SIDE))


@dataclass(frozen=True)
class PagePictures:
    """The pictures of a page, as data URIs.

    Attributes:
        previews: of the photographs, in their order.
        mean_residual: over the photographs; empty where there is only one.
        maps: by the file that each is a preview of.
    """

    previews: list[Preview]
    mean_residual: str = ""
    maps: Mapping[str, str] = field(default_factory=dict)


def residual_codes(deviations: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """8-bit codes of residuals in standard deviations of the noise; 0 where they do not count."""
    codes = RESIDUAL_ZERO + RESIDUAL_CODES * np.arcsinh(deviations / 2)
    return np.where(counts, codes.round().clip(1, 255), 0).astype(np.uint8)


def preview(
    plan: PreviewPlan,
    number: int,
    raster: Raster,
    pictures: dict[str, np.ndarray],
    brightness: np.ndarray,
    codes: np.ndarray,
) -> Preview:
    """The preview of a photograph.

    Args:
        plan: for all of them.
        number: of the photograph.
        raster: of its pictures.
        pictures: "photo" and "render" as the raster has them, 8 bit.
        brightness: of photograph and model at the n pixels that the raster shows [n, 2].
        codes: of their residuals [n].
    """
    every = plan.every(number, raster.shape)
    places = raster.sources.reshape(raster.shape)
    shown = _some(places, every)
    stride = -(-max(shown.shape) // (_PROFILE_SIDE if number in plan.large else _SMALL_PROFILE_SIDE))
    profile = _some(shown, stride)
    top = float(brightness.max(initial=0.0)) or 1.0
    levels = (BRIGHTNESS_STEPS * np.sqrt(brightness.clip(0) / top)).round().astype(np.uint16)
    return Preview(
        name=plan.names[number],
        number=number,
        step=plan.step * every,
        width=shown.shape[1],
        height=shown.shape[0],
        photo=jpeg(_some(pictures["photo"], every)),
        render=jpeg(_some(pictures["render"], every)),
        residual=packed_noise(_laid_out(codes[:, None], shown)),
        stride=stride,
        columns=profile.shape[1],
        brightness=packed(_laid_out(levels, profile)),
        top=top,
        full=plan.full,
    )


def jpeg(picture: np.ndarray) -> str:
    """A photograph [H, W, 1 or 3] of 8 bits as a data URI."""
    space = "GRAY" if picture.shape[2] == 1 else "RGB"
    content = simplejpeg.encode_jpeg(np.ascontiguousarray(picture), _QUALITY, space, "420")
    return data_uri(content, "image/jpeg")


def drawing(picture: np.ndarray, side: int) -> str:
    """A picture [H, W, 3] of 8 bits whose colours stand for numbers as a data URI, no side longer than `side`."""
    content = simplejpeg.encode_jpeg(np.ascontiguousarray(thinned(picture, side)), _DRAWING_QUALITY, "RGB", "444")
    return data_uri(content, "image/jpeg")


def thinned(picture: np.ndarray, side: int) -> np.ndarray:
    """One pixel of every n×n of a picture [H, W, C], with n such that no side is longer than `side`."""
    return _some(picture, -(-max(picture.shape[:2]) // side))


def _some(picture: np.ndarray, every: int) -> np.ndarray:
    """One pixel of every `every`×`every`, from the middle; a picture of one row or column keeps it."""
    rows, columns = (slice(min(every, side) // 2, None, every) for side in picture.shape[:2])
    return picture[rows, columns]


def _laid_out(values: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Values [n, K] as pictures [K, H, W], by the place in them of every pixel; 0 on the background."""
    with_background = np.concatenate([values, np.zeros((1, values.shape[1]), dtype=values.dtype)])
    return np.moveaxis(with_background[places], -1, 0)
