"""Pictures of an estimate: every photograph, the shaded material, and their difference."""

from __future__ import annotations

import csv
import itertools
from pathlib import Path

import numpy as np

from matest.brdf import Brdf
from matest.capture import Capture
from matest.photographs.images import write_image
from matest.photographs.photometry import srgb
from matest.profiles import cross_section, middle_row
from matest.shading import render_image
from matest.workers import in_threads

# Difference shown in full colour, as a share of the photograph's rms brightness: misfits of a tenth stand out.
RESIDUAL_RANGE = 0.1


def write_pictures(capture: Capture, material: Brdf, folder: Path, *, radiance: bool = False) -> None:
    """`images/NN_photo.png`, `NN_render.png`, `NN_residual.png` and `profile.csv`.

    Photograph and render share one exposure. In the residual red is a photograph brighter than the model, blue a
    darker one, white agreement, grey a pixel that did not count.

    Args:
        capture: the photographs.
        material: what to shade under the capture's lights.
        folder: where to write.
        radiance: write the linear radiance of the material too, `NN.exr`.
    """
    (folder / "images").mkdir(parents=True, exist_ok=True)
    surface, samples = capture.scene.surface, capture.samples()
    line = _object_row(surface.mask)

    def draw(number: int) -> list[tuple[str, np.ndarray]]:
        """Write the pictures of an image; returns its columns of the profile."""
        render = render_image(capture.scene, number, material).detach().numpy()
        if radiance:
            write_image(folder / f"{number:02d}.exr", render)
        photo = surface.image(capture.radiance(number))
        object_pixels = photo[surface.mask]
        white = float(np.quantile(object_pixels.max(axis=1), 0.995)) or 1.0
        # The brightest pixels, the highlight's apart, get 80 % of full scale.
        write_image(folder / "images" / f"{number:02d}_photo.png", srgb(0.8 * photo / white))
        write_image(folder / "images" / f"{number:02d}_render.png", srgb(0.8 * render / white))
        scale = RESIDUAL_RANGE * float(np.sqrt(np.mean(object_pixels**2))) or 1.0
        sample_mask = np.zeros(surface.shape, dtype=bool)
        sample_mask.flat[surface.pixels[samples.indices(number)]] = True
        difference = (photo - render).mean(axis=2) / scale
        write_image(folder / "images" / f"{number:02d}_residual.png", _diverging(difference, sample_mask))
        profiles = {f"photo_{number:02d}": photo, f"render_{number:02d}": render}
        return [(name, cross_section(image, line)) for name, image in profiles.items()]

    columns = dict(itertools.chain.from_iterable(in_threads(draw, range(len(capture)))))
    write_columns(folder / "profile.csv", {"x": np.arange(len(next(iter(columns.values())))), **columns})


def write_columns(path: Path, columns: dict[str, np.ndarray]) -> None:
    """A CSV file of equally long columns."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows([[f"{value:.6g}" for value in row] for row in zip(*columns.values(), strict=True)])


def _object_row(mask: np.ndarray) -> tuple[float, float, float, float]:
    """The horizontal line through the middle of the object's height."""
    rows = np.flatnonzero(mask.any(axis=1))
    x0, _, x1, _ = middle_row((mask.shape[0], mask.shape[1]))
    middle = float(rows[len(rows) // 2])
    return x0, middle, x1, middle


def _diverging(values: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Blue (−1) over white to red (+1); grey outside the mask."""
    red, blue = np.array([178, 24, 43]), np.array([33, 102, 172])
    strength = np.abs(values).clip(0, 1)[..., None]
    colour = np.where(values[..., None] >= 0, red, blue)
    picture = 255 * (1 - strength) + colour * strength
    picture[~mask] = 224
    return picture.round().astype(np.uint8)
