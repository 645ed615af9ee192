"""Pictures of an estimate: every photograph, the shaded material, and their difference."""

from __future__ import annotations

import csv
import itertools
import threading
from pathlib import Path

import numpy as np
import torch

from matest.brdf import Brdf
from matest.capture import Capture
from matest.photographs.images import write_image
from matest.photographs.photometry import srgb
from matest.photographs.samples import PhotographSamples
from matest.report.picture_size import PictureSize
from matest.report.previews import LARGE_SIDE, PagePictures, Preview, PreviewPlan, drawing, preview, residual_codes
from matest.report.raster import Raster, Window
from matest.samples import Tile
from matest.samples.likelihood import REJECTED
from matest.samples.residual_scale import ResidualScale
from matest.scene import Surface
from matest.shading import render_image, render_pixels
from matest.workers import in_threads

# Difference shown in full colour, as a share of the photograph's rms brightness: misfits of a tenth stand out.
RESIDUAL_RANGE = 0.1
# The same for the mean over the photographs.
MEAN_RANGE = 0.05
# The picture of that mean in the result folder.
MEAN_RESIDUAL = "images/mean_residual.png"
# Brightness of residual pictures where a pixel did not count, 8 bit.
_GREY = 224


def write_pictures(
    capture: Capture,
    material: Brdf,
    folder: Path,
    size: PictureSize = PictureSize.PREVIEW,
    *,
    radiance: bool = False,
    residual_scale: ResidualScale | None = None,
    plan: PreviewPlan | None = None,
) -> PagePictures:
    """`profile.csv` and, unless `size` says none, `images/NN_photo.png`, `NN_render.png`, `NN_residual.png`, and the
    mean of the residuals, `mean_residual.png`.

    Photograph and render share one exposure. In the residual red is a photograph brighter than the model, blue a
    darker one, white agreement, grey a pixel that did not count. A clipped channel agrees with a model that lies beyond
    the clip, and an outlier is left out; where all channels are, the pixel did not count.

    Args:
        capture: the photographs.
        material: what to shade under the capture's lights.
        folder: where to write.
        size: of the pictures. Only the pixels that they show, and those of the profile, are shaded.
        residual_scale: by which outliers of a fit were judged; None: there are none.
        radiance: shade every pixel and write the linear radiance of the material too, `NN.exr`.
        plan: of previews of these pictures for a page; None: it needs none.

    Returns:
        Small pictures for a page, none without pictures or plan.
    """
    scene, surface, samples = capture.scene, capture.scene.surface, capture.samples()
    row, width = _middle_pixels(surface), surface.shape[1]
    columns = surface.pixels[row] % width
    window = Window.of(surface, size)
    step = size.step(window.shape)
    raster = Raster.of(surface, step, window) if step else None
    shown = np.concatenate([row, raster.index]) if raster else row
    mean = None
    if raster:
        (folder / "images").mkdir(parents=True, exist_ok=True)
        mean = _Mean(len(raster.index))

    def draw(number: int) -> tuple[Preview | None, list[tuple[str, np.ndarray]]]:
        """Write the pictures of an image; returns its preview and its columns of the profile."""
        small = None
        if radiance:
            whole = render_image(scene, number, material).detach().numpy()
            write_image(folder / f"{number:02d}.exr", whole)
            render = whole.reshape(-1, scene.channels)[surface.pixels[shown]]
        else:
            render = render_pixels(scene, number, material, torch.from_numpy(shown)).detach().numpy()
        photo = capture.radiance(number, shown)
        if raster and mean:
            measured, model = photo[len(row) :], render[len(row) :]
            idle = _clipped_alike(samples, number, raster.index, model)
            if residual_scale is not None:
                idle |= _outliers(samples, number, raster.index, model, residual_scale)
            counts = samples.usable_at(number, raster.index) & ~idle.all(axis=1)
            difference = np.where(idle, 0, measured - model)
            mean.add(_by_channel(difference).mean(axis=0) / _rms(measured), counts)
            pictures = _pictures(measured, model, difference, counts, raster)
            for kind, picture in pictures.items():
                write_image(folder / "images" / f"{number:02d}_{kind}.png", picture)
            if plan:
                brightness = np.stack([measured.mean(axis=1), model.mean(axis=1)], axis=1)
                codes = residual_codes(_deviations(samples, number, raster.index, model, difference, idle), counts)
                small = preview(plan, number, raster, pictures, brightness, codes)
        return small, [
            (f"{name}_{number:02d}", _profile(values[: len(row)], columns, width))
            for name, values in (("photo", photo), ("render", render))
        ]

    previews, profiles = zip(*in_threads(draw, range(len(capture))), strict=True)
    write_columns(folder / "profile.csv", {"x": np.arange(width), **dict(itertools.chain.from_iterable(profiles))})
    average = ""
    if raster and mean:
        picture = raster.picture(mean.colours(), background=_GREY)
        write_image(folder / MEAN_RESIDUAL, picture)
        average = drawing(picture, LARGE_SIDE) if plan and len(capture) > 1 else ""
    return PagePictures([small for small in previews if small is not None], average)


def write_columns(path: Path, columns: dict[str, np.ndarray]) -> None:
    """A CSV file of equally long columns."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        values = [column.tolist() for column in columns.values()]
        writer.writerows([[f"{value:.6g}" for value in row] for row in zip(*values, strict=True)])


def _clipped_alike(samples: PhotographSamples, image: int, index: np.ndarray, render: np.ndarray) -> np.ndarray:
    """Where the sensor clipped a value and the model too lies beyond that end of its range, bool [n, C].

    Args:
        samples: of the photographs.
        image: which of them.
        index: of its pixels [n].
        render: radiance of the material there [n, C].
    """
    clipped, limits = samples.clipped(image, index), samples.limits(image, index)
    if clipped is None or limits is None:
        return np.zeros(render.shape, dtype=bool)
    side, lower, upper = clipped.numpy(), limits.lower.numpy(), limits.upper.numpy()
    return np.asarray(((side > 0) & (render >= upper)) | ((side < 0) & (render <= lower)))


def _outliers(
    samples: PhotographSamples, image: int, index: np.ndarray, render: np.ndarray, residual_scale: ResidualScale
) -> np.ndarray:
    """Values that a fit has left out, bool [n, C]; arguments as in `_clipped_alike`."""
    radiance, model = samples.radiance(image, index), torch.from_numpy(render)
    far = REJECTED * residual_scale.smallest * samples.readout(image, index).variance(model).sqrt()
    outliers = np.zeros(render.shape, dtype=bool)
    # The half angles of the others are not needed.
    suspects = ((radiance - model).abs() > far).any(dim=1).nonzero()[:, 0]
    if len(suspects):
        squares = Tile(samples.at(image, index[suspects.numpy()])).about(model[suspects], residual_scale)
        outliers[suspects.numpy()] = (squares.weight == 0).numpy()
    return outliers


def _deviations(
    samples: PhotographSamples,
    image: int,
    index: np.ndarray,
    render: np.ndarray,
    difference: np.ndarray,
    idle: np.ndarray,
) -> np.ndarray:
    """Differences in standard deviations of the noise, of the sum over the channels that are not idle [n]."""
    variance = samples.readout(image, index).variance(torch.from_numpy(render)).numpy()
    spread = np.sqrt(np.where(idle, 0, variance).sum(axis=1))
    return np.divide(difference.sum(axis=1), spread, out=np.zeros(len(index), dtype=spread.dtype), where=spread > 0)


def _pictures(
    photo: np.ndarray, render: np.ndarray, difference: np.ndarray, counts: np.ndarray, raster: Raster
) -> dict[str, np.ndarray]:
    """The pictures of an image by their kind.

    Args:
        photo: measured radiance of the pixels that the raster shows [n, C].
        render: of the material [n, C].
        difference: what of the photograph the material does not explain [n, C].
        counts: whether a pixel counts [n].
        raster: lays the pixels out.
    """
    # The brightest pixels, the highlight's apart, get 80 % of full scale.
    white = (float(np.quantile(_by_channel(photo).max(axis=0), 0.995)) if len(photo) else 1.0) or 1.0
    scale = RESIDUAL_RANGE * _rms(photo)
    residual = _diverging(_by_channel(difference).mean(axis=0) / scale)
    residual[~counts] = _GREY
    return {
        "photo": raster.picture(srgb(0.8 * photo / white), background=0),
        "render": raster.picture(srgb(0.8 * render / white), background=0),
        "residual": raster.picture(residual, background=_GREY),
    }


class _Mean:
    """The mean over the photographs of what of each the material does not explain, of some pixels; for many threads."""

    def __init__(self, pixels: int) -> None:
        self._lock = threading.Lock()
        self._sum, self._count = np.zeros(pixels), np.zeros(pixels, dtype=np.int32)

    def add(self, difference: np.ndarray, counts: np.ndarray) -> None:
        """Those of a photograph, as a share of its brightness [n], where they count [n]."""
        with self._lock:
            self._sum += np.where(counts, difference, 0)
            self._count += counts

    def colours(self) -> np.ndarray:
        """Of the mean [n, 3]; grey where no photograph counts."""
        colours = _diverging(self._sum / np.maximum(self._count, 1) / MEAN_RANGE)
        colours[self._count == 0] = _GREY
        return colours


def _rms(photo: np.ndarray) -> float:
    """The rms brightness of a photograph [n, C]; 1 for one without any."""
    return (float(np.sqrt(np.mean(photo**2))) if len(photo) else 1.0) or 1.0


def _by_channel(values: np.ndarray) -> np.ndarray:
    """Values [n, C] as [C, n], each channel in a row of memory: much faster to reduce over the channels."""
    return np.ascontiguousarray(values.T)


def _middle_pixels(surface: Surface) -> np.ndarray:
    """The surface's pixels in the row through the middle of the object's height [n]."""
    height, width = surface.shape
    starts = np.searchsorted(surface.pixels, np.arange(height + 1) * width)
    occupied = np.flatnonzero(np.diff(starts))
    middle = occupied[len(occupied) // 2]
    return np.arange(starts[middle], starts[middle + 1])


def _profile(values: np.ndarray, columns: np.ndarray, width: int) -> np.ndarray:
    """Brightness along a row [width] from the values [n, C] at some columns; 0 elsewhere."""
    profile = np.zeros(width)
    profile[columns] = values.mean(axis=1)
    return profile


def _diverging(values: np.ndarray) -> np.ndarray:
    """Colours [n, 3] of values [n]: blue (−1) over white to red (+1)."""
    red, blue = np.array([[178], [24], [43]]), np.array([[33], [102], [172]])
    strength = np.abs(values).clip(0, 1)
    colour = np.where(values >= 0, red, blue)
    return (255 * (1 - strength) + colour * strength).round().astype(np.uint8).T
