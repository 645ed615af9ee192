"""How near samples come to the centre of a highlight: whether they can show what shapes it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch

from matest.photographs.samples import PhotographSamples
from matest.shading import gathered_light, lit_directions


@dataclass(frozen=True)
class Nearness:
    """Smallest angles between half vector and normal, which coincide at the centre of a highlight (radians).

    Attributes:
        usable: of all samples; infinite if there is none.
        lit: of all pixels that light reaches, also those that cannot be used (clipped, rim, shadow edge).
    """

    usable: float
    lit: float

    @classmethod
    def of(cls, samples: PhotographSamples) -> Nearness:
        """The smallest angles over all images and lights."""
        scene = samples.photographs.scene
        usable, lit = [math.inf], [math.inf]
        for position, image in enumerate(samples.images):
            points = scene.points(image, dtype=torch.float64)
            if not points.wi.shape[-2]:
                continue
            reached = gathered_light(points).amax(-1) > 0
            angles = torch.where(reached, lit_directions(points).theta_half[..., 0], math.inf).amin(-1).numpy()
            # Distant lights and a distant camera may give one angle for all pixels.
            angles = np.broadcast_to(angles, len(scene.surface))
            usable.append(float(angles[samples.indices(position)].min(initial=math.inf)))
            lit.append(float(angles.min(initial=math.inf)))
        return cls(min(usable), min(lit))
