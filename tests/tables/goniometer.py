"""Li and Torrance's gonioreflectometer, simulated: their sampling grids (§5.1) and relative noise."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from matest.brdf import Brdf
from matest.directions import from_angles
from matest.tables import Table

# No detector beyond this polar angle, and none as close to the light.
LARGEST_ANGLE = math.radians(85)
RETRO_CONE = math.radians(7)


def hemispherical() -> tuple[Tensor, Tensor]:
    """Incidences every 10°, 441 viewers spread evenly over the hemisphere for each; directions [n, 3]."""
    side = torch.linspace(-1, 1, 21, dtype=torch.float64)
    a, b = (part.flatten() for part in torch.meshgrid(side, side, indexing="ij"))
    # Squares to rings of equal solid angle (Shirley & Chiu's concentric map).
    radius = torch.maximum(a.abs(), b.abs())
    ring = torch.atan2(b, a)
    viewers = from_angles(torch.acos(1 - radius.square() * (1 - math.cos(LARGEST_ANGLE))), ring)
    lights = from_angles(torch.deg2rad(torch.arange(10, 81, 10, dtype=torch.float64)), torch.tensor(math.pi).double())
    return _seen(lights.repeat_interleave(len(viewers), 0), viewers.repeat(len(lights), 1))


def in_plane(count: int = 60) -> tuple[Tensor, Tensor]:
    """Incidences of 15, 30, 45, 60, 75° with so many viewers in the plane, closer near the mirror direction."""
    wi, wo = [], []
    for degrees in (15, 30, 45, 60, 75):
        mirror = math.radians(degrees)
        light = from_angles(torch.tensor([mirror]).double(), torch.tensor([math.pi]).double())
        share = torch.linspace(-1, 1, count, dtype=torch.float64)
        angles = mirror + share.sign() * share.abs() ** 3 * (LARGEST_ANGLE + mirror)
        angles = angles[angles.abs() <= LARGEST_ANGLE]
        wo.append(from_angles(angles, torch.zeros_like(angles)))
        wi.append(light.expand(len(angles), 3))
    return _seen(torch.cat(wi), torch.cat(wo))


def _seen(wi: Tensor, wo: Tensor) -> tuple[Tensor, Tensor]:
    kept = (wi * wo).sum(-1) < math.cos(RETRO_CONE)
    return wi[kept], wo[kept]


def measured(material: Brdf, directions: tuple[Tensor, Tensor], noise: float = 0.01, seed: int = 0) -> Table:
    """A table of a material with relative Gaussian noise."""
    wi, wo = directions
    with torch.no_grad():
        f = material(wi, wo)
    generator = torch.Generator().manual_seed(seed)
    values = f * (1 + noise * torch.randn(f.shape, generator=generator, dtype=torch.float64))
    names = ("R", "G", "B") if f.shape[1] == 3 else ("value",)
    return Table(Path("simulated.csv"), wi, wo, values, names)


def write_csv(table: Table, path: Path, *, degrees: bool = False, forward: bool = False, scale: str = "f") -> Path:
    """A table as CSV text: units, side of the azimuth and quantity as asked for."""
    angles = []
    for vectors in (table.wi, table.wo):
        angles += [vectors[:, 2].clamp(-1, 1).acos(), torch.atan2(vectors[:, 1], vectors[:, 0])]
    if forward:
        angles[1] = angles[1] + math.pi
    factor = {"f": torch.ones(len(table), 1), "pi-f": torch.tensor([[math.pi]]), "f-cos": table.wi[:, 2:]}[scale]
    columns = torch.stack([*(torch.rad2deg(angle) if degrees else angle for angle in angles)], dim=1)
    rows = torch.cat([columns, table.values * factor], dim=1).numpy()
    head = ",".join(["theta_i,phi_i,theta_r,phi_r", *table.channels])
    np.savetxt(path, rows, delimiter=",", header=head, comments="", fmt="%.9g")
    return path
