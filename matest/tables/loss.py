"""What a fit to a table minimises: the likelihood of the values, or a cost of the literature."""

from __future__ import annotations

from enum import Enum

import torch
from torch import Tensor

from matest.samples.likelihood import Comparison

# 1/sr. The slope of the cube root is finite with values below this taken for it.
_CUBE_ROOT_FLOOR = 1e-6


class Loss(Enum):
    """The cost of a fit; y = f cos θi is the radiance under an irradiance of 1.

    LIKELIHOOD: Gaussian noise of y, relative to it, with a floor.
    LI_TORRANCE: Σ cos θi (Δf)², Li & Torrance 2005, eq. 15.
    LOG: Σ (Δ log(1 + y))².
    CUBE_ROOT: Σ (Δ ∛y)².
    """

    LIKELIHOOD = "likelihood"
    LI_TORRANCE = "li-torrance"
    LOG = "log"
    CUBE_ROOT = "cube-root"

    @property
    def comparison(self) -> Comparison | None:
        """The scale that values are compared on; None: there is a likelihood."""
        return _COMPARISONS.get(self)

    def variance_shares(self, cos_i: Tensor) -> Tensor:
        """Variances of the compared values, one relative to another, that give the cost its weights [n, 1]."""
        # (Δy)² / cos θi = cos θi (Δf)².
        return cos_i if self is Loss.LI_TORRANCE else torch.ones_like(cos_i)


def cube_root(y: Tensor) -> Tensor:
    """∛y, of negative values too."""
    return y.sign() * y.abs() ** (1 / 3)


_COMPARISONS = {
    Loss.LI_TORRANCE: Comparison(lambda y: y, torch.ones_like),
    Loss.LOG: Comparison(lambda y: torch.log1p(y.clamp(min=-0.5)), lambda y: 1 / (1 + y.clamp(min=-0.5))),
    Loss.CUBE_ROOT: Comparison(cube_root, lambda y: y.clamp(min=_CUBE_ROOT_FLOOR) ** (-2 / 3) / 3),
}
