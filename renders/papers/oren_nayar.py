"""Figures 5, 6 and 8-11 of Oren & Nayar 1994."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from matplotlib.figure import Figure
from torch import Tensor

from matest.brdf import Brdf, Fujii, OrenNayar, OrenNayarExact, OrenNayarQualitative, preset
from papers.drawing import BLACK, BLUE, GREEN, ORANGE, PINK, VIEWS, Drawn, Entry, axes_of, radiance

FINE = "48x64"


def rough(kind: type[Brdf], sigma: float, **values: Any) -> Brdf:
    return kind(albedo=0.9, sigma=np.radians(sigma), **values)  # type: ignore[call-arg]


def figure_5() -> Drawn:
    figure = Figure(figsize=(7, 4.5), layout="constrained")
    axes = axes_of(figure, ylabel="1000 Lr / E0")
    once = radiance(rough(OrenNayarExact, 30, nodes=FINE, interreflection=0.0), 75)
    both = radiance(rough(OrenNayarExact, 30, nodes=FINE), 75)
    curves = (
        ("integral, direct and interreflection", both, BLACK, "-", 2.0),
        ("integral, direct only", once, BLACK, "-", 0.8),
        ("functional approximation, eq. 14-16", radiance(rough(OrenNayar, 30), 75), BLUE, "--", 1.4),
        ("qualitative model, eq. 17", radiance(rough(OrenNayarQualitative, 30), 75), ORANGE, "-.", 1.4),
        ("Fujii", radiance(rough(Fujii, 30), 75), GREEN, ":", 1.6),
    )
    for label, values, colour, style, width in curves:
        axes.plot(VIEWS, 1000 * values, style, color=colour, linewidth=width, label=label)
    lambert = 900 / np.pi * np.cos(np.radians(75))
    axes.axhline(lambert, color="#999999", linewidth=1, label="Lambert")
    axes.set_ylim(bottom=0)
    axes.legend(frameon=False, fontsize="small")

    def slope(values: Tensor, start: int, end: int) -> float:
        return 1000 * float(values[end == VIEWS] - values[start == VIEWS])

    # The middle section: a constant and a multiple of tan θr, fitted over 0 to 75 degrees.
    middle = (VIEWS >= 0) & (VIEWS <= 75)
    columns = torch.stack([torch.ones(171, dtype=torch.float64), torch.deg2rad(VIEWS).tan()], dim=-1)[middle]
    fitted = columns @ torch.linalg.lstsq(columns, once[middle, None]).solution
    off = float((fitted[:, 0] - once[middle]).abs().max() / once.max())
    rows = ["| θr | " + " | ".join(f"{int(t)}°" for t in _TABLE) + " |", "| --- |" + " --- |" * len(_TABLE)]
    at = (VIEWS[:, None] == torch.tensor(_TABLE, dtype=torch.float64)).double().argmax(0)
    for label, values in (("direct", once), ("total", both), ("eq. 14-16", curves[2][1]), ("eq. 17", curves[3][1])):
        rows.append(f"| {label} | " + " | ".join(f"{1000 * float(v):.1f}" for v in values[at]) + " |")
    measured = (
        f"In units of 1000 Lr/E0: the maximum, {1000 * float(both[VIEWS == 85]):.1f} against {lambert:.1f} of Lambert, "
        "lies toward the source. "
        f"Before θr = 75° the radiance rises by {slope(both, 74, 75):.1f} a degree, after it by "
        f"{slope(both, 75, 76):.1f}. From 0 to 75° the direct part is "
        f"C1 + C2 tan θr to {off:.0e} of its maximum. At −75° interreflection is "
        f"{float(1 - once[VIEWS == -75] / both[VIEWS == -75]):.0%} of the radiance.\n\n" + "\n".join(rows)
    )
    return Drawn(figure, measured)


_TABLE = (-85, -75, -60, -45, -30, -15, 0, 15, 30, 45, 60, 70, 75, 80, 85)


def figure_6() -> Drawn:
    figure = Figure(figsize=(11, 4.2), layout="constrained")
    brdf = rough(OrenNayarExact, 40, nodes=FINE)
    inside = axes_of(figure, 1, 2, 1, ylabel="BRDF (1/sr)")
    for light, colour in zip((0, 30, 45, 60, 75), (BLACK, GREEN, BLUE, PINK, ORANGE), strict=True):
        values = radiance(brdf, light) / np.cos(np.radians(light))
        inside.plot(VIEWS, values, color=colour, label=f"θi = {light}°")
        if light == 0:
            flat = values[VIEWS.abs() <= 60]
    inside.legend(frameon=False)
    outside = axes_of(figure, 1, 2, 2, ylabel="Lr / E0, θi = 75°")
    for azimuth, colour in zip((0, 30, 60, 90), (ORANGE, PINK, BLUE, BLACK), strict=True):
        values = radiance(brdf, 75, azimuth=azimuth)
        outside.plot(VIEWS, values, color=colour, label=f"{azimuth}° out of the plane")
        if azimuth == 90:
            aside = values[VIEWS.abs() <= 60]
    outside.legend(frameon=False)
    for axes, title in ((inside, "(a) in the plane of incidence"), (outside, "(b) out of the plane")):
        axes.set_title(title, fontsize="medium")
        axes.set_ylim(bottom=0)
    measured = (
        f"At θi = 0 the BRDF varies by {float(flat.max() / flat.min() - 1):.0%} up to 60° from the normal (at θi = 75° "
        "by a factor of "
        f"{float(radiance(brdf, 75)[VIEWS.abs() <= 60].max() / radiance(brdf, 75)[VIEWS.abs() <= 60].min()):.1f}); "
        f"90° out of the plane the radiance at θi = 75° varies by {float(aside.max() / aside.min() - 1):.0%}."
    )
    return Drawn(figure, measured)


def sample(name: str) -> Callable[[], Drawn]:
    def draw() -> Drawn:
        figure = Figure(figsize=(7, 4.2), layout="constrained")
        axes = axes_of(figure, ylabel="Lr / E0")
        brdf = preset(name)
        parts = []
        for light, colour in zip((30, 45, 60), (BLACK, BLUE, ORANGE), strict=True):
            values = radiance(brdf, light)
            axes.plot(VIEWS, values, color=colour, label=f"θi = {light}°")
            near, far = float(values[light == VIEWS]), float(values[-light == VIEWS])
            rise = float(values[VIEWS == -85]) / float(values[VIEWS == -60])
            parts.append(
                f"{light}°: toward the light {near:.3f}, mirror side {far:.3f}, rise from −60 to −85° {rise:.2f}"
            )
        axes.set_ylim(bottom=0)
        axes.legend(frameon=False)
        return Drawn(figure, "Lr/E0 at " + ". At ".join(parts) + ".")

    return draw


FIGURES: dict[str, Entry] = {
    "oren-nayar-05": Entry(
        "Oren & Nayar 1994, figure 5: σ = 30°, ρ = 0.90, light at 75°, in the plane of incidence",
        "Radiance grows toward the source and stops growing where θr passes θi, whatever the roughness; in the middle "
        "it follows a constant plus a multiple of tan θr; on the forward side most of it is interreflection, the gap "
        "between the two curves.",
        figure_5,
    ),
    "oren-nayar-06": Entry(
        "Oren & Nayar 1994, figure 6: σ = 40°, ρ = 0.90",
        "(a) The BRDF is nearly Lambertian for light along the normal and backscatters more as the light tilts. "
        "(b) With the viewer in the plane perpendicular to that of incidence the surface looks nearly Lambertian.",
        figure_6,
    ),
    "oren-nayar-08": Entry(
        "Oren & Nayar 1994, figure 8: wall plaster (sample A), σ = 30°, ρ = 0.90",
        "Radiance increases toward the source for light at 30°, 45° and 60°, unlike a glossy or Lambertian surface; "
        "the integral (eq. 13) follows the measurement but for a small opposition peak, which is another effect.",
        sample("plaster"),
    ),
    "oren-nayar-09": Entry(
        "Oren & Nayar 1994, figure 9: white sand (sample B), σ = 35°, ρ = 0.80",
        "As figure 8.",
        sample("sand"),
    ),
    "oren-nayar-10": Entry(
        "Oren & Nayar 1994, figure 10: foam (sample C), σ = 20°, ρ = 0.80, ks/kb = 0.019",
        "Body reflection (functional approximation) and surface reflection of the same V-cavities: beside the rise "
        "toward the source there is a second one on the forward side at grazing angles.",
        sample("foam"),
    ),
    "oren-nayar-11": Entry(
        "Oren & Nayar 1994, figure 11: cotton towel (sample D), σ = 42°, ρ = 0.75, ks/kb = 0.085",
        "As figure 10, with rougher facets and a stronger surface reflection.",
        sample("towel"),
    ),
}
