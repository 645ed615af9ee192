"""Light sources: distant and near."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from matest.errors import InputError


@dataclass(frozen=True)
class DirectionalLight:
    """A distant light.

    Args:
        direction: unit vector to the light, [3].
        irradiance: on a surface facing the light, [C].
        solid_angle: of the source in sr, if known.
    """

    direction: Tensor
    irradiance: Tensor
    solid_angle: float | None = None

    def at(self, positions: Tensor | None) -> tuple[Tensor, Tensor]:  # noqa: ARG002
        """Unit vectors to the light [1, 3] and irradiance of a surface facing it [1, C]."""
        return self.direction[None], self.irradiance[None]

    def to(self, dtype: torch.dtype, device: torch.device | str) -> DirectionalLight:
        return DirectionalLight(self.direction.to(device, dtype), self.irradiance.to(device, dtype), self.solid_angle)


@dataclass(frozen=True)
class PointLight:
    """A near light that radiates evenly.

    Args:
        position: in world units, [3].
        intensity: irradiance at unit distance, [C].
        solid_angle: of the source in sr as seen from the target, if known.
    """

    position: Tensor
    intensity: Tensor
    solid_angle: float | None = None

    def at(self, positions: Tensor | None) -> tuple[Tensor, Tensor]:
        """Unit vectors to the light [N, 3] and irradiance of a surface facing it [N, C] at `positions` [N, 3]."""
        if positions is None:
            raise InputError(
                "a point light needs the surface's positions: give a mesh, or positions beside the normal map."
            )
        offset = self.position - positions
        squared = (offset * offset).sum(-1, keepdim=True)
        return offset / squared.sqrt(), self.intensity / squared

    def to(self, dtype: torch.dtype, device: torch.device | str) -> PointLight:
        return PointLight(self.position.to(device, dtype), self.intensity.to(device, dtype), self.solid_angle)


Light = DirectionalLight | PointLight


def unit_direction(direction: list[float], label: str) -> Tensor:
    """`direction` normalised.

    Raises:
        InputError: zero, NaN or infinite.
    """
    vector = torch.tensor(direction, dtype=torch.float64)
    length = float(vector.norm())
    if not math.isfinite(length) or length == 0:
        raise InputError(
            f"{label}: direction must be a finite vector pointing to the light; got {direction}. Give x, y, z with at "
            "least one non-zero."
        )
    return vector / length
