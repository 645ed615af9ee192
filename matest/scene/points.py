"""Lit surface points: all that shading needs to know of geometry and light."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor


@dataclass(frozen=True)
class Points:
    """Geometry and light of a batch of surface points, in their local frames. Sizes of 1 broadcast.

    Attributes:
        wi: unit vectors to each of L lights [..., L, 3].
        wo: unit vectors to the viewer [..., 3].
        irradiance: of a surface facing each light, 0 where the light is blocked [..., L, C].
        ambient: ambient radiance times the unoccluded fraction of the sky [..., C]; None where there is none.
    """

    wi: Tensor
    wo: Tensor
    irradiance: Tensor
    ambient: Tensor | None = None

    def __getitem__(self, index: slice) -> Points:
        """Some of the points of a batch [n, …]."""
        parts = (self.wi, self.wo, self.irradiance)
        ambient = self.ambient if self.ambient is None or len(self.ambient) == 1 else self.ambient[index]
        wi, wo, irradiance = (part if len(part) == 1 else part[index] for part in parts)
        return Points(wi, wo, irradiance, ambient)
