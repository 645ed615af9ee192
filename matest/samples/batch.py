"""A batch of samples: points, their measured radiance, and what it says of the true one."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from matest.scene import Points

# Residuals up to so many standard deviations count in full, those beyond the second not at all: of Gaussian noise only
# one value in 16,000 lies between, so that nothing is lost where there are no outliers.
TRUSTED, REJECTED = 4.0, 6.0
# A value that may have been clipped, closer to the end of the sensor's range than this, says little of the fit.
_CLEAR = 3.0
# A square of pixels is not merged where the model leaves its polynomial by more than this share of the noise of its
# mean.
_BENT = 0.25
_LOG_ROOT_TWO_PI = 0.5 * math.log(2 * math.pi)


class Readout(NamedTuple):
    """Noise of an image in radiance: variance = read + gain·radiance + rounding·radiance^power.

    Tensors [1 or n, 1 or C]. The last term is that of integers that are not proportional to light, such as sRGB's.
    """

    read: Tensor
    gain: Tensor
    rounding: Tensor = torch.zeros(1, 1)
    power: Tensor = torch.ones(1, 1)

    def variance(self, radiance: Tensor) -> Tensor:
        """Noise variance of a pixel of this true `radiance` [n, C]."""
        signal = radiance.clamp(min=0)
        variance = self.read + self.gain * signal
        # Differentiable at black too.
        return variance + self.rounding * signal.clamp(min=1e-12) ** self.power if self.rounding.any() else variance


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
        copies, scatter: as in `Batch`.
    """

    response: Tensor
    weight: Tensor
    plain: Tensor
    copies: Tensor | None = None
    scatter: Tensor | None = None


@dataclass(frozen=True, eq=False)
class Tier:
    """Squares of neighbouring pixels of one size, over which radiance is a polynomial where the surface is smooth.

    Attributes:
        shares: how many pixels each of the n samples stands for that stand for such a square [n].
        checks: the polynomial through n values at k other places, where it is compared with the model [k, n].
    """

    shares: Tensor
    checks: Tensor

    @property
    def size(self) -> int:
        """Samples that a square takes in a batch."""
        return len(self.shares) + len(self.checks)


@dataclass(frozen=True)
class Merged:
    """Squares of pixels in a batch: of each tier first what stands for them, then where they are checked.

    Attributes:
        tiers: with the number of squares of each.
        finer: gives the samples of some of the squares (of each tier which, bool) by smaller squares or pixel by pixel.
    """

    tiers: tuple[tuple[Tier, int], ...]
    finer: Callable[[Mapping[Tier, np.ndarray]], Batch]

    def judge(self, batch: Batch, reference: Tensor, misfit: float) -> tuple[Batch, Batch | None]:
        """The batch without squares over which the model is no such polynomial, and those by themselves.

        Args:
            batch: that these squares belong to.
            reference, misfit: as in `Batch.working`.
        """
        assert batch.copies is not None
        copies, bent, start = batch.copies.clone(), {}, 0
        for tier, count in self.tiers:
            nodes = slice(start, start + count * len(tier.shares))
            checked = slice(nodes.stop, start := start + count * tier.size)
            expected = tier.checks.to(reference) @ reference[nodes].unflatten(0, (count, -1))
            noise = (batch[checked].variance(reference[checked]) / float(tier.shares.sum())).sqrt()
            off = (reference[checked] - expected.flatten(0, 1)).abs()
            own = (off > _BENT * misfit * noise).any(dim=-1).unflatten(0, (count, -1)).any(dim=-1)
            copies[nodes].unflatten(0, (count, -1))[own] = 0
            bent[tier] = own.cpu().numpy()
        if not any(own.any() for own in bent.values()):
            return batch, None
        return replace(batch, copies=copies), self.finer(bent)


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
        copies: how many pixels each sample stands for [n, 1]; its radiance is as precise as their mean. None: one.
        scatter: mean square of what the radiance of those pixels deviates from what stands for them [n, C].
        merged: the squares of pixels that the first samples stand for; None: every sample is a pixel.
        settled: the least-squares problem where it is known already; None: as `working` finds it.
        kept: what depends on the points alone, by name, kept by who has computed it; None where samples come and go.
    """

    points: Points
    radiance: Tensor
    readout: Readout
    limits: Limits | None = None
    clipped: Tensor | None = None
    cluster: int | None = None
    runs: tuple[tuple[int, int], ...] = ()
    pixels: Tensor | None = None
    copies: Tensor | None = None
    scatter: Tensor | None = None
    merged: Merged | None = None
    settled: Working | None = None
    kept: dict[str, Any] | None = None

    def __len__(self) -> int:
        return len(self.radiance)

    def __getitem__(self, index: slice | Tensor) -> Batch:
        """Some of the samples."""
        readout = Readout(*(value if len(value) == 1 else value[index] for value in self.readout))
        limits = None
        if self.limits is not None:
            limits = Limits(*(value if len(value) == 1 else value[index] for value in self.limits))
        own = {name: getattr(self, name) for name in ("clipped", "pixels", "copies", "scatter")}
        own = {name: None if value is None else value[index] for name, value in own.items()}
        return Batch(self.points[index], self.radiance[index], readout, limits, cluster=self.cluster, **own)

    def variance(self, radiance: Tensor) -> Tensor:
        """Noise variance of a pixel of this true `radiance` [n, C]."""
        return self.readout.variance(radiance)

    def weight(self, radiance: Tensor) -> Tensor:
        """Inverse variance of samples of this true `radiance` [n, C]; 0 where the measured value is clipped."""
        weight = self._merged(1 / self.variance(radiance))
        return weight if self.clipped is None else weight * (self.clipped == 0)

    def _merged(self, weight: Tensor) -> Tensor:
        """The weight of samples whose pixels have this weight each."""
        return weight if self.copies is None else weight * self.copies

    def measured(self) -> Working:
        """The problem for a first guess: one variance a channel, clipped values taken as measured.

        Weights that follow the measured radiance would give dark outliers the most of it. A highlight that is saturated
        is lower than it should be, but there.
        """
        typical = self.radiance.median(dim=0, keepdim=True).values if len(self) else self.radiance
        weight = self._merged((1 / self.variance(typical)).expand_as(self.radiance))
        plain = torch.ones_like(weight, dtype=torch.bool)
        return Working(self.radiance, weight, plain, self.copies, self.scatter)

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
            plain = torch.ones_like(weight, dtype=torch.bool)
            return Working(self.radiance, self._merged(weight), plain, self.copies, self.scatter)
        lower, upper = self.limits
        std = variance.sqrt()
        plain = (reference - lower > _CLEAR * std) & (upper - reference > _CLEAR * std)
        # What lies far from the reference was not clipped by chance.
        plain = plain | (squared > far)
        response, weight = self.radiance, self._merged(weight)
        if self.clipped is not None and bool(self.clipped.any()):
            response, weight, plain = response.clone(), weight.clone(), plain.clone()
            at = self.clipped.nonzero(as_tuple=True)
            side, mean, spread = self.clipped[at].to(reference), reference[at], misfit * std.expand_as(reference)[at]
            end = torch.where(side > 0, upper.expand_as(reference)[at], lower.expand_as(reference)[at])
            z = side * (mean - end) / spread
            trust = _trust(-z)
            # Beyond what is trusted at all hazard and z would cancel to nothing.
            z = z.clamp(min=-REJECTED)
            hazard = torch.exp(-0.5 * z.square() - torch.special.log_ndtr(z) - _LOG_ROOT_TWO_PI)
            response[at] = mean + side * spread / (hazard + z)
            weight[at] = trust * hazard * (hazard + z) / (spread / misfit).square()
            # A clipped value says nothing of how well the model fits, unless it is an outlier.
            plain[at] = trust == 0
        return Working(response, weight, plain, self.copies, self.scatter)


def _trust(deviation: Tensor) -> Tensor:
    return ((REJECTED - deviation) / (REJECTED - TRUSTED)).clamp(0, 1)
