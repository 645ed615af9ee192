"""How sharply a material's reflection changes with the direction of the light."""

from __future__ import annotations

import math

import torch

from matest.brdf.base import Brdf

# Curvature that stands for a material which is not known, 1/rad²: that of a highlight of rms slope 0.05.
SHARPEST = 200.0
# Polar angles of the viewer that are tried, rad: toward grazing lobes narrow, and are dim for it.
_VIEWS = (0.0, 0.6)
# Step between the directions of the light, rad: a highlight of rms slope 0.005 has three in its width.
_STEP = 0.004
# Largest polar angle of the light, rad.
_GRAZING = 1.5


def curvature(brdf: Brdf) -> float:
    """Curvature 1/s² at its peak of the Gaussian lobe that is as steep as f cos θi at its steepest, 1/rad².

    The slope of a Gaussian is e^(−1/2)/s of its peak at most. (The second derivative itself is infinite where masking
    has a kink, which matters little to an integral.) Directions run through the plane of incidence, and across it
    through that of mirror reflection; values of a material that differ from point to point count as one each.
    """
    values = brdf.to(torch.float64, "cpu")
    count = int(_GRAZING / _STEP)
    angle = torch.arange(-count, count + 1, dtype=torch.float64) * _STEP
    along = torch.stack([angle.sin(), torch.zeros_like(angle), angle.cos()], dim=-1)
    steepest = 0.0
    for polar in _VIEWS:
        viewer = torch.tensor([math.sin(polar), 0.0, math.cos(polar)], dtype=torch.float64)
        mirrored = torch.tensor([-math.sin(polar), 0.0, math.cos(polar)], dtype=torch.float64)
        across = angle.cos()[:, None] * mirrored + angle.sin()[:, None] * angle.new_tensor([0.0, 1.0, 0.0])
        for toward in (along, across):
            # A parameter with values at points has them in front of its channels.
            reflected = values(toward[:, None], viewer[None, None]) * toward[:, None, 2:].clamp(min=0)
            peak = reflected.amax(0).clamp(min=torch.finfo(torch.float64).tiny)
            slope = reflected.diff(dim=0).abs().amax(0) / _STEP
            steepest = max(steepest, float((slope / peak).max()))
    return math.e * steepest**2
