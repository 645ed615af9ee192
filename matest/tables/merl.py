"""MERL's `.binary`: isotropic reflectance over half and difference angles (Matusik et al. 2003)."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from matest.directions import from_angles
from matest.errors import InputError, errors_of
from matest.tables.declaration import Declaration
from matest.tables.table import LARGEST, Table

# Cells in θh, θd and φd. A file begins with these three numbers, as int32.
SHAPE = (90, 90, 180)
CELLS = math.prod(SHAPE)
# The stored doubles times these are f in 1/sr, for R, G, B.
SCALES = np.array([1.0, 1.15, 1.66]) / 1500
# Stored where a direction is below the horizon or was not measured.
INVALID = -1.0
_HEADER = 3 * 4
_LENGTH = _HEADER + 3 * CELLS * 8


def read(path: Path, declaration: Declaration) -> Table:
    """The table in a `.binary` file.

    An entry is f at the middle of its cell, `cells`, where look-ups by the integer part of the coordinates are
    unbiased. Entries that are negative in any channel were not measured. Values count by the solid angles of their
    cells: a third of all cells lie within 10° of the mirror direction.

    Raises:
        InputError: another size or resolution, nothing measured, or a declaration of how to read it.
    """
    with errors_of(path):
        declaration.refuse_reading()
    with path.open("rb") as file:
        shape = tuple(np.fromfile(file, "<i4", 3).tolist())
        length = path.stat().st_size
        if shape != SHAPE or length != _LENGTH:
            raise InputError(
                f"{path}: expected a MERL table of 90 × 90 × 180 cells in {_LENGTH:,} bytes, and its header says "
                f"{' × '.join(map(str, shape)) or 'nothing'} in {length:,} bytes; download it again."
            )
        stored = np.fromfile(file, "<f8", 3 * CELLS).reshape(3, CELLS)
    wi, wo, measure = cells()
    above = ((wi[:, 2] > 0) & (wo[:, 2] > 0)).numpy()
    # A comparison that NaN fails.
    measured = ((stored >= 0) & (stored < LARGEST)).all(0)
    kept = np.flatnonzero(above & measured)
    if not len(kept):
        raise InputError(f"{path}: expected measured values, and every entry is marked as invalid; download it again.")
    measure = measure[kept]
    return Table(
        path=path,
        wi=wi[kept],
        wo=wo[kept],
        values=torch.from_numpy(np.ascontiguousarray((stored[:, kept] * SCALES[:, None]).T)),
        channels=("R", "G", "B"),
        measure=(measure / measure.mean())[:, None],
        skipped={"below the horizon": int((~above).sum()), "not measured": int((above & ~measured).sum())},
    )


def cells() -> tuple[Tensor, Tensor, Tensor]:
    """Directions to the light and to the viewer [CELLS, 3] at the middle of every cell, and its solid angles [CELLS].

    θh = (π/2)(i/90)², θd = (π/2)(j/90), φd = π k/180 at i, j, k = ½, 1½, …: the grid is fine around the mirror
    direction. Entries follow one another in φd first, then θd, then θh. The half vector lies in the plane of the
    tangent. Measure of the pairs of directions: dωi dωr = 4 cos θd dωh dωd.
    """
    half_edges = 0.5 * math.pi * torch.linspace(0, 1, SHAPE[0] + 1, dtype=torch.float64).square()
    half = 0.5 * math.pi * ((torch.arange(SHAPE[0], dtype=torch.float64) + 0.5) / SHAPE[0]).square()
    diff = 0.5 * math.pi * (torch.arange(SHAPE[1], dtype=torch.float64) + 0.5) / SHAPE[1]
    turn = math.pi * (torch.arange(SHAPE[2], dtype=torch.float64) + 0.5) / SHAPE[2]
    theta_h, theta_d, phi_d = (angle.flatten() for angle in torch.meshgrid(half, diff, turn, indexing="ij"))
    wi = turned(from_angles(theta_d, phi_d), theta_h)
    h = from_angles(theta_h, torch.zeros_like(theta_h))
    wo = 2 * (wi * h).sum(-1, keepdim=True) * h - wi
    # cos θh of the edges: exact over a cell.
    of_half = -half_edges.cos().diff()
    measure = (of_half[:, None, None] * (diff.sin() * diff.cos())[:, None]).expand(SHAPE)
    return wi, wo, measure.flatten()


def turned(vectors: Tensor, theta: Tensor) -> Tensor:
    """Vectors [n, 3] turned about the bitangent by θ [n], from the normal toward the tangent."""
    x, y, z = vectors.unbind(-1)
    cos, sin = theta.cos(), theta.sin()
    return torch.stack([x * cos + z * sin, y, z * cos - x * sin], dim=-1)
