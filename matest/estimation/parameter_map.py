"""A parameter with a value at every pixel of the object."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum

import torch
from torch import Tensor

from matest.brdf import Brdf


class TexelStatus(IntEnum):
    """What the photographs tell of a parameter at one pixel."""

    UNSEEN = 0
    DETERMINED = 1
    AT_BOUND = 2
    # The photographs do not tell it here: the value is that of the pixel's region, or of the object.
    SHARED = 3


@dataclass(frozen=True, eq=False)
class ParameterMap:
    """A parameter at every one of the N pixels of the object.

    Attributes:
        name: of the parameter.
        value: [N, 1 or C]; NaN where no photograph shows the pixel.
        std: standard errors [N, 1 or C]; NaN likewise.
        status: of every pixel, the worst of its channels, uint8 [N] (`TexelStatus`).
    """

    name: str
    value: Tensor
    std: Tensor
    status: Tensor

    @property
    def mean(self) -> Tensor:
        """Over the pixels that photographs show [1 or C]."""
        return self.value.nanmean(dim=0).double()

    @property
    def determined(self) -> float:
        """Share of the object's pixels whose own value the photographs tell."""
        own = (self.status == TexelStatus.DETERMINED) | (self.status == TexelStatus.AT_BOUND)
        return float(own.double().mean())

    @property
    def shares(self) -> dict[TexelStatus, float]:
        """Share of the object's pixels of every status."""
        counts = torch.bincount(self.status.long(), minlength=len(TexelStatus)).double() / max(len(self.status), 1)
        return {status: float(counts[status]) for status in TexelStatus}

    @property
    def filled(self) -> Tensor:
        """The values, with the mean where no photograph shows a pixel [N, 1 or C]."""
        return torch.where(self.value.isnan(), self.mean.to(self.value), self.value)


def with_maps(material: Brdf, maps: Mapping[str, ParameterMap]) -> Brdf:
    """A material with a value at every pixel of what is mapped.

    Args:
        material: with values for the whole object.
        maps: by name of the parameter, as `Estimate.maps` and `load_maps` have them.

    Raises:
        InputError: the material has no such parameter.
    """
    return material.replace({name: each.filled.double() for name, each in maps.items()})


def map_file(name: str, kind: str = "") -> str:
    """The file of a map in a result folder; `kind`: "std" for its standard errors, "smooth", "smooth_std"."""
    return f"maps/{name}{'_' * bool(kind)}{kind}.exr"
