"""Light from all around: a map of radiance in latitude and longitude.

A surface sees it as D directions, each with the light of a cell of the map (`light_cells`). At every normal their
powers are scaled such that together they give the irradiance that compact cells give as points and all others by
spherical harmonics (`harmonics`): what a Lambertian surface reflects has no grain of the directions. One direction more
is that of mirror reflection. It has so small a solid angle that only a coherent term, whose kernel is as narrow, shows
it: there it gives the radiance of the map.

The map is that of Mitsuba's `envmap`: rows run from +y down to −y; along a row the edges are −z, the middle is +z, a
quarter from the left is +x, as one who stands inside sees it. `turn` turns it about y, from z toward x.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Hashable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import normalize

from matest.scene.harmonics import cosine_coefficients, harmonics
from matest.scene.light_cells import light_cells

# Most directions, where the material is known and where it is not.
LARGEST_COUNT = 4096
USUAL_COUNT = 256
# Fewest directions.
_SMALLEST_COUNT = 128
# Half the product of a lobe's curvature and the mean spread of the cells, up to which directions suffice for 1 % rms.
_SPREAD = 0.02
# Mean square distance of the light of a cell from its middle up to which it counts as a point: 2.6°.
_COMPACT = 1e-3
# Solid angle of the direction of mirror reflection, sr.
MIRROR_SOLID_ANGLE = 1e-10
# Rows of the map whose cells are split: texels of larger ones are joined.
_ROWS = 512
# Share of all light above which that of one direction casts shadows whose edges show.
_BRIGHT = 0.02
# Largest factor between the irradiance of the directions and that of the map.
_LARGEST_FACTOR = 2.0


@dataclass(frozen=True, eq=False)
class Environment:
    """A map of radiance and the directions that stand for it, in the axes of the map.

    Attributes:
        radiance: [R, 2 R, C].
        nodes: unit vectors [D, 3].
        powers: irradiance of a surface that faces each [D, C].
        compact: which cells count as points [D].
        broad: harmonics of the irradiance that the others give [T, C].
        spread: mean square distance of light from the direction that stands for it.
    """

    radiance: Tensor
    nodes: Tensor
    powers: Tensor
    compact: Tensor
    broad: Tensor
    spread: float

    def irradiance(self, normals: Tensor) -> Tensor:
        """Irradiance [N, C] of surfaces of these normals [N, 3], whose horizon nothing covers."""
        points = (normals @ self.nodes[self.compact].T).clamp(min=0) @ self.powers[self.compact]
        return points + (harmonics(normals) @ self.broad).clamp(min=0)

    def at(self, directions: Tensor) -> Tensor:
        """Radiance [N, C] from directions [N, 3], linear between texels."""
        rows, columns = self.radiance.shape[:2]
        x, y, z = directions.unbind(-1)
        # The longitude of a pole is any.
        pole = (x == 0) & (z == 0)
        across = torch.atan2(torch.where(pole, 1, x), -z) * (columns / (2 * math.pi)) - 0.5
        down = (torch.atan2((x * x + z * z).clamp(min=1e-12).sqrt(), y) * (rows / math.pi) - 0.5).clamp(0, rows - 1)
        left, top = across.detach().floor(), down.detach().floor().clamp(max=rows - 2)
        u, v = (across - left)[..., None], (down - top)[..., None]
        first, row = left.long() % columns, top.long()
        second = (first + 1) % columns
        upper = self.radiance[row, first] * (1 - u) + self.radiance[row, second] * u
        lower = self.radiance[row + 1, first] * (1 - u) + self.radiance[row + 1, second] * u
        return upper * (1 - v) + lower * v

    def with_count(self, count: int) -> Environment:
        """The same map with so many directions."""
        return environment_of(self.radiance, count)

    def channel(self, index: int) -> Environment:
        radiance, powers, broad = (part[..., index, None] for part in (self.radiance, self.powers, self.broad))
        return replace(self, radiance=radiance, powers=powers, broad=broad)

    def to(self, dtype: torch.dtype, device: torch.device | str) -> Environment:
        radiance, nodes, powers, broad = (
            part.to(device, dtype) for part in (self.radiance, self.nodes, self.powers, self.broad)
        )
        return replace(
            self, radiance=radiance, nodes=nodes, powers=powers, broad=broad, compact=self.compact.to(device)
        )

    @cached_property
    def digest(self) -> str:
        """Of the map and the number of directions."""
        return hashlib.sha256(self.radiance.cpu().double().numpy().tobytes()).hexdigest() + f"/{len(self.nodes)}"


def environment_of(radiance: Tensor, count: int) -> Environment:
    """A map of radiance [R, 2 R, C] as so many directions.

    Raises:
        ValueError: all of it is dark.
    """
    powers, directions = _joined(radiance.detach().cpu().double().numpy())
    if not powers.any():
        raise ValueError("a dark map")
    cells = light_cells(powers, directions, count)
    compact = cells.spreads < _COMPACT
    broad = np.where(compact[cells.labels][..., None], 0, powers).reshape(-1, powers.shape[-1])
    basis = harmonics(torch.from_numpy(directions.reshape(-1, 3)))
    coefficients = cosine_coefficients()[:, None] * (basis.T @ torch.from_numpy(broad))
    return Environment(
        radiance=radiance,
        nodes=torch.from_numpy(cells.directions).to(radiance),
        powers=torch.from_numpy(cells.powers).to(radiance),
        compact=torch.from_numpy(compact).to(radiance.device),
        broad=coefficients.to(radiance),
        spread=cells.spread,
    )


def environment_for(radiance: Tensor, curvature: float) -> Environment:
    """The fewest directions, a power of two, that resolve lobes of a curvature (1/rad²), or `LARGEST_COUNT`."""
    count = _SMALLEST_COUNT
    environment = environment_of(radiance, count)
    while curvature * environment.spread / 2 > _SPREAD and count < LARGEST_COUNT:
        count *= 2
        environment = environment_of(radiance, count)
    return environment


def _joined(radiance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Power of the texels of a map, joined to at most `_ROWS` rows, and unit vectors to them."""
    rows, columns, channels = radiance.shape
    edges = np.cos(np.linspace(0, math.pi, rows + 1))
    powers = radiance * ((edges[:-1] - edges[1:]) * (2 * math.pi / columns))[:, None, None]
    vertical, across = -(-rows // _ROWS), -(-columns // (2 * _ROWS))
    powers = np.add.reduceat(np.add.reduceat(powers, range(0, rows, vertical), 0), range(0, columns, across), 1)
    polar = (_middles(rows, vertical) * (math.pi / rows))[:, None]
    azimuth = _middles(columns, across) * (2 * math.pi / columns)
    directions = [np.sin(polar) * np.sin(azimuth), np.cos(polar) + 0 * azimuth, -np.sin(polar) * np.cos(azimuth)]
    return powers.reshape(len(polar), len(azimuth), channels), np.stack(directions, axis=-1)


def _middles(count: int, step: int) -> np.ndarray:
    """Middles of runs of `step` texels of a side of `count`, of which the last may be shorter."""
    starts = np.arange(0, count, step)
    return (starts + np.minimum(starts + step, count)) / 2


@dataclass(frozen=True, eq=False)
class EnvironmentLight:
    """Light from all around.

    Args:
        environment: the map.
        turn: of the map about y, rad, from z toward x.
    """

    environment: Environment
    turn: float = 0.0

    @property
    def solid_angle(self) -> float:
        return MIRROR_SOLID_ANGLE

    @property
    def near(self) -> bool:
        return False

    @property
    def power(self) -> Tensor:
        return self.environment.powers.sum(0)

    @property
    def nodes(self) -> int:
        return len(self.environment.nodes) + 1

    def at(self, positions: Tensor | None) -> tuple[Tensor, Tensor]:  # noqa: ARG002
        brightest = self.environment.powers.sum(1).argmax()
        return (self.environment.nodes @ self._frame.T)[brightest, None], self.power[None]

    def before(self, toward: Tensor) -> tuple[Tensor, Tensor]:
        """One distant light in place of the half of the map about a direction.

        Args:
            toward: unit vector, in the middle of that half [3].

        Returns:
            Unit vector to the light [3], and the irradiance of a surface facing it under the whole map [C].
        """
        nodes = self.environment.nodes @ self._frame.T
        lit = ((nodes @ toward).clamp(min=0) * self.environment.powers.sum(1)) @ nodes
        # A half that is dark has its middle.
        direction = normalize(lit + torch.finfo(lit.dtype).tiny * toward, dim=0)
        return direction, self.environment.irradiance((direction @ self._frame)[None])[0]

    def directions(self, positions: Tensor | None, normals: Tensor, view: Tensor) -> Tensor:  # noqa: ARG002
        nodes = self.environment.nodes @ self._frame.T
        mirrored = _mirrored(normals, view)[:, None]
        return torch.cat([nodes.expand(len(mirrored), -1, -1), mirrored], dim=1)

    def toward(self, node: int, positions: Tensor | None, normals: Tensor, view: Tensor) -> Tensor:  # noqa: ARG002
        if node == len(self.environment.nodes):
            return _mirrored(normals, view)
        return self.environment.nodes[node, None] @ self._frame.T

    def edged(self, node: int) -> bool:
        """A sun casts a shadow with an edge; parts of a sky lighten each other's shadows."""
        powers = self.environment.powers.sum(1)
        return node < len(powers) and bool(powers[node] > _BRIGHT * powers.sum())

    def spread(self, positions: Tensor | None, normals: Tensor, view: Tensor) -> tuple[Tensor, Tensor]:
        toward, environment = self.directions(positions, normals, view), self.environment
        # In the axes of the map.
        local = normals @ self._frame
        given = (local @ environment.nodes.T).clamp(min=0) @ environment.powers
        factor = environment.irradiance(local) / given.clamp(min=torch.finfo(given.dtype).tiny)
        power = environment.powers * factor.clamp(max=_LARGEST_FACTOR)[:, None]
        mirrored = environment.at(toward[:, -1] @ self._frame) * MIRROR_SOLID_ANGLE
        return toward, torch.cat([power, mirrored[:, None]], dim=1)

    def distance(self, positions: Tensor) -> Tensor:
        return positions.new_full((1,), math.inf)

    @property
    def _frame(self) -> Tensor:
        """Columns are the axes of the map in the world [3, 3]."""
        cos, sin = math.cos(self.turn), math.sin(self.turn)
        return self.environment.nodes.new_tensor([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]])

    @property
    def key(self) -> Hashable:
        return "around", self.environment.digest, self.turn

    def channel(self, index: int) -> EnvironmentLight:
        return replace(self, environment=self.environment.channel(index))

    def to(self, dtype: torch.dtype, device: torch.device | str) -> EnvironmentLight:
        return replace(self, environment=self.environment.to(dtype, device))


def _mirrored(normals: Tensor, view: Tensor) -> Tensor:
    """The mirror image of the direction to the viewer about each normal [N, 3]."""
    return 2 * (normals * view).sum(-1, keepdim=True) * normals - view
