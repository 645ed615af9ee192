"""Materials that every target is tried on."""

from __future__ import annotations

from typing import Any

import torch

from matest.benchmark.suites.export import FOAM, GLOSS, METAL, PAPER, SMITH_GLOSS
from matest.brdf import CookTorrance, Eon, Fujii, Lambert, LiTorrance, OrenNayar, OrenNayarQualitative, Ward, preset
from matest.brdf.base import Brdf

__all__ = ["BRUSHED", "FOAM", "GLOSS", "METAL", "NATIVE", "PAPER", "PLUGGED", "SMITH_GLOSS", "even_pairs"]

_GOLD: dict[str, Any] = {"fresnel": "conductor", "eta": [0.2, 0.4, 1.4], "k": [3.1, 2.3, 1.8]}

# Facets that are steeper along the tangent than along the bitangent.
BRUSHED = Ward([0.2, 0.15, 0.1], 0.6, slope_x=0.3, slope_y=0.1, anisotropy="axes", form="bounded")

# What Mitsuba has itself.
NATIVE: dict[str, Brdf] = {
    "lambert": Lambert([0.5, 0.4, 0.3]),
    "gloss": SMITH_GLOSS,
    "metal": METAL,
    "ggx": CookTorrance(0.2, 0.5, 0.3, distribution="ggx", masking="smith"),
    # Under lights of unknown scale an albedo may exceed 1.
    "relative": CookTorrance(0.2, 1.0, 0.1, masking="smith").replace(
        {"diffuse": torch.tensor([1.4, 1.2, 0.3], dtype=torch.float64)}
    ),
}
# What the plugin adds.
PLUGGED: dict[str, Brdf] = {
    "v-cavities": GLOSS,
    "gaussian": CookTorrance(0.1, 0.7, 0.15, distribution="gaussian", normalisation="ngan"),
    "ggx-schlick": CookTorrance(
        0.1, 1.0, 0.2, distribution="ggx", masking="smith", fresnel="schlick", f0=[0.9, 0.5, 0.3]
    ),
    "smith-schlick": CookTorrance(0.0, 1.0, 0.2, masking="smith", fresnel="schlick", f0=[0.9, 0.5, 0.3]),
    "conductor": CookTorrance(0.1, 0.8, 0.15, **_GOLD),
    "three-slopes": CookTorrance(0.1, 0.7, 0.15, lobes="3", weights="complementary"),
    "copper-vase": preset("copper-vase"),
    "oren-nayar": OrenNayar([0.9, 0.5, 0.3], 0.6),
    "qualitative": OrenNayarQualitative([0.9, 0.5, 0.3], 0.6),
    "fujii": Fujii([0.9, 0.5, 0.3], 0.6),
    "eon": Eon([0.9, 0.5, 0.3], 0.6),
    "foam": FOAM,
    "laser-paper": PAPER,
    "ground-glass": preset("ground-glass"),
    "ward": Ward([0.2, 0.15, 0.1], 0.3, 0.2),
    "brushed": BRUSHED,
    "brushed-duer": Ward(0.2, 0.3, slope_x=0.1, slope_y=0.4, anisotropy="axes", form="duer"),
    "brushed-paper": LiTorrance(
        k_fs=2.0, forward="on", anisotropy="printed", height_rms=0.6, correlation_length_x=3.0, correlation_length_y=9.0
    ),
    "brushed-corrected": LiTorrance(
        anisotropy="corrected", height_rms=0.6, correlation_length_x=9.0, correlation_length_y=3.0
    ),
    "reciprocal": LiTorrance(k_fs=2.0, forward="on", law="reciprocal", uniform="on", k_udf=0.1, masking="off"),
}


def even_pairs(count: int, seed: int = 5) -> tuple[torch.Tensor, torch.Tensor]:
    """Directions spread evenly over both hemispheres up to 80° from the normal, by rejection from normal numbers."""
    generator = torch.Generator().manual_seed(seed)
    vectors = torch.randn(2, 8 * count, 3, generator=generator, dtype=torch.float64)
    wi, wo = vectors / vectors.norm(dim=-1, keepdim=True)
    kept = (torch.minimum(wi[:, 2], wo[:, 2]) > 0.17364817766693033).nonzero()[:count, 0]
    return wi[kept], wo[kept]
