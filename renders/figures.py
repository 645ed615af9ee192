"""Draw the model curves of the papers' figures into `renders/figures/`: `python renders/figures.py [NUMBER...]`.

Each figure comes with what its paper says of it and what the curves here measure, in `figures/README.md`. The figures
of Cook & Torrance need the optical constants of copper: `pip install "matest-brdf[metals]"`.
"""

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
from torch import Tensor

from matest import spectra
from matest.brdf import Brdf, Fujii, OrenNayar, OrenNayarExact, OrenNayarQualitative, preset
from matest.brdf.fresnel import colour_shift_weight, conductor
from matest.brdf.microfacet import beckmann, gaussian
from matest.brdf.presets import average_reflectance
from matest.directions import Directions

HERE = Path(__file__).parent / "figures"
BLACK, ORANGE, BLUE, GREEN, PINK = "#000000", "#D55E00", "#0072B2", "#009E73", "#CC79A7"
VIEWS = torch.linspace(-85, 85, 171, dtype=torch.float64)  # degrees; negative = away from the light
FINE = "48x64"


class Drawn(NamedTuple):
    """A figure, and one or two sentences on what it shows in numbers."""

    figure: Figure
    measured: str


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


def direction(theta: Tensor | float, azimuth: float = 0.0) -> Tensor:
    """Unit vectors [..., 3] at polar angles in degrees; negative angles lie across the normal."""
    angle, turn = torch.deg2rad(torch.as_tensor(theta, dtype=torch.float64)), np.radians(azimuth)
    return torch.stack([angle.sin() * np.cos(turn), angle.sin() * np.sin(turn), angle.cos()], dim=-1)


def radiance(brdf: Brdf, light: float, views: Tensor = VIEWS, azimuth: float = 0.0) -> Tensor:
    """L/E0 in the plane at `azimuth` from the light, light at `light` degrees: f cos θi."""
    return brdf(direction(light), direction(views, azimuth))[..., 0] * np.cos(np.radians(light))


def rough(kind: type[Brdf], sigma: float, **values: Any) -> Brdf:
    return kind(albedo=0.9, sigma=np.radians(sigma), **values)  # type: ignore[call-arg]


def axes_of(figure: Figure, *places: Any, ylabel: str) -> Axes:
    axes = figure.add_subplot(*places)
    axes.set_xlabel("θr (degrees; negative: forward)")
    axes.set_ylabel(ylabel)
    axes.set_xticks(range(-90, 91, 30))
    axes.grid(alpha=0.25)
    return axes


def on_5() -> Drawn:
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


def on_6() -> Drawn:
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


def ct_3() -> Drawn:
    figure = Figure(figsize=(9, 7), layout="constrained")
    light, width = 30.0, {}
    angles = torch.linspace(-90, 90, 721, dtype=torch.float64)
    directions = Directions(direction(-light).expand(len(angles), 3), direction(angles))
    for row, slope in enumerate((0.2, 0.6)):
        for column, (name, distribution) in enumerate((("Beckmann", beckmann), ("Gaussian", gaussian))):
            axes = figure.add_subplot(2, 2, 1 + 2 * row + column, projection="polar")
            values = distribution(directions, torch.tensor(slope, dtype=torch.float64))[:, 0]
            axes.plot(torch.deg2rad(angles), values / values.max(), color=BLUE)
            axes.plot([-np.radians(light), 0], [1.1, 0], color=ORANGE, linewidth=1)
            axes.plot([np.radians(light), 0], [1.1, 0], color=ORANGE, linewidth=1, linestyle=":")
            axes.set_theta_zero_location("N")
            axes.set_theta_direction(-1)
            axes.set_thetamin(-90)
            axes.set_thetamax(90)
            axes.set_rticks([])
            axes.set_title(f"({'abcd'[2 * row + column]}) {name}, m = {slope}", fontsize="medium")
            width[name, slope] = float((values > values.max() / 2).sum()) * 0.25
    measured = "Full width at half maximum: " + ", ".join(
        f"{name} m = {slope} {degrees:.1f}°" for (name, slope), degrees in width.items()
    )
    return Drawn(figure, measured + ".")


def ct_5() -> Drawn:
    copper = spectra.optical_constants("copper")
    wavelengths = spectra.VISIBLE
    eta, k = copper.at(wavelengths)
    theta = torch.linspace(0, 90, 181, dtype=torch.float64)
    cos = torch.deg2rad(theta).cos()[:, None]
    reflectance = conductor(cos, eta, k)
    exact = spectra.to_rgb(reflectance)
    # The paper's interpolation: from the colour at 0 to white, as F of the average normal reflectance rises.
    mean = torch.tensor(average_reflectance("copper"), dtype=torch.float64)
    shift = colour_shift_weight(cos, mean)
    approximate = exact[:1] + (1 - exact[:1]) * shift
    figure = Figure(figsize=(10, 6.5), layout="constrained")
    axes, *strips = figure.subplots(3, 1, height_ratios=(5, 1, 1))
    for angle, colour in zip((0, 30, 60, 75, 85, 89), (BLACK, GREEN, BLUE, PINK, ORANGE, "#999999"), strict=True):
        axes.plot(wavelengths, reflectance[theta == angle][0], color=colour, label=f"θ = {angle}°")
    axes.set_xlabel("wavelength (µm)")
    axes.set_ylabel("reflectance F")
    axes.set_title("(a) a copper mirror, from its n and k", fontsize="medium")
    axes.set_ylim(0, 1.02)
    axes.legend(frameon=False, ncols=2)
    titled = (("(b) its colour under D65", exact), ("(c) interpolated", approximate))
    for strip, (title, colours) in zip(strips, titled, strict=True):
        stored = spectra.desaturate(colours).clamp(0, 1)
        display = torch.where(stored <= 0.0031308, 12.92 * stored, 1.055 * stored ** (1 / 2.4) - 0.055)
        strip.imshow(display[None].numpy(), extent=(0, 90, 0, 1), aspect="auto")
        strip.set_yticks([])
        strip.set_title(title, fontsize="medium")
    strips[-1].set_xlabel("θ (degrees)")
    off = (approximate - exact).abs().amax(-1)
    worst = [f"{float(off[theta <= limit].max()):.3f} up to {limit}°" for limit in (60, 75, 80, 90)]
    half = theta[(exact[:, 2] - exact[0, 2]) > 0.5 * (1 - exact[0, 2])][0]
    measured = (
        f"At normal incidence the colour is {', '.join(f'{float(c):.3f}' for c in exact[0])} (linear RGB, D65); half "
        f"of the shift of blue toward white is reached at {float(half):.1f}°. The interpolation shifts much later: the "
        "dielectric that stands for copper (k = 0) dips below F(0) before it rises. It is off by "
        f"{', '.join(worst)} (largest channel, unit white)."
    )
    return Drawn(figure, measured)


FIGURES: dict[str, Entry] = {
    "oren-nayar-05": Entry(
        "Oren & Nayar 1994, figure 5: σ = 30°, ρ = 0.90, light at 75°, in the plane of incidence",
        "Radiance grows toward the source and stops growing where θr passes θi, whatever the roughness; in the middle "
        "it follows a constant plus a multiple of tan θr; on the forward side most of it is interreflection, the gap "
        "between the two curves.",
        on_5,
    ),
    "oren-nayar-06": Entry(
        "Oren & Nayar 1994, figure 6: σ = 40°, ρ = 0.90",
        "(a) The BRDF is nearly Lambertian for light along the normal and backscatters more as the light tilts. "
        "(b) With the viewer in the plane perpendicular to that of incidence the surface looks nearly Lambertian.",
        on_6,
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
    "cook-torrance-03": Entry(
        "Cook & Torrance 1982, figure 3: slope distributions around the mirror direction",
        "A small rms slope m gives a narrow distribution about the mirror direction (a, b), a large one spreads it "
        "out (c, d); Beckmann's and the Gaussian look alike.",
        ct_3,
    ),
    "cook-torrance-05": Entry(
        "Cook & Torrance 1982, figure 5: the colour of copper against the angle of incidence",
        "(a) Reflectance against wavelength and angle tends to 1 at grazing incidence. (b) The colour under D6500 "
        "shifts toward that of the light, noticeably only near grazing. (c) Interpolating colours by the Fresnel term "
        "of the average reflectance gives a similar result.",
        ct_5,
    ),
}


def main(names: list[str]) -> None:
    """Draw the named figures, or all, and the page that shows them."""
    unknown = [name for name in names if name not in FIGURES]
    if unknown:
        sys.exit(f"no figure {', '.join(unknown)}; there are {', '.join(FIGURES)}.")
    HERE.mkdir(exist_ok=True)
    chosen = {name: entry for name, entry in FIGURES.items() if not names or name in names}
    page = ["# Figures of the papers", "", "Made by `python renders/figures.py`.", ""]
    for name, entry in chosen.items():
        drawn = entry.draw()
        FigureCanvasAgg(drawn.figure).print_png(HERE / f"{name}.png")
        page += [f"## {entry.title}", "", f"![{name}]({name}.png)", ""]
        page += [f"Published: {entry.published}", "", f"Here: {drawn.measured}", ""]
        print(f"{name}: {drawn.measured}", flush=True)
    if len(chosen) == len(FIGURES):
        (HERE / "README.md").write_text("\n".join(page), "utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
