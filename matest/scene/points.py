"""Lit surface points: geometry and light as shading needs them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from matest.directions import to_local
from matest.scene.lights import Light, join_skies, sky_at, sky_channels

# Lights of a point from which on it pays to pick those above its horizon.
_MANY_LIGHTS = 16


@dataclass(frozen=True)
class Points:
    """Geometry and light of a batch of surface points, in their local frames. Sizes of 1 broadcast.

    Attributes:
        wi: unit vectors to each of L lights, or to the points that stand for large ones [..., L, 3].
        wo: unit vectors to the viewer [..., 3].
        irradiance: of a surface facing each light, 0 where the light is blocked [..., L, C].
        ambient: ambient radiance times the unoccluded fraction of the sky [..., C]; None where there is none.
    """

    wi: Tensor
    wo: Tensor
    irradiance: Tensor
    ambient: Tensor | None = None

    def __getitem__(self, index: slice | Tensor) -> Points:
        """Some of the points of a batch [n, …]."""
        parts = (self.wi, self.wo, self.irradiance)
        wi, wo, irradiance = (part if len(part) == 1 else part[index] for part in parts)
        return Points(wi, wo, irradiance, sky_at(self.ambient, index))

    def without_black_sky(self) -> Points:
        """The same points, of which a sky that gives no light is none: what shapes reflect of it takes longest."""
        return self if self.ambient is None or bool(self.ambient.any()) else replace(self, ambient=None)


@dataclass(frozen=True)
class LitPairs:
    """The points of a batch under the lights above their horizons, one point and one light a pair.

    Attributes:
        points: of the M pairs, one light each, without a sky.
        rows: number of the point of each pair, ascending [M].
        count: points of the batch.
    """

    points: Points
    rows: Tensor
    count: int

    def sums(self, values: Tensor) -> Tensor:
        """Sums [n, ...] over the lights of each point of what each pair has [M, ...]."""
        return values.new_zeros(self.count, *values.shape[1:]).index_add(0, self.rows, values)


def lit_pairs(points: Points) -> LitPairs | None:
    """The pairs of a batch [n, …] of points and their lights; None where there are too few lights for that to pay."""
    if points.wo.ndim != 2 or points.wi.shape[-2] < _MANY_LIGHTS:
        return None
    lead = torch.broadcast_shapes(points.wi.shape[:-1], (len(points.wo), 1), points.irradiance.shape[:-1])
    lit = (points.wi[..., 2] > 0) & (points.wo[:, None, 2] > 0) & (points.irradiance != 0).any(-1)
    place = lit.expand(lead).flatten().nonzero()[:, 0]
    if not len(place):
        return None
    rows = place // lead[1]
    # Component by component: each stays an array of its own.
    wi = points.wi.movedim(-1, 0).expand(3, *lead).flatten(1).index_select(1, place).movedim(0, -1)
    wo = points.wo.movedim(-1, 0).expand(3, lead[0]).index_select(1, rows).movedim(0, -1)
    irradiance = points.irradiance.expand(*lead, -1).flatten(0, 1).index_select(0, place)
    return LitPairs(Points(wi[:, None], wo, irradiance[:, None]), rows, lead[0])


def illuminate(
    normals: Tensor,
    view: Tensor,
    lights: Sequence[Light],
    *,
    positions: Tensor | None = None,
    ambient: Tensor | None = None,
    blocked: Tensor | None = None,
) -> Points:
    """Points of a surface under lights, from tensors: differentiable in all of them and in the lights.

    The dtype and device are those of `normals`; the other tensors, and those of the lights, must agree with it.
    Directions must have unit length: pass those that an optimiser changes through `torch.nn.functional.normalize`
    first.

    Args:
        normals: unit normals in world coordinates [N, 3].
        view: unit vectors to the viewer [N, 3] or [1, 3].
        lights: L distant or near lights.
        positions: in world units [N, 3]; near lights need them.
        ambient: radiance of an even sky times the unoccluded fraction of it [N or 1, C].
        blocked: True where a light does not reach a point [L, N], a row for each of its nodes.

    Raises:
        InputError: a near light and no positions.
    """
    lit = [light.spread(positions, normals, view) for light in lights]
    if blocked is not None:
        rows = blocked.split([light.nodes for light in lights])
        lit = [(toward, power * ~dark.T[..., None]) for (toward, power), dark in zip(lit, rows, strict=True)]
    if not lit:
        channels = sky_channels(ambient)
        return Points(
            normals.new_zeros(1, 0, 3), to_local(normals, view)[0], normals.new_zeros(1, 0, channels), ambient
        )
    toward = _side_by_side([direction for direction, _ in lit])
    wi, wo = to_local(normals[:, None], toward, view[:, None])
    return Points(
        wi=wi,
        wo=wo[:, 0],
        irradiance=_side_by_side([power for _, power in lit]),
        ambient=ambient,
    )


def _side_by_side(parts: Sequence[Tensor]) -> Tensor:
    """Values [1 or N, n, C] of several lights as one tensor [1 or N, L, C]."""
    count, channels = max(len(part) for part in parts), max(part.shape[2] for part in parts)
    return torch.cat([part.expand(count, -1, channels) for part in parts], dim=1)


def join_points(parts: Sequence[Points], counts: Sequence[int]) -> Points:
    """The points of several batches in a row, `counts` of each; those with fewer lights get dark ones."""
    lights = max(part.wi.shape[-2] for part in parts)
    channels = max(part.irradiance.shape[-1] for part in parts)
    spread = [_spread(part, count, lights) for part, count in zip(parts, counts, strict=True)]
    irradiance = torch.cat([part.irradiance.expand(-1, -1, channels) for part in spread])
    return Points(
        torch.cat([part.wi for part in spread]),
        torch.cat([part.wo for part in spread]),
        irradiance,
        join_skies([part.ambient for part in parts], counts, irradiance),
    )


def _spread(points: Points, count: int, lights: int) -> Points:
    """Points with every tensor at full size, and with dark lights so that there are `lights`."""
    missing = lights - points.wi.shape[-2]
    wi = points.wi.expand(count, -1, -1)
    irradiance = points.irradiance.expand(count, -1, -1)
    if missing:
        wi = torch.cat([wi, points.wo[:, None].expand(count, missing, 3)], dim=1)
        irradiance = torch.cat([irradiance, irradiance.new_zeros(count, missing, irradiance.shape[-1])], dim=1)
    return Points(wi, points.wo.expand(count, -1), irradiance, points.ambient)
