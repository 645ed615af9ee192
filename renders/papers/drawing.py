"""What the figures of the papers share: colours, axes, radiance along a plane."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image
from torch import Tensor

from matest.brdf import Brdf

BLACK, ORANGE, BLUE, GREEN, PINK = "#000000", "#D55E00", "#0072B2", "#009E73", "#CC79A7"
VIEWS = torch.linspace(-85, 85, 171, dtype=torch.float64)  # degrees; negative = away from the light


class Drawn(NamedTuple):
    """A figure, and what it shows in numbers.

    Attributes:
        figure: the picture.
        measured: one or two sentences, perhaps a table.
        colours: store no more than this many, which makes a picture of thin coloured lines several times smaller.
    """

    figure: Figure
    measured: str
    colours: int | None = None

    def save(self, path: Path) -> None:
        """Write the picture as PNG."""
        canvas = FigureCanvasAgg(self.figure)
        if self.colours is None:
            canvas.print_png(path)
            return
        canvas.draw()
        Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB").quantize(self.colours).save(path)


class Entry(NamedTuple):
    """A figure of a paper.

    Attributes:
        title: paper and number.
        published: what the paper says of it.
        draw: draws it.
    """

    title: str
    published: str
    draw: Callable[[], Drawn]


def publish(figures: dict[str, Entry], names: list[str], folder: Path, picture: str, heading: str) -> None:
    """Draw the named figures, or all and the page that shows them, `README.md`, into a folder.

    `picture` is the path of the picture of a figure {}. A name that no figure has ends the program.
    """
    unknown = [name for name in names if name not in figures]
    if unknown:
        sys.exit(f"no figure {', '.join(unknown)}; there are {', '.join(figures)}.")
    page = [heading]
    for name, entry in figures.items():
        if names and name not in names:
            continue
        drawn = entry.draw()
        path = picture.format(name)
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        drawn.save(folder / path)
        page += [f"## {entry.title}", "", f"![{name}]({path})", ""]
        page += [f"Published: {entry.published}", "", f"Here: {drawn.measured}", ""]
        print(f"{name}: {drawn.measured}", flush=True)
    if not names:
        (folder / "README.md").write_text("\n".join(page), "utf-8")


def direction(theta: Tensor | float, azimuth: float = 0.0) -> Tensor:
    """Unit vectors [..., 3] at polar angles in degrees; negative angles lie across the normal."""
    angle, turn = torch.deg2rad(torch.as_tensor(theta, dtype=torch.float64)), np.radians(azimuth)
    return torch.stack([angle.sin() * np.cos(turn), angle.sin() * np.sin(turn), angle.cos()], dim=-1)


def radiance(brdf: Brdf, light: float, views: Tensor = VIEWS, azimuth: float = 0.0) -> Tensor:
    """L/E0 in the plane at `azimuth` from the light, light at `light` degrees: f cos θi."""
    return brdf(direction(light), direction(views, azimuth))[..., 0] * np.cos(np.radians(light))


def axes_of(figure: Figure, *places: Any, ylabel: str) -> Axes:
    """Axes over the viewing angle in the plane of incidence."""
    axes = figure.add_subplot(*places)
    axes.set_xlabel("θr (degrees; negative: forward)")
    axes.set_ylabel(ylabel)
    axes.set_xticks(range(-90, 91, 30))
    axes.grid(alpha=0.25)
    return axes
