"""Distant and near light sources, which share one protocol, and the light of the sky."""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, Self

import torch
from torch import Tensor

from matest.errors import InputError
from matest.scene.source import Source


class Light(Protocol):
    """A light source as scenes, shading and photographs see it.

    Attributes:
        solid_angle: of the source in sr, if known.
        near: whether direction and irradiance depend on the position on the surface.
        power: irradiance on a facing surface of a distant light, at unit distance of a near one, [C].
        nodes: how many points stand for it; 1 unless its size matters.
    """

    @property
    def solid_angle(self) -> float | None: ...

    @property
    def near(self) -> bool: ...

    @property
    def power(self) -> Tensor: ...

    @property
    def nodes(self) -> int: ...

    def at(self, positions: Tensor | None) -> tuple[Tensor, Tensor]:
        """Unit vectors to the light's middle [1 or N, 3] and irradiance of a surface facing it [1 or N, C].

        Args:
            positions: of the surface in world units [N, 3]; a distant light needs none.

        Raises:
            InputError: a near light without positions.
        """
        ...

    def directions(self, positions: Tensor | None, normals: Tensor, view: Tensor) -> Tensor:
        """Unit vectors to the points that stand for the part above the horizon, [1 or N, nodes, 3].

        Args:
            positions: as above.
            normals: of the surface [N, 3].
            view: unit vectors to the viewer [1 or N, 3].
        """
        ...

    def toward(self, node: int, positions: Tensor | None, normals: Tensor, view: Tensor) -> Tensor:
        """`directions` to one of the points, [1 or N, 3]."""
        ...

    def spread(self, positions: Tensor | None, normals: Tensor, view: Tensor) -> tuple[Tensor, Tensor]:
        """`directions`, and the irradiance of a surface facing each [1 or N, nodes, C]."""
        ...

    def edged(self, node: int) -> bool:
        """Whether the edge of the shadow in the light of a node shows, where a pixel is lit in part."""
        ...

    def distance(self, positions: Tensor) -> Tensor:
        """World units from `positions` [N, 3] to the light, infinite for a distant one, [1 or N]."""
        ...

    @property
    def key(self) -> Hashable:
        """Equal for lights that are stated to be the same to the last digit."""
        ...

    def channel(self, index: int) -> Self:
        """The same light in one channel only, C = 1."""
        ...

    def to(self, dtype: torch.dtype, device: torch.device | str) -> Self: ...


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

    @property
    def near(self) -> bool:
        return False

    @property
    def power(self) -> Tensor:
        return self.irradiance

    @property
    def nodes(self) -> int:
        return 1

    def at(self, positions: Tensor | None) -> tuple[Tensor, Tensor]:  # noqa: ARG002
        return self.direction[None], self.irradiance[None]

    def directions(self, positions: Tensor | None, normals: Tensor, view: Tensor) -> Tensor:  # noqa: ARG002
        return self.direction[None, None]

    def toward(self, node: int, positions: Tensor | None, normals: Tensor, view: Tensor) -> Tensor:  # noqa: ARG002
        return self.direction[None]

    def spread(self, positions: Tensor | None, normals: Tensor, view: Tensor) -> tuple[Tensor, Tensor]:  # noqa: ARG002
        return self.direction[None, None], self.irradiance[None, None]

    def edged(self, node: int) -> bool:  # noqa: ARG002
        return True

    def distance(self, positions: Tensor) -> Tensor:
        return positions.new_full((1,), math.inf)

    @property
    def key(self) -> Hashable:
        return "distant", *self.direction.tolist(), *self.irradiance.tolist(), self.solid_angle

    def channel(self, index: int) -> DirectionalLight:
        return replace(self, irradiance=self.irradiance[index, None])

    def to(self, dtype: torch.dtype, device: torch.device | str) -> DirectionalLight:
        return DirectionalLight(self.direction.to(device, dtype), self.irradiance.to(device, dtype), self.solid_angle)


@dataclass(frozen=True)
class PointLight:
    """A near light that radiates evenly, or as a power of the cosine to its axis (an LED, a panel).

    Args:
        position: in world units, [3].
        intensity: irradiance at unit distance, on the axis of one that has an axis, [C].
        solid_angle: of the source in sr as seen from the target, if known.
        axis: unit vector along which it radiates most, [3]; nothing is lit behind it. None: evenly.
        anisotropy: exponent m of the cosine to the axis: 1 of a Lambertian source, greater of a narrower beam.
        source: its shape across the axis, every part of which radiates alike; None: a point.
    """

    position: Tensor
    intensity: Tensor
    solid_angle: float | None = None
    axis: Tensor | None = None
    anisotropy: float = 1.0
    source: Source | None = None

    @property
    def near(self) -> bool:
        return True

    @property
    def power(self) -> Tensor:
        return self.intensity

    @property
    def nodes(self) -> int:
        return 1 if self.source is None else self.source.nodes

    def at(self, positions: Tensor | None) -> tuple[Tensor, Tensor]:
        return self._from(self.position, _needed(positions))

    def directions(self, positions: Tensor | None, normals: Tensor, view: Tensor) -> Tensor:
        return self.spread(positions, normals, view)[0]

    def toward(self, node: int, positions: Tensor | None, normals: Tensor, view: Tensor) -> Tensor:
        return self.directions(positions, normals, view)[:, node]

    def edged(self, node: int) -> bool:  # noqa: ARG002
        return True

    def spread(self, positions: Tensor | None, normals: Tensor, view: Tensor) -> tuple[Tensor, Tensor]:  # noqa: ARG002
        positions = _needed(positions)
        if self.source is None:
            toward, power = self._from(self.position, positions)
            return toward[:, None], power[:, None]
        places, shares = self.source.spread(self.position, positions, normals)
        toward, power = self._from(places, positions[:, None])
        return toward, power * shares[..., None]

    def _from(self, places: Tensor, positions: Tensor) -> tuple[Tensor, Tensor]:
        """Unit vectors [..., 3] to places and irradiance [..., C] if all of it is there."""
        offset = places - positions
        squared = (offset * offset).sum(-1, keepdim=True)
        toward = offset / squared.sqrt()
        return toward, self.intensity * self.beam(toward) / squared

    def beam(self, toward: Tensor) -> Tensor:
        """Share of its intensity that it sends where it is seen along unit vectors [..., 3], [..., 1]."""
        if self.axis is None:
            return toward.new_ones(1, 1)
        cosine = -(toward @ self.axis)[..., None]
        # The gradient of a power is not finite at 0, where it counts for nothing.
        ahead = cosine > 0
        return torch.where(ahead, torch.where(ahead, cosine, 1).pow(self.anisotropy), 0)

    def distance(self, positions: Tensor) -> Tensor:
        return (self.position - positions).norm(dim=-1)

    @property
    def key(self) -> Hashable:
        lobe = () if self.axis is None else (*self.axis.tolist(), self.anisotropy)
        shape = () if self.source is None else self.source.key
        return "near", *self.position.tolist(), *self.intensity.tolist(), self.solid_angle, *lobe, *shape

    def channel(self, index: int) -> PointLight:
        return replace(self, intensity=self.intensity[index, None])

    def to(self, dtype: torch.dtype, device: torch.device | str) -> PointLight:
        axis = None if self.axis is None else self.axis.to(device, dtype)
        position, intensity = self.position.to(device, dtype), self.intensity.to(device, dtype)
        source = None if self.source is None else self.source.to(dtype, device)
        return replace(self, position=position, intensity=intensity, axis=axis, source=source)


def _needed(positions: Tensor | None) -> Tensor:
    if positions is None:
        raise InputError(
            "a point light needs the surface's positions: give a mesh, or positions beside the normal map."
        )
    return positions


def sky_at(ambient: Tensor | None, index: slice | Tensor) -> Tensor | None:
    """Light of the sky at some of n points [n or 1, C]; None where there is no sky."""
    return ambient if ambient is None or len(ambient) == 1 else ambient[index]


def sky_channels(ambient: Tensor | None) -> int:
    """Channels of the light of a sky; 1 where there is none."""
    return 1 if ambient is None else ambient.shape[-1]


def join_skies(parts: Sequence[Tensor | None], counts: Sequence[int], like: Tensor) -> Tensor | None:
    """Light of the sky at several batches of points in a row [n, C]; None where none of them has a sky.

    Args:
        parts: of each batch [1 or n, C].
        counts: points of each.
        like: any tensor [..., C] of their channels, dtype and device.
    """
    if all(part is None for part in parts):
        return None
    shapes = [(count, like.shape[-1]) for count in counts]
    return torch.cat(
        [
            like.new_zeros(shape) if part is None else part.expand(shape)
            for part, shape in zip(parts, shapes, strict=True)
        ]
    )


def unit_direction(direction: list[float], label: str, meaning: str = "direction must point to the light") -> Tensor:
    """`direction` normalised.

    Args:
        direction: x, y, z.
        label: of the light, for the refusal.
        meaning: the key and what its vector does.

    Raises:
        InputError: zero, NaN or infinite.
    """
    vector = torch.tensor(direction, dtype=torch.float64)
    length = float(vector.norm())
    if not math.isfinite(length) or length == 0:
        raise InputError(
            f"{label}: {meaning}, a finite vector; got {direction}. Give x, y, z with at least one non-zero."
        )
    return vector / length
