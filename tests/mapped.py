"""A sphere of two colours, its photographs, and an estimate with a map: for tests of what is done with maps."""

from __future__ import annotations

from functools import cache

import numpy as np
import torch
from torch import Tensor

import matest
from matest.brdf import OrenNayar
from matest.capture import Capture
from matest.estimation.result import Estimate
from tests.simulated import Studio

STUDIO = Studio(size=48)
SIGMA = 0.4


def albedo() -> Tensor:
    """Of every pixel [N, 1]: brighter on the right."""
    surface = STUDIO.scene.surface
    right = surface.pixels % surface.shape[1] >= surface.shape[1] // 2
    return torch.from_numpy(np.where(right, 0.7, 0.3))[:, None]


@cache
def photographs() -> Capture:
    return STUDIO.photograph(OrenNayar(albedo(), SIGMA), seed=1)


@cache
def mapped() -> Estimate:
    """Of all photographs but the last."""
    return matest.estimate(photographs(), "oren-nayar", maps="albedo", holdout=[len(STUDIO.lights) - 1])
