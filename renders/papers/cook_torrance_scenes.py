"""Figures 6 to 8 of Cook & Torrance 1982: vases of plastic, metals and nonmetals, and a watch band."""

from __future__ import annotations

import dataclasses

import numpy as np
import torch
from torch import Tensor

from matest import spectra
from matest.brdf import CookTorrance, preset
from matest.brdf.fresnel import conductor
from matest.scene import Points
from matest.shading import SKY_COSINES, gathered_light, reflectance
from matest.simulate import SimulatedScene
from papers.drawing import Drawn, Entry
from papers.rendered import Panel, rendered, scene_of, sheet

# The six metals of figure 7 are not named in the text: these have tables of n and k.
METALS = ("copper", "gold", "silver", "aluminium", "tungsten", "nickel")
# Colours of the nonmetals of Table I, f0 in linear RGB: assumed, as the paper prints weights and slopes only.
NONMETALS = {
    "carbon": (0.035, 0.035, 0.035),
    "rubber": (0.06, 0.055, 0.05),
    "obsidian": (0.045, 0.045, 0.05),
    "lunar-dust": (0.12, 0.115, 0.105),
    "olive-drab": (0.07, 0.075, 0.03),
    "rust": (0.13, 0.05, 0.02),
}
# Finish of the metal vases: Beckmann of slopes 0.4 and 0.2 with weights 0.4 and 0.6.
FINISH = {"diffuse": 0.0, "specular": 1.0, "slope": 0.4, "slope_2": 0.2, "weight_2": 0.6, "lobes": "2"}
# Angles between which the colours of metals are interpolated: a quarter of a degree apart.
ANGLES = torch.linspace(0, torch.pi / 2, 361, dtype=torch.float64)
# Chromium stands for the stainless steel of the watch, of which there is no table.
STEEL = "chromium"


def rgb_of(metal: str, cos_d: Tensor) -> Tensor:
    """Colour [..., 3] of the light that a metal reflects at half the angle between light and view, cos [..., 1].

    R, G, B of the exact Fresnel reflectance over the visible wavelengths under D65, tabulated over the angle.
    """
    eta, k = spectra.optical_constants(metal).at(spectra.VISIBLE)
    table = spectra.desaturate(spectra.to_rgb(conductor(ANGLES.cos()[:, None], eta, k))).numpy()
    angle = torch.arccos(cos_d[..., 0].double().clamp(max=1)).numpy()
    return torch.from_numpy(np.stack([np.interp(angle, ANGLES.numpy(), channel) for channel in table.T], axis=-1))


def spectral_radiance(metal: str, points: Points) -> Tensor:
    """Radiance [n, 3] of points on a vase of a metal with the finish of figure 6, from its spectra of n and k.

    Of the model only F depends on the wavelength, and only on the half angle: each light's lobe with F = 1 is
    multiplied by the colour of F there. `points` are lit by grey light. The sky's part is integrated every 10 nm.
    """
    lobe = CookTorrance(**FINISH, f0=1.0, fresnel="schlick")  # type: ignore[arg-type]
    wo = points.wo[:, None]
    cos_d = (0.5 * (1 + (points.wi * wo).sum(-1, keepdim=True))).clamp(min=0).sqrt()
    light = (lobe(points.wi, wo) * gathered_light(points)[..., :1] * rgb_of(metal, cos_d)).sum(1)
    coarse = spectra.VISIBLE[::2]
    eta, k = spectra.optical_constants(metal).at(coarse)
    cosines = torch.linspace(0, 1, SKY_COSINES)[:, None]
    sky = CookTorrance(**FINISH, eta=eta, k=k, fresnel="conductor")  # type: ignore[arg-type]
    colours = spectra.desaturate(spectra.to_rgb(reflectance(sky, cosines), coarse)).numpy()
    of_sky = np.stack([np.interp(points.wo[:, 2], cosines[:, 0], channel) for channel in colours.T], axis=-1)
    assert points.ambient is not None
    return light + points.ambient[:, :1] * torch.from_numpy(of_sky)


def spectral(scene: SimulatedScene, metal: str) -> np.ndarray:
    """Radiance [H, W, 3] of a vase of a metal, averaged over the rays of each pixel."""
    values = spectral_radiance(metal, scene.scene.points(0)).numpy()
    rays = scene.scene.surface.image(values)
    n = scene.supersampling
    return rays.reshape(rays.shape[0] // n, n, rays.shape[1] // n, n, 3).mean((1, 3))


def brightest(image: np.ndarray) -> np.ndarray:
    """R, G, B of the brightest pixel, red = 1."""
    pixels = image.reshape(-1, 3)
    peak = pixels[pixels.sum(1).argmax()]
    return peak / peak[0]


def figure_6() -> Drawn:
    scene = scene_of("cook-torrance-06")
    plastic, copper = preset("plastic-vase"), preset("copper-vase")
    printed = dataclasses.replace(plastic, normalisation="paper1982")
    body = printed.replace({"specular": torch.zeros(())})
    images = {name: rendered(scene, brdf) for name, brdf in (("p", plastic), ("q", printed), ("c", copper))}
    # Of the plastic's brightest place only what its surface adds to the body.
    matte = (1 - float(plastic.specular)) * rendered(scene, body)  # type: ignore[attr-defined]
    gloss = {name: images[name] - matte for name in "pq"}
    share = {name: float((image.sum(-1) / images[name].sum(-1).clip(min=1e-9)).max()) for name, image in gloss.items()}
    rows = [
        [
            Panel(images["q"], "plastic, lobe as printed", 0.75),
            Panel(images["p"], "plastic, lobe normalised", 0.75),
            Panel(images["c"], "copper", 1.6),
        ]
    ]
    plastic_body, highlight, metal = brightest(matte), brightest(gloss["q"]), brightest(images["c"])
    measured = (
        f"R : G : B of the plastic's body is {ratio(plastic_body)}, of what the surface adds to it at its brightest "
        f"{ratio(highlight)}: white. Copper's highlight is {ratio(metal)}, the colour of the metal. The paper prints "
        "the lobe without the 1/π of its D: four times what a mirror can reflect. As printed the surface is up to "
        f"{share['q']:.0%} of the plastic's light, normalised {share['p']:.0%}, which the eye hardly sees: with s = "
        "0.1, plastic looks like plastic only as printed. Both vases stand under the same lights; the plastic is shown "
        "with white at radiance 0.75, the copper at 1.6. The presets are in RGB, the copper with the paper's colour "
        "shift."
    )
    return Drawn(sheet(rows), measured)


def ratio(colour: np.ndarray) -> str:
    return " : ".join(f"{value:.2f}" for value in colour)


def figure_7() -> Drawn:
    scene = scene_of("cook-torrance-07")
    metals, table = [], ["| metal | R : G : B, brightest | by Schlick's F in RGB, rms | by the paper's shift |"]
    table.append("| --- | --- | --- | --- |")
    for name in METALS:
        image = spectral(scene, name)
        metals.append(Panel(image, name, 1.8))
        f0 = spectra.metal_colour(name).clamp(max=1)
        mean = float(spectra.normal_reflectance(*spectra.optical_constants(name).at(spectra.VISIBLE)).mean())
        errors = [
            float(np.sqrt(((rendered(scene, brdf) - image) ** 2).sum() / (image**2).sum()))
            for brdf in (
                CookTorrance(**FINISH, f0=f0, fresnel="schlick"),  # type: ignore[arg-type]
                CookTorrance(**FINISH, f0=f0, f0_mean=mean, fresnel="colour-shift"),  # type: ignore[arg-type]
            )
        ]
        table.append(f"| {name} | {ratio(brightest(image))} | {errors[0]:.2%} | {errors[1]:.2%} |")
    nonmetals = [Panel(rendered(scene, preset(name, f0)), name, 0.14) for name, f0 in NONMETALS.items()]
    spread = {}
    for panel in nonmetals:
        pixels = panel.radiance[panel.radiance[..., 0] > 0].sum(-1)
        spread[panel.title] = float(np.quantile(pixels, 0.999) / np.median(pixels))
    words = ", ".join(f"{name} {value:.1f}" for name, value in sorted(spread.items(), key=lambda item: -item[1]))
    measured = (
        "Metals from their n and k at 85 wavelengths under D65, shown with white at radiance 1.8; nonmetals with white "
        "at 0.14, their colours assumed (Table I has weights and slopes only). Every highlight has the material's "
        "colour. Gloss, as the brightest thousandth over the median of the vase: " + words + "; lunar dust has no "
        "surface reflection at all. Below: how far three numbers instead of 85 are from the spectral render, relative "
        "rms; gold's red, 1.02, is then cut to 1.\n\n" + "\n".join(table)
    )
    return Drawn(sheet([metals, nonmetals]), measured)


def figure_8() -> Drawn:
    scene = scene_of("cook-torrance-08")

    def link(metal: str, slope: float | Tensor) -> np.ndarray:
        f0 = spectra.metal_colour(metal).clamp(max=1)
        return rendered(scene, CookTorrance(diffuse=0.0, slope=slope, f0=f0, fresnel="schlick"))  # type: ignore[arg-type]

    slopes = (0.1, 0.2, 0.4)
    plain = [link("gold", slope) for slope in slopes]
    white = 1.2
    row = [Panel(image, f"gold, slope {slope}", white) for image, slope in zip(plain, slopes, strict=True)]
    # Rough inside, smooth at the border: a slope for every ray.
    positions = scene.scene.surface.positions
    assert positions is not None
    inside = (positions[:, 0].abs() < 0.75) & (positions[:, 1].abs() < 0.24)
    patterned = link("gold", torch.where(inside, 0.4, 0.15)[:, None].double())
    steel = link(STEEL, 0.2)
    band = np.concatenate([patterned, steel, patterned], axis=1)
    rows = [row, [Panel(np.concatenate([band, band]), "gold rough inside a smooth border; chromium between", white)]]
    peaks = [image.sum(-1).max() for image in plain]
    areas = [float((image.sum(-1) > peak / 2).mean()) for image, peak in zip(plain, peaks, strict=True)]
    measured = (
        f"From slope 0.1 to 0.2 and 0.4 gold's highlight is {peaks[0] / peaks[1]:.1f} and {peaks[0] / peaks[2]:.1f} "
        f"times fainter, and covers {areas[1] / areas[0]:.1f} and {areas[2] / areas[0]:.1f} times the area (pixels "
        f"above half of its peak). R : G : B is {ratio(brightest(plain[0]))} on gold and {ratio(brightest(steel))} on "
        f"chromium, which stands for the steel. White is at radiance {white:g}. The diodes of the watch glow, and are "
        "left out."
    )
    return Drawn(sheet(rows), measured)


FIGURES: dict[str, Entry] = {
    "gallery/cook-torrance-06": Entry(
        "Cook & Torrance 1982, figure 6: a copper-coloured plastic vase and a copper vase",
        "A white highlight on a coloured body makes plastic. The copper vase, without a body and with a highlight of "
        "copper's own colour from two slopes, does not look like plastic.",
        figure_6,
    ),
    "gallery/cook-torrance-07": Entry(
        "Cook & Torrance 1982, figure 7: vases of six metals and of the six nonmetals of Table I",
        "Specular and diffuse light have one colour on each vase, and all stand under the lights of figure 6. The "
        "metals differ in their reflectance spectra alone, the nonmetals also in weight and slope.",
        figure_7,
    ),
    "gallery/cook-torrance-08": Entry(
        "Cook & Torrance 1982, in the spirit of figure 8, a watch: several metals, and several roughnesses of one",
        "A gold outer band, whose links have a rougher inside than border, and an inner band of stainless steel, under "
        "a single light; diodes that glow red.",
        figure_8,
    ),
}
