"""Figure 4 of Li & Torrance 2005: cosine lobes fitted to a rough surface of He and Torrance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from matplotlib.figure import Figure
from scipy.optimize import least_squares, nnls
from torch import Tensor

from matest.brdf import BlinnPhong, Brdf, HeTorrance, Lafortune, NeumannNeumann
from papers.drawing import BLUE, GREEN, ORANGE, PINK, Drawn, direction

# §5.1: 441 directions spread evenly over the hemisphere, light at 10° to 80°.
GRID, LIGHTS = 21, range(10, 81, 10)
SHOWN = (10, 40, 70)
TENTHS = torch.linspace(-85, 85, 1701, dtype=torch.float64)  # degrees; negative = away from the light


def ground_glass() -> Brdf:
    """He and Torrance's fit to sample #41 (Table 1, G), at 550 nm; the reflectance of aluminium is not in the table."""
    return HeTorrance(k_dd=0.47, k_ud=0.32, f0=0.92, height_rms=0.90, correlation_length=5.2, wavelength=0.55)


def concentric_square(n: int) -> tuple[np.ndarray, Tensor]:
    """Centres of n × n equal squares on [−1, 1]², and the directions [n, n, 3] that they map to.

    Every square takes the same solid angle. Source: Shirley & Chiu, the concentric map, extended to the hemisphere.
    """
    centres = (np.arange(n) + 0.5) / n * 2 - 1
    a, b = np.meshgrid(centres, centres, indexing="ij")
    along = np.abs(a) > np.abs(b)
    radius, other = np.where(along, a, b), np.where(along, b, a)
    turn = np.pi / 4 * np.divide(other, radius, out=np.zeros_like(other), where=radius != 0)
    azimuth = np.where(along, turn, np.pi / 2 - turn)
    sin = radius * np.sqrt(2 - radius**2)
    return centres, torch.tensor(np.stack([sin * np.cos(azimuth), sin * np.sin(azimuth), 1 - radius**2], axis=-1))


def fit(shape: Callable[..., Brdf], start: tuple[float, ...], views: Tensor, target: Tensor) -> Any:
    """The cosine lobe nearest to `target` [lights, views]: eq. 15, Σ cos θi (f − target)².

    `shape` makes a lobe of weight 1 without a body from the parameters that are searched for, from `start`; body and
    weight have a closed form.
    """
    weight = np.sqrt(np.cos(np.radians(LIGHTS)))[:, None]
    wanted = (weight * target.numpy()).ravel()

    def columns(parameters: np.ndarray) -> np.ndarray:
        lobe = over_lights(shape(*torch.tensor(parameters)), views).numpy()
        return np.stack([(weight * np.full_like(lobe, 1 / np.pi)).ravel(), (weight * lobe).ravel()], axis=-1)

    def residual(parameters: np.ndarray) -> np.ndarray:
        design = columns(parameters)
        return design @ nnls(design, wanted)[0] - wanted

    found = least_squares(residual, start).x
    body, amplitude = torch.tensor(nnls(columns(found), wanted)[0])
    return replace(shape(*torch.tensor(found)), diffuse=body, specular=amplitude)


def over_lights(brdf: Brdf, views: Tensor) -> Tensor:
    """f [lights, views] for light at `LIGHTS`."""
    return torch.stack([brdf(direction(light), views)[..., 0] for light in LIGHTS])


def fits_of(target: Brdf) -> tuple[BlinnPhong, NeumannNeumann, Lafortune]:
    """The three cosine lobes, each over a uniform body, nearest to a surface by eq. 15 at the directions of §5.1."""
    views = concentric_square(GRID)[1].reshape(-1, 3)
    values = over_lights(target, views)

    def lafortune(log_n: Tensor, c_z: Tensor) -> Brdf:
        return Lafortune(diffuse=0.0, specular=1.0, exponent=log_n.exp(), c_xy=-1.0, c_z=c_z)

    return (
        fit(lambda log_n: BlinnPhong(0.0, 1.0, log_n.exp()), (2.0,), views, values),
        fit(lambda log_n: NeumannNeumann(0.0, 1.0, log_n.exp()), (2.0,), views, values),
        fit(lafortune, (2.0, 0.9), views, values),
    )


def half_width(brdf: Brdf, body: float, light: float) -> float:
    """Degrees out of the plane of incidence, from the mirror direction, at which the lobe above `body` is half."""
    out = torch.deg2rad(torch.linspace(0, 90, 901, dtype=torch.float64))[:, None]
    across = out.cos() * direction(-light) + out.sin() * torch.tensor([0, 1, 0], dtype=torch.float64)
    lobe = brdf(direction(light), across)[:, 0] - body / np.pi
    return float(torch.rad2deg(out[lobe < lobe[0] / 2][0]))


def figure_4() -> Drawn:
    centres, square = concentric_square(GRID)
    he = ground_glass()
    blinn, neumann, general = fits_of(he)
    models = (
        ("Blinn-Phong", blinn, blinn.diffuse, GREEN),
        ("Neumann-Neumann", neumann, neumann.diffuse, PINK),
        ("Lafortune, one lobe", general, general.diffuse, ORANGE),
        ("He-Torrance", he, 0.32, BLUE),
    )
    figure = Figure(figsize=(9, 6.6))
    figure.subplots_adjust(left=0.02, right=0.95, bottom=0.02, top=0.96, wspace=0.12, hspace=0.02)
    a, b = np.meshgrid(centres, centres, indexing="ij")
    table = ["| model | θi | largest | at θr | half width across |", "| --- | --- | --- | --- | --- |"]
    for row, light in enumerate(SHOWN):
        surfaces = [brdf(direction(light), square)[..., 0].numpy() for _, brdf, _, _ in models]
        top = max(surface.max() for surface in surfaces)
        for column, ((name, brdf, body, colour), surface) in enumerate(zip(models, surfaces, strict=True)):
            axes: Any = figure.add_subplot(3, 4, 1 + 4 * row + column, projection="3d")
            axes.plot_surface(
                a, b, surface, rcount=GRID, ccount=GRID, color="#ffffff", edgecolor=colour, linewidth=0.5, shade=False
            )
            axes.set_box_aspect((1, 1, 0.9), zoom=1.12)
            axes.view_init(elev=22, azim=-60)
            axes.set_xticks([-1, 0, 1], labels=[])
            axes.set_yticks([-1, 0, 1], labels=[])
            axes.set_zlim(0, 1.02 * top)
            axes.locator_params(axis="z", nbins=4)
            axes.tick_params(axis="z", labelsize="x-small", pad=1)
            if column < 3:
                axes.set_zticklabels([])
            if row == 0:
                axes.set_title(name, fontsize="medium", pad=0)
            if column == 0:
                axes.text2D(-0.02, 0.92, f"θi = {light}°", transform=axes.transAxes, fontsize="medium")
            plane = brdf(direction(light), direction(TENTHS))[:, 0]
            table.append(
                f"| {name} | {light}° | {float(plane.max()):.2f} | {float(TENTHS[plane.argmax()]):.1f}° "
                f"| {half_width(brdf, float(body), light):.1f}° |"
            )
    measured = (
        "He-Torrance is sample #41 of Table 1 (k_ud 0.32, k_dd 0.47, σ 0.90 µm, τ 5.2 µm, f0 0.92). Each lobe with a "
        "uniform body is one fit to it by eq. 15, over 441 directions and light at 10°, 20°, …, 80°: exponents "
        f"{float(blinn.exponent):.0f} (Blinn-Phong), {float(neumann.exponent):.1f} (Neumann-Neumann) and "
        f"{float(general.exponent):.1f} (Lafortune, Cz/Cxy = −{float(general.c_z):.2f}). The light stands over the "
        "right end of the front axis. Below: the largest value (1/sr) in the plane of incidence up to 85° (negative: "
        "forward), and the angle out of the plane, from the mirror direction, at which what exceeds the body is half. "
        "At 70° all three are far too low, and Neumann-Neumann and Lafortune almost twice too wide, as published; at "
        "10° they are too narrow instead.\n\n" + "\n".join(table)
    )
    return Drawn(figure, measured, colours=64)
