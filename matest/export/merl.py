"""MERL's `.binary` of any isotropic material, for viewers and renderers of measured reflectance."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from matest.brdf import Brdf
from matest.errors import InputError
from matest.export.conversion import Conversion, check_channels, is_isotropic, measured_error
from matest.tables.merl import CELLS, INVALID, SCALES, SHAPE, cells, turned

SUFFIX = ".binary"
# Cells that are evaluated together.
_TOGETHER = 1 << 16


def write(material: Brdf, path: Path) -> Conversion:
    """Write a material as a MERL table, and measure the error of the conversion.

    An entry is f at the middle of its cell. The format holds one value for a pair of directions and the exchanged pair:
    of a material that is not reciprocal it gets the mean of both. A material of one channel is written as grey.

    Raises:
        InputError: an anisotropic material; another number of channels than one or three.
        OSError: the file cannot be written.
    """
    check_channels(material, path, "a MERL table")
    if not is_isotropic(material):
        raise InputError(
            f"{path}: a MERL table holds isotropic materials, and {material.expression} changes when the surface turns "
            "about its normal; take another target."
        )
    wi, wo, _ = cells()
    above = (wi[:, 2] > 0) & (wo[:, 2] > 0)
    f = torch.full((CELLS, 3), INVALID, dtype=torch.float64)
    batches = zip(wi[above].split(_TOGETHER), wo[above].split(_TOGETHER), strict=True)
    with torch.no_grad():
        f[above] = torch.cat([_symmetric(material, *batch) for batch in batches])
    stored = f.numpy().T / SCALES[:, None]
    stored[:, ~above.numpy()] = INVALID
    with path.open("wb") as file:
        np.array(SHAPE, dtype="<i4").tofile(file)
        stored.astype("<f8").tofile(file)
    return Conversion(measured_error(material, partial(_looked_up, f)), files=(path,))


def _symmetric(material: Brdf, wi: Tensor, wo: Tensor) -> Tensor:
    """The mean of f(wi, wo) and f(wo, wi) [n, 3]."""
    return (0.5 * (material(wi, wo) + material(wo, wi))).expand(-1, 3)


def _looked_up(f: Tensor, wi: Tensor, wo: Tensor) -> Tensor:
    """What a look-up in f [CELLS, 3] gives; NaN where the cell has no value."""
    values = f[_places(wi, wo)]
    return torch.where(values >= 0, values, torch.nan)


def _places(wi: Tensor, wo: Tensor) -> Tensor:
    """The cell of pairs of directions [n], by the integer parts of their coordinates, as viewers look it up."""
    half = torch.nn.functional.normalize(wi + wo, dim=-1)
    theta_h = half[:, 2].clamp(-1, 1).acos()
    phi_h = torch.atan2(half[:, 1], half[:, 0])
    x, y = wi[:, 0] * phi_h.cos() + wi[:, 1] * phi_h.sin(), wi[:, 1] * phi_h.cos() - wi[:, 0] * phi_h.sin()
    difference = turned(torch.stack([x, y, wi[:, 2]], dim=-1), -theta_h)
    theta_d = difference[:, 2].clamp(-1, 1).acos()
    phi_d = torch.atan2(difference[:, 1], difference[:, 0]) % math.pi
    i = (SHAPE[0] * (theta_h / (0.5 * math.pi)).sqrt()).long().clamp(max=SHAPE[0] - 1)
    j = (SHAPE[1] * theta_d / (0.5 * math.pi)).long().clamp(max=SHAPE[1] - 1)
    k = (SHAPE[2] * phi_d / math.pi).long().clamp(max=SHAPE[2] - 1)
    return (i * SHAPE[1] + j) * SHAPE[2] + k
