"""Errors of the calibration as unknowns: what they are, and what they do to the light that samples are under."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from matest.samples.batch import Batch
from matest.scene.points import Points

# Share of full scale. The power of a darker value is taken as that of this one, so that its logarithm stays finite.
_DARK = 1e-4
# Times the size of an error that nobody states, beyond which it is none of a calibration.
_IMPLAUSIBLE = 10.0
# Share of full scale for the derivative of a transfer.
_STEP = 1e-3


@dataclass(frozen=True, eq=False)
class Family:
    """Unknown errors of one kind, all 0 where the calibration is exact.

    Attributes:
        name: of the kind, such as "direction".
        unit: of the unknowns.
        doc: what they are.
        count: number of unknowns.
        places: of the q unknowns that samples of each group depend on, int64 [G, q].
        assumed: standard deviation of the error as a whole where nobody states it, in its unit. The samples correct
            that of a family of many unknowns; for the others it only has to be wide.
        spread: what their standard deviation has to be for the error as a whole to have one of 1.
        of_pixels: whether every pixel of an object has errors of its own; the unknowns are then those of one pixel.
    """

    name: str
    unit: str
    doc: str
    count: int
    places: Tensor
    assumed: float
    spread: float = 1.0
    of_pixels: bool = False

    @property
    def largest(self) -> float:
        """Size of the error as a whole beyond which it is none of a calibration: something else is wrong."""
        return _IMPLAUSIBLE * self.assumed

    @property
    def width(self) -> int:
        """q: number of unknowns that one sample depends on."""
        return self.places.shape[1]


@dataclass(frozen=True, eq=False)
class Displaced:
    """n samples as they would be under some errors of the calibration.

    Attributes:
        points: geometry and light.
        body: factor of the albedo of the body [n, 1]; None: 1.
        power: excess over 1 of the exponent between true and decoded radiance [n, 1]; None: 0.
        curve: share of the way from the stated transfer to another one [n, 1]; None: 0.
        departure: by how much a decoded share of full scale differs if it is the other one; needed beside `curve`.
        white: radiance of full scale [n, 1]; needed beside `power` and `curve`.
        offset: added to the decoded radiance [n, C]; None: 0.
        weights: of each sample and of k others around it in its blurred value [1 + k, n]; None: it is sharp.
        around: these others, k n; needed beside `weights`.
    """

    points: Points
    body: Tensor | None = None
    power: Tensor | None = None
    curve: Tensor | None = None
    departure: Callable[[Tensor], Tensor] | None = None
    white: Tensor | None = None
    offset: Tensor | None = None
    weights: Tensor | None = None
    around: Displaced | None = None

    def decoded(self, radiance: Tensor) -> Tensor:
        """What is decoded of the true radiance [n, C]."""
        radiance = self._curved(radiance)
        if self.power is not None:
            radiance = radiance * self._level(radiance) ** self.power
        return radiance if self.offset is None else radiance + self.offset

    def slope(self, radiance: Tensor) -> Tensor:
        """Derivative of `decoded` by the true radiance [n, C]."""
        slope = torch.ones_like(radiance)
        if self.curve is not None and self.departure is not None:
            slope = slope + self.curve * _slope(self.departure, self._share(radiance))
        if self.power is not None:
            slope = slope * (1 + self.power) * self._level(self._curved(radiance)) ** self.power
        return slope

    def _curved(self, radiance: Tensor) -> Tensor:
        """What is decoded as far as the transfer is another one; to first order in a change of the radiance."""
        if self.curve is None or self.departure is None or self.white is None:
            return radiance
        share = self._share(radiance)
        here = share.detach()
        departure = self.departure(here) + _slope(self.departure, here) * (share - here)
        return radiance + self.curve * departure * self.white

    def _share(self, radiance: Tensor) -> Tensor:
        """Of full scale."""
        assert self.white is not None
        return radiance / self.white

    def _level(self, radiance: Tensor) -> Tensor:
        """The same, not too dark."""
        return self._share(radiance).clamp(min=_DARK)


def _slope(function: Callable[[Tensor], Tensor], at: Tensor) -> Tensor:
    """The derivative of a function by central differences."""
    return (function(at + _STEP) - function(at - _STEP)) / (2 * _STEP)


class Calibration(Protocol):
    """The families of errors that a problem estimates or allows for, and what they do to samples.

    Attributes:
        families: in the order of their unknowns.
    """

    @property
    def families(self) -> Sequence[Family]: ...

    def displaced(self, batch: Batch, values: Tensor) -> Displaced:
        """Samples under errors of these `values` [n, Σq], differentiable in them."""
