"""Pictures of rendered scenes: panels side by side, linear radiance shown as sRGB."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from matest.brdf import Brdf
from matest.photographs.photometry import srgb
from matest.simulate import SimulatedScene, load_scene, radiance

GALLERY = Path(__file__).parents[1] / "gallery"
DPI = 100
GAP, LINE = 6, 17  # pixels between panels, and of a line of text below them


class Panel(NamedTuple):
    """A render and what stands below it.

    Attributes:
        radiance: linear, [H, W, 1 or 3].
        title: one or two lines.
        white: the radiance that is shown as white; what is brighter is clipped.
    """

    radiance: np.ndarray
    title: str
    white: float


def scene_of(figure: str, file: str = "scene.toml") -> SimulatedScene:
    """A scene of the gallery."""
    return load_scene(GALLERY / figure / file)


def rendered(scene: SimulatedScene, material: Brdf | None = None, image: int = 0) -> np.ndarray:
    """Noise-free radiance [H, W, C] as `matest render` has it, float64, perhaps of another material."""
    return radiance(scene if material is None else dataclasses.replace(scene, material=material), image)


def sheet(rows: Sequence[Sequence[Panel]], below: int = 0) -> Figure:
    """The panels in rows, pixel by pixel; `below` leaves so many pixels free for a plot."""
    lines = [max(panel.title.count("\n") + 1 for panel in row) for row in rows]
    heights = [max(panel.radiance.shape[0] for panel in row) for row in rows]
    width = GAP + max(sum(panel.radiance.shape[1] + GAP for panel in row) for row in rows)
    height = GAP + sum(h + LINE * n + GAP for h, n in zip(heights, lines, strict=True)) + below
    figure = Figure(figsize=(width / DPI, height / DPI), dpi=DPI)
    top = height - GAP
    for row, high, count in zip(rows, heights, lines, strict=True):
        left = GAP
        for panel in row:
            shown = srgb(panel.radiance / panel.white)
            h, w = shown.shape[:2]
            # An image with alpha is drawn as it is, whatever the number of its channels.
            pixels = np.concatenate([np.broadcast_to(shown, (h, w, 3)), np.full((h, w, 1), 255, np.uint8)], axis=-1)
            figure.figimage(pixels, left, top - h, origin="upper")
            middle = (left + w / 2) / width
            figure.text(
                middle, (top - h - 3) / height, panel.title, ha="center", va="top", fontsize=8, linespacing=1.25
            )
            left += w + GAP
        top -= high + LINE * count + GAP
    return figure
