"""Figures 12, 15 and 17 of Li & Torrance 2005: both fits of their tables in the plane of incidence, and a fit here."""

from __future__ import annotations

from pathlib import Path

import torch
from matplotlib.figure import Figure
from torch import Tensor

import matest
from matest.brdf import Brdf, HeTorrance, preset
from matest.tables import Table
from papers.cosine_lobes import GRID, LIGHTS, concentric_square
from papers.drawing import BLACK, BLUE, GREEN, ORANGE, Drawn, Entry, direction

# Of the channels R, G, B, in µm; the paper prints none.
WAVELENGTHS = [0.61, 0.55, 0.46]
# Degrees; negative: forward. Fine enough for the mirror-like peak, 0.5° wide.
VIEWS = torch.linspace(-85, 85, 1701, dtype=torch.float64)
# Index of the mirror direction of each angle of incidence among them.
MIRROR = {light: int((VIEWS + light).abs().argmin()) for light in (30, 45, 60, 75)}
# The first rows of Tables 2 and 3 and §5.2.1: fits of He and Torrance's model.
HE_GLASS = HeTorrance(
    k_dd=1.0, k_ud=0.0, f0=0.92, height_rms=0.23, correlation_length=10.4, wavelength=WAVELENGTHS, solid_angle=5e-4,
    coherent="on",
)  # fmt: skip
HE_PAINT = HeTorrance(
    k_dd=[0.56, 0.53, 0.52], k_ud=[0.09, 0.0, 0.0], f0=(0.7 / 2.7) ** 2, height_rms=0.64, correlation_length=8.2,
    wavelength=WAVELENGTHS,
)  # fmt: skip
HE_PAPER = HeTorrance(
    k_dd=[0.45, 0.39, 0.38], k_ud=[0.73, 0.75, 0.64], f0=(0.5 / 2.5) ** 2, height_rms=0.54, correlation_length=5.6,
    wavelength=WAVELENGTHS,
)  # fmt: skip
# A surface lobe over an even body: what He and Torrance's model is where the surface is rough.
WITHOUT_FORWARD = "li-torrance(uniform=on,subsurface=off)"


def in_plane(brdf: Brdf, light: float, views: Tensor = VIEWS) -> Tensor:
    """f [views, C] in the plane of incidence."""
    return brdf(direction(light), direction(views))


def measurement(brdf: Brdf, channel: int, lights: range | tuple[int, ...], views: Tensor) -> Table:
    """One channel of a model as a gonioreflectometer has it: `views` [n, 3] at every one of `lights`, in degrees."""
    wi = torch.cat([direction(light).expand(len(views), 3) for light in lights])
    wo = views.repeat(len(lights), 1)
    return Table(Path("model"), wi, wo, brdf(wi, wo)[:, channel : channel + 1], ["RGB"[channel]])


def figure_12() -> Drawn:
    new = preset("non-glare-glass").replace({"wavelength": torch.tensor(WAVELENGTHS, dtype=torch.float64)})
    figure = Figure(figsize=(11, 3.8), layout="constrained")
    panels = figure.subplots(1, 4, sharey=True)
    rows = ["| θi | channel | He-Torrance | constructed | e^(−g) |", "| --- |" + " --- |" * 4]
    for axes, light in zip(panels, (30, 45, 60, 75), strict=True):
        curves = [in_plane(brdf, light) for brdf in (HE_GLASS, new)]
        for channel, colour in reversed(list(enumerate((ORANGE, GREEN, BLUE)))):
            name, (old, ours) = "RGB"[channel], (curve[:, channel] for curve in curves)
            axes.semilogy(VIEWS, old, color=colour, linewidth=1.6, label=f"{name}, He-Torrance")
            axes.semilogy(VIEWS, ours, "--", color=colour, linewidth=1, label="constructed")
            mirror = [float(curve[MIRROR[light], channel]) for curve in curves]
            cos = direction(light)[2]
            share = torch.exp(-((4 * torch.pi * 0.23 / WAVELENGTHS[channel] * cos) ** 2))
            rows.append(f"| {light}° | {name} | {mirror[0]:.2f} | {mirror[1]:.2f} | {float(share):.1e} |")
        axes.set(title=f"θi = {light}°", ylim=(1e-3, 1e4), xlim=(-90, 0), xlabel="θr (degrees; negative: forward)")
        axes.grid(alpha=0.25)
    panels[0].set_ylabel("BRDF (1/sr)")
    panels[0].legend(frameon=False, fontsize="x-small")
    he_75, at_75 = (curve[MIRROR[75]].tolist() for curve in curves)
    plane = direction(VIEWS[::17])
    fit = matest.fit_table(
        measurement(HE_GLASS, 1, (15, 30, 45), plane), "li-torrance-directional(masking=off)", loss="li-torrance",
        fix={"k_dd": 1.0, "f0": 0.92},
    )  # fmt: skip
    ratio = fit.estimate.parameters["slope_ratio"]
    measured = (
        f"R, G and B are taken at {', '.join(map(str, WAVELENGTHS))} µm. "
        "Below: 1/sr in the mirror direction, and the share of the light that is reflected as by a mirror. Only at 75° "
        f"does that peak rise out of the lobe, {at_75[0] / at_75[2]:.1f} times as high in R as in B (He-Torrance "
        f"{he_75[0] / he_75[2]:.1f}). The constructed lobe is not dimmed by it. A fit here of that lobe to He-Torrance "
        f"at 15°, 30° and 45° (G, eq. 15) has σ/τ = {ratio.value:.4f}; the paper's, to measurements, "
        f"{0.23 / 9.9:.4f}, He-Torrance's {0.23 / 10.4:.4f}.\n\n" + "\n".join(rows)
    )
    return Drawn(figure, measured)


def against_table(he: Brdf, sample: str, channel: int, lights: tuple[int, ...]) -> tuple[Figure, str]:
    """Both rows of a table in the plane of incidence, and what a model without forward scattering makes of the second.

    Returns:
        The figure, and a table of peaks.
    """
    new = preset(sample)
    without = new.replace({"k_fs": torch.zeros_like(new.k_fs)})  # type: ignore[attr-defined]
    figure = Figure(figsize=(12, 3.2), layout="constrained")
    panels = figure.subplots(1, len(lights))
    rows = [
        "| θi | He-Torrance, largest | constructed, largest | of it forward scattering, at −75° |",
        "| --- |" + " --- |" * 3,
    ]
    for axes, light in zip(panels, lights, strict=True):
        old, full, bare = (in_plane(brdf, light)[:, channel] for brdf in (he, new, without))
        axes.plot(VIEWS, old, color=BLACK, linewidth=1.8, label="He-Torrance")
        axes.plot(VIEWS, full, "--", color=ORANGE, linewidth=1.6, label="constructed")
        axes.plot(VIEWS, bare, ":", color=BLUE, linewidth=1.2, label="without forward scattering")
        axes.set(title=f"θi = {light}°", ylim=(0, None), xticks=range(-60, 61, 60), xlabel="θr (degrees)")
        axes.grid(alpha=0.25)
        at = int((VIEWS + 75).abs().argmin())
        peaks = [f"{float(values.max()):.3f} at {float(VIEWS[values.argmax()]):.0f}°" for values in (old, full)]
        rows.append(
            f"| {light}° | {' | '.join(peaks)} | {float(1 - bare[at] / full[at]):.0%} of {float(full[at]):.3f} |"
        )
    panels[0].set_ylabel("BRDF (1/sr)")
    panels[3].legend(frameon=False, fontsize="x-small")
    views = concentric_square(GRID)[1].reshape(-1, 3)
    fit = matest.fit_table(
        measurement(new, channel, LIGHTS, views), WITHOUT_FORWARD, loss="li-torrance",
        fix={"f0": float(new.f0)},  # type: ignore[attr-defined]
    )  # fmt: skip
    values = {name: fit.estimate.parameters[name].value for name in ("k_udf", "k_dd", "slope_ratio")}
    stated = [float(value[channel] if value.ndim else value) for value in (he.k_ud, he.k_dd)]  # type: ignore[attr-defined]
    stated.append(float(he.height_rms / he.correlation_length))  # type: ignore[attr-defined]
    sentence = (
        "The constructed model as if it were measured (441 directions, light at 10° to 80°), fitted by a surface lobe "
        "over an even body, which is what He-Torrance has: k_ud "
        + ", ".join(
            f"{name} {float(torch.as_tensor(value)):.3f} (Table: {of_table:.3f})"
            for name, value, of_table in zip(("", "k_dd", "σ/τ"), values.values(), stated, strict=True)
        ).removeprefix(" ")
        + "."
    )
    return figure, sentence + "\n\n" + "\n".join(rows)


def figure_15() -> Drawn:
    figure, table = against_table(HE_PAINT, "red-paint", 0, (20, 40, 50, 70, 80))
    return Drawn(figure, "In the plane of incidence, negative: forward. " + table, colours=64)


def figure_17() -> Drawn:
    figure, table = against_table(HE_PAPER, "laser-paper", 1, (20, 40, 50, 70, 80))
    return Drawn(figure, "In the plane of incidence, negative: forward. " + table, colours=64)


FIGURES: dict[str, Entry] = {
    "li-torrance-12": Entry(
        "Li & Torrance 2005, figure 12: aluminised non-glare glass (sample #45), R, G, B",
        "At 75° a mirror-like peak appears, higher in R than in B, as a surface is smoother for longer waves; both "
        "models have it. The lobe of the constructed model is less accurate than He-Torrance's.",
        figure_12,
    ),
    "li-torrance-15": Entry(
        "Li & Torrance 2005, figure 15: garnet red paint (sample #13), R",
        "Both models have the surface lobe over the even red light from below; the second bump at large angles is in "
        "the constructed model only, which has forward scattering below the surface.",
        figure_15,
    ),
    "li-torrance-17": Entry(
        "Li & Torrance 2005, figure 17: laser paper (sample #73), G",
        "The even part dominates; both models agree with the lobe roughly, and He-Torrance misses the second lobe that "
        "emerges at grazing views.",
        figure_17,
    ),
}
