"""A batch of samples: points, their measured radiance, and what it says of the true one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from matest.scene import Points

# Residuals up to so many standard deviations count in full, those beyond the second not at all: of Gaussian noise only
# one value in 16,000 lies between, so that nothing is lost where there are no outliers.
TRUSTED, REJECTED = 4.0, 6.0
# A value that may have been clipped, closer to the end of the sensor's range than this, says little of the fit.
_CLEAR = 3.0
_LOG_ROOT_TWO_PI = 0.5 * math.log(2 * math.pi)


class Readout(NamedTuple):
    """Noise of an image in radiance: variance = read + gain·radiance; tensors [1 or n, 1 or C]."""

    read: Tensor
    gain: Tensor


class Limits(NamedTuple):
    """Radiance at which the sensor clips at its lower and upper end; tensors [1 or n, 1 or C], may be infinite."""

    lower: Tensor
    upper: Tensor


class Working(NamedTuple):
    """The least-squares problem that stands for the likelihood near a reference, all [n, C].

    Attributes:
        response: the measured radiance; where it was clipped, the reference moved by a Newton step.
        weight: inverse variance, less for what is clipped, 0 for outliers.
        plain: values that a goodness of fit may be judged by: measured, and not near the ends of the sensor's range
            where the reference is too.
    """

    response: Tensor
    weight: Tensor
    plain: Tensor


@dataclass(frozen=True)
class Batch:
    """n samples: points, their measured radiance [n, C], the noise of their pixels.

    Attributes:
        points: geometry and light.
        radiance: measured, [n, C].
        readout: noise of the pixels.
        limits: ends of the sensor's range; None where it has none.
        clipped: −1 where a value is clipped at black, 1 where it is saturated, otherwise 0, [n, C]; None: nowhere.
        cluster: label of the block of pixels of one image, image · BLOCKS + block (None when mixed).
        runs: where several blocks follow each other in one batch, the label and length of each.
        pixels: of each sample its place among the surface's N pixels, int64 [n]; None where there is no image.
    """

    points: Points
    radiance: Tensor
    readout: Readout
    limits: Limits | None = None
    clipped: Tensor | None = None
    cluster: int | None = None
    runs: tuple[tuple[int, int], ...] = ()
    pixels: Tensor | None = None

    def __len__(self) -> int:
        return len(self.radiance)

    def __getitem__(self, index: slice | Tensor) -> Batch:
        """Some of the samples."""
        readout = Readout(*(value if len(value) == 1 else value[index] for value in self.readout))
        limits = None
        if self.limits is not None:
            limits = Limits(*(value if len(value) == 1 else value[index] for value in self.limits))
        clipped, pixels = (None if value is None else value[index] for value in (self.clipped, self.pixels))
        points = self.points[index]
        return Batch(points, self.radiance[index], readout, limits, clipped, self.cluster, pixels=pixels)

    def variance(self, radiance: Tensor) -> Tensor:
        """Noise variance of a pixel of this true `radiance` [n, C]."""
        return self.readout.read + self.readout.gain * radiance.clamp(min=0)

    def weight(self, radiance: Tensor) -> Tensor:
        """Inverse variance of a pixel of this true `radiance` [n, C]; 0 where the measured value is clipped."""
        weight = 1 / self.variance(radiance)
        return weight if self.clipped is None else weight * (self.clipped == 0)

    def measured(self) -> Working:
        """The problem for a first guess: one variance a channel, clipped values taken as measured.

        Weights that follow the measured radiance would give dark outliers the most of it. A highlight that is saturated
        is lower than it should be, but there.
        """
        typical = self.radiance.median(dim=0, keepdim=True).values if len(self) else self.radiance
        weight = (1 / self.variance(typical)).expand_as(self.radiance)
        return Working(self.radiance, weight, torch.ones_like(weight, dtype=torch.bool))

    def working(self, reference: Tensor, misfit: float = 1.0) -> Working:
        """The problem whose solution is, to second order, the maximum of the likelihood.

        Variances are those at the reference. A clipped value says that the radiance lies beyond the limit, with
        probability Φ(z), z = ±(reference − limit)/s: its score is φ/Φ and its information h (h + z), h = φ/Φ. Values
        far from the reference are outliers.

        Args:
            reference: model radiance near the solution [n, C].
            misfit: typical residual in standard deviations of the noise, at least 1: where the model does not hold,
                outliers are judged by it.
        """
        variance = self.variance(reference)
        weight = 1 / variance
        squared = (self.radiance - reference).square() * weight
        # Most tiles have no outlier.
        far = (TRUSTED * misfit) ** 2
        if float(squared.max()) > far:
            weight = _trust(squared.sqrt() / misfit) * weight
        if self.limits is None:
            return Working(self.radiance, weight, torch.ones_like(weight, dtype=torch.bool))
        lower, upper = self.limits
        std = variance.sqrt()
        plain = (reference - lower > _CLEAR * std) & (upper - reference > _CLEAR * std)
        # What lies far from the reference was not clipped by chance.
        plain = plain | (squared > far)
        if self.clipped is None:
            return Working(self.radiance, weight, plain)
        side = self.clipped.to(reference)
        spread = misfit * std
        z = side * (reference - torch.where(side > 0, upper, lower).nan_to_num()) / spread
        hazard = torch.exp(-0.5 * z.square() - torch.special.log_ndtr(z) - _LOG_ROOT_TWO_PI)
        censored, trust = side != 0, _trust(-z)
        return Working(
            response=torch.where(censored, reference + side * spread / (hazard + z), self.radiance),
            weight=torch.where(censored, trust * hazard * (hazard + z) / variance, weight),
            # A clipped value says nothing of how well the model fits, unless it is an outlier.
            plain=torch.where(censored, trust == 0, plain),
        )


def _trust(deviation: Tensor) -> Tensor:
    return ((REJECTED - deviation) / (REJECTED - TRUSTED)).clamp(0, 1)
