"""Figures 3 and 5 of Cook & Torrance 1982."""

from __future__ import annotations

import numpy as np
import torch
from matplotlib.figure import Figure

from matest import spectra
from matest.brdf.fresnel import colour_shift_weight, conductor
from matest.brdf.microfacet import beckmann, gaussian
from matest.brdf.presets import average_reflectance
from matest.directions import Directions
from papers.drawing import BLACK, BLUE, GREEN, ORANGE, PINK, Drawn, Entry, direction


def figure_3() -> Drawn:
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


def figure_5() -> Drawn:
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
    "cook-torrance-03": Entry(
        "Cook & Torrance 1982, figure 3: slope distributions around the mirror direction",
        "A small rms slope m gives a narrow distribution about the mirror direction (a, b), a large one spreads it "
        "out (c, d); Beckmann's and the Gaussian look alike.",
        figure_3,
    ),
    "cook-torrance-05": Entry(
        "Cook & Torrance 1982, figure 5: the colour of copper against the angle of incidence",
        "(a) Reflectance against wavelength and angle tends to 1 at grazing incidence. (b) The colour under D6500 "
        "shifts toward that of the light, noticeably only near grazing. (c) Interpolating colours by the Fresnel term "
        "of the average reflectance gives a similar result.",
        figure_5,
    ),
}
