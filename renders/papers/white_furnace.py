"""The albedo of every component of Li & Torrance 2005 against the angle of incidence."""

from __future__ import annotations

import math

import torch
from matplotlib.figure import Figure

from matest.brdf import Brdf, Coherent, DirectionalDiffuse, FirstSurfaceDiffuse, ForwardScattering, SubsurfaceDiffuse
from matest.brdf.he_torrance import HeTorrance
from matest.shading import reflectance
from papers.drawing import BLACK, BLUE, GREEN, ORANGE, PINK, Drawn, Entry

# Sample #41's lengths; index 1.5 below the surface; a source wide enough for the quadrature, and a smoother surface
# that reflects some of it as a mirror does.
ROUGH = {"height_rms": 0.86, "correlation_length": 4.99}
SMOOTH = {"height_rms": 0.05, "correlation_length": 1.0, "wavelength": 0.55, "solid_angle": 0.1}
COMPONENTS: dict[str, tuple[Brdf, str, str]] = {
    "directional": (DirectionalDiffuse(k_dd=1.0, f0=1.0, **ROUGH), BLUE, "-"),
    "directional, masking off": (DirectionalDiffuse(k_dd=1.0, f0=1.0, masking="off", **ROUGH), BLUE, ":"),
    "first-surface uniform": (FirstSurfaceDiffuse(k_udf=1.0), BLACK, "-"),
    "subsurface uniform": (SubsurfaceDiffuse(k_uds=1.0, f0=0.04), GREEN, "-"),
    "forward, × 100": (ForwardScattering(k_fs=1.0, f0=0.04, **ROUGH), ORANGE, "-"),
    "coherent": (Coherent(k_dd=1.0, f0=1.0, **SMOOTH), PINK, "-"),
    "He-Torrance, all": (HeTorrance(k_dd=1.0, k_ud=0.0, f0=1.0, coherent="on", **SMOOTH), PINK, "--"),
}
_ANGLES, _SHOWN = torch.arange(0, 89, dtype=torch.float64), (0, 60, 75, 85)


def white_furnace() -> Drawn:
    figure = Figure(figsize=(8, 4.6), layout="constrained")
    axes = figure.add_subplot()
    rows = ["| component | " + " | ".join(f"{angle}°" for angle in _SHOWN) + " |", "| --- |" + " ---: |" * len(_SHOWN)]
    cos = torch.deg2rad(_ANGLES).cos()[:, None]
    for name, (brdf, colour, style) in COMPONENTS.items():
        scale = 100 if "100" in name else 1
        albedo = scale * reflectance(brdf, cos)[:, 0]
        axes.plot(_ANGLES, albedo, color=colour, linestyle=style, label=name)
        rows.append(f"| {name} | " + " | ".join(f"{float(albedo[angle]):.3f}" for angle in _SHOWN) + " |")
    axes.axhline(1, color="#999999", linewidth=0.8)
    axes.set(xlabel="angle of incidence (degrees)", ylabel="albedo", xlim=(0, 88), ylim=(0, 1.5))
    axes.legend(frameon=False, fontsize="small", ncols=2, loc="upper left")
    apart = math.degrees(math.acos(1 - SMOOTH["solid_angle"] / (2 * math.pi)))
    measured = (
        "Albedo at all scale factors 1, F = 1 for the directional and coherent light, f0 = 0.04 below the surface; "
        f"σ/τ of sample #41, for the coherent light σ = 0.05 µm and a source of {apart:.0f}° radius. Of these "
        "components only the directional lobe without masking comes above 1; He-Torrance, beside them, does by 0.4 %."
        "\n\n" + "\n".join(rows)
    )
    return Drawn(figure, measured)


FIGURES: dict[str, Entry] = {
    "li-torrance-furnace": Entry(
        "Li & Torrance 2005: white furnace",
        "No such figure: the paper asks that no component reflect more than arrives.",
        white_furnace,
    )
}
