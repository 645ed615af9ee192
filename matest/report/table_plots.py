"""Plots of a fit to a measured table (matplotlib, without a display)."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from matest.directions import from_angles
from matest.estimation.result import Estimate
from matest.estimation.table_fit import TableFit
from matest.report.plots import COLOURS
from matest.tables.samples import Incidence

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Incidences with a panel of their own, and channels in a panel.
_MAX_PANELS = 8
_MAX_CURVES = 3
# Sine of the angle from the plane of incidence, and radians from the incidence of a panel, within which values count as
# measured in the plane and at that incidence.
_IN_PLANE = math.sin(math.radians(1.5))
_AT_INCIDENCE = math.radians(0.5)
# Dots of a curve: more hide it.
_MAX_DOTS = 150
# Viewers of a curve.
_VIEWERS = torch.linspace(-math.radians(85), math.radians(85), 341, dtype=torch.float64)
# Decades below the brightest that a panel shows.
_DECADES = 4
# Names that fit beside a correlation matrix.
_MAX_NAMES = 24
# Of red and blue, in matplotlib's words.
_DIVERGING = "RdBu_r"


def plot_slices(fit: TableFit, path: Path) -> None:
    """The reflectance in the plane of incidence, measured and modelled, as in figures 12 to 17 of Li & Torrance."""
    incidences = fit.samples.incidences
    shown = [incidences[i] for i in _spread(len(incidences), _MAX_PANELS)]
    rows = math.ceil(len(shown) / 2)
    figure = _figure(9, 2.6 * rows + 0.6)
    panels = figure.subplots(rows, 2, squeeze=False, sharex=True)
    for axes, incidence in zip(panels.flat, shown, strict=False):
        _panel(axes, fit, incidence)
    for axes in list(panels.flat)[len(shown) :]:
        axes.set_axis_off()
    panels.flat[0].legend(frameon=False, fontsize=8)
    figure.supxlabel("polar angle of the viewer (degrees; the mirror's side is positive)", fontsize=10)
    figure.supylabel("f (1/sr)", fontsize=10)
    _print(figure, path)


def _panel(axes: Any, fit: TableFit, incidence: Incidence) -> None:
    """The slice under one incidence; of a band of them under the one in its middle that was measured."""
    table, degrees = fit.samples.table, np.degrees(_VIEWERS.numpy())
    wi, wo = table.wi[incidence.rows], table.wo[incidence.rows]
    sideways, angle = _in_plane(wi, wo)
    theta_i = torch.acos(wi[:, 2].clamp(-1, 1))
    centre = float(theta_i[(theta_i - incidence.theta).abs().argmin()])
    near = ((sideways < _IN_PLANE) & ((theta_i - centre).abs() < _AT_INCIDENCE)).nonzero()[:, 0]
    # From side to side, so that a part of them shows all.
    dots = near[angle[near].argsort()][_spread(len(near), _MAX_DOTS)]
    measured, model = table.values[incidence.rows][dots].numpy(), _curves(fit, centre)
    for place, channel in enumerate(_spread(len(fit.channels), _MAX_CURVES)):
        colour = COLOURS[(place + 1) % len(COLOURS)]
        curve = model[:, channel if model.shape[1] > 1 else 0]
        axes.plot(degrees, curve, color=colour, linewidth=1.3, label=fit.channels[channel].label, zorder=3)
        axes.plot(np.degrees(angle[dots].numpy()), measured[:, channel], ".", color=colour, markersize=4)
    axes.axvline(math.degrees(centre), color="0.5", linestyle=":", linewidth=1)
    axes.set_title(f"light at {math.degrees(centre):.3g}°", fontsize=10)
    axes.grid(alpha=0.25)
    positive = np.concatenate([model[model > 0], measured[measured > 0]])
    # A logarithmic scale has no place for nothing at all.
    if len(positive):
        axes.set_yscale("log")
        axes.set_ylim(max(positive.min() / 2, positive.max() / 10**_DECADES), 2 * positive.max())


def plot_incidences(fit: TableFit, path: Path) -> None:
    """The relative rms error under each incidence."""
    figure = _figure(7, 3)
    axes = figure.add_subplot()
    angles = [math.degrees(one.theta) for one in fit.samples.incidences]
    errors = [100 * one.relative_rmse for one in fit.incidences]
    roots = [100 * one.relative_cube_root_error for one in fit.incidences]
    axes.plot(angles, errors, "o-", color=COLOURS[1], label="of f cos θi")
    axes.plot(angles, roots, "s--", color=COLOURS[2], label="of its cube root")
    axes.set_xlabel("polar angle of the light (degrees)")
    axes.set_ylabel("relative rms error (%)")
    axes.set_ylim(bottom=0)
    axes.grid(alpha=0.25)
    axes.legend(frameon=False)
    _print(figure, path)


def plot_posterior(estimate: Estimate, path: Path) -> None:
    """Every estimate with its 95 % interval, and the correlation of their errors."""
    estimated = {name: p for name, p in estimate.parameters.items() if p.interval95 is not None and p.value is not None}
    figure = _figure(9, 4.2)
    names = [name for name, p in estimated.items() if not isinstance(p.value, list)]
    per_channel = [name for name, p in estimated.items() if isinstance(p.value, list)]
    grid = figure.add_gridspec(2, 2, width_ratios=(1.2, 1))
    if per_channel:
        axes = figure.add_subplot(grid[0, 0] if names else grid[:, 0])
        for place, name in enumerate(per_channel):
            _channels(axes, estimate, name, COLOURS[(place + 1) % len(COLOURS)])
        axes.legend(frameon=False, fontsize=8)
        axes.grid(alpha=0.25)
    if names:
        axes = figure.add_subplot(grid[1, 0] if per_channel else grid[:, 0])
        for row, name in enumerate(names):
            low, high = estimated[name].interval95
            axes.plot([low, high], [row, row], color=COLOURS[0], linewidth=1.2)
            axes.plot(np.array([estimated[name].value], dtype=float), [row], "o", color=COLOURS[1], markersize=5)
        axes.set_yticks(range(len(names)), names, fontsize=8)
        axes.margins(y=0.3)
        axes.grid(alpha=0.25)
    axes = figure.add_subplot(grid[:, 1])
    matrix = np.array(estimate.correlation, dtype=float).reshape(len(estimate.labels), -1)
    image = axes.imshow(matrix, cmap=_DIVERGING, vmin=-1, vmax=1)
    if len(estimate.labels) <= _MAX_NAMES:
        axes.set_xticks(range(len(estimate.labels)), estimate.label_names, rotation=90, fontsize=7)
        axes.set_yticks(range(len(estimate.labels)), estimate.label_names, fontsize=7)
    figure.colorbar(image, ax=axes, shrink=0.8, label="correlation")
    _print(figure, path)


def _channels(axes: Any, estimate: Estimate, name: str, colour: str) -> None:
    """A parameter over the channels, with its 95 % intervals."""
    parameter = estimate.parameters[name]
    # None, where there is no number, becomes NaN.
    values = np.array(parameter.value, dtype=float)
    ends = np.array([pair or (None, None) for pair in parameter.interval95], dtype=float)
    places = np.arange(len(values))
    axes.vlines(places, ends[:, 0], ends[:, 1], color=colour, linewidth=1.2)
    axes.plot(places, values, ".", color=colour, label=name)
    shown = _spread(len(values), 7)
    axes.set_xticks(shown, [estimate.channel_names[place] for place in shown], fontsize=8)


def _in_plane(wi: torch.Tensor, wo: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Sine of viewers' angle from the plane of incidence, and polar angle, positive on the mirror's side [n]."""
    sine = wi[:, :2].norm(dim=1).clamp(min=1e-12)
    along = -(wi[:, 0] * wo[:, 0] + wi[:, 1] * wo[:, 1]) / sine
    sideways = ((wi[:, 0] * wo[:, 1] - wi[:, 1] * wo[:, 0]) / sine).abs()
    return sideways, torch.atan2(along, wo[:, 2])


def _curves(fit: TableFit, theta_i: float) -> np.ndarray:
    """f of the model for viewers in the plane of incidence [n, C]."""
    towards = torch.tensor([theta_i], dtype=torch.float64)
    wi = from_angles(towards, torch.full_like(towards, math.pi)).expand(len(_VIEWERS), 3)
    wo = from_angles(_VIEWERS, torch.zeros_like(_VIEWERS))
    with torch.no_grad():
        return fit.estimate.material(wi, wo).numpy()


def _spread(count: int, most: int) -> list[int]:
    """At most so many of `range(count)`, evenly spread."""
    return sorted({round(place) for place in np.linspace(0, max(count - 1, 0), min(count, most))})


def _figure(width: float, height: float) -> Figure:
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def _print(figure: Figure, path: Path) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    FigureCanvasAgg(figure).print_png(path)
