"""The likelihood of the true radiance given a measured value, and the least squares that approximate it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

# Standard deviations up to which residuals count in full. Only one value in 16,000 of Gaussian noise lies beyond, so
# that nothing is lost where there are no outliers.
TRUSTED = 4.0
# Standard deviations beyond which residuals do not count: they are outliers.
REJECTED = 6.0
# Standard deviations from an end of the sensor's range within which a value may be clipped and is no measure of the
# fit.
_CLEAR_OF_CLIPPING = 3.0
# Values this many times as large as most samples of like half angle, and as most of all, are wild.
_WILD_RATIO = 10.0
# Share of the samples that are "most": a tenth may be outliers.
_TAME_SHARE = 0.9
# log √(2π), of the normal density.
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
        # The clamp keeps the power differentiable at black.
        return variance + self.rounding * signal.clamp(min=1e-12) ** self.power if self.rounding.any() else variance


class Limits(NamedTuple):
    """Radiance at which the sensor clips at its lower and upper end; tensors [1 or n, 1 or C], may be infinite."""

    lower: Tensor
    upper: Tensor


class Clipped(NamedTuple):
    """The m values of some samples that the sensor clipped.

    Attributes:
        at: their rows and channels, two of [m].
        side: 1 where a value is saturated, −1 where it is clipped at black [m].
        end: radiance of the end of the sensor's range [m].
    """

    at: tuple[Tensor, ...]
    side: Tensor
    end: Tensor


class Comparison(NamedTuple):
    """A scale on which measured and modelled values are compared in a cost that is no likelihood: Σ (g(y) − g(μ))²/s².

    Every value counts in full, however far it lies from the model. Tensors [n, C].

    Attributes:
        function: g, increasing.
        slope: its derivative, finite everywhere.
    """

    function: Callable[[Tensor], Tensor]
    slope: Callable[[Tensor], Tensor]


@dataclass(frozen=True, eq=False)
class MeasurementNoise:
    """How the measured radiance of n samples strays from the true one.

    Attributes:
        readout: noise of the sensor; with a comparison, variance s² of g.
        limits: ends of the sensor's range; None where it has none.
        clipped: −1 where a value is clipped at black, 1 where it is saturated, otherwise 0, [n, C]; None: nowhere.
        comparison: takes the place of the likelihood; None: there is one.
    """

    readout: Readout
    limits: Limits | None = None
    clipped: Tensor | None = None
    comparison: Comparison | None = None

    def __getitem__(self, index: slice | Tensor) -> MeasurementNoise:
        """That of some of the samples."""
        readout = Readout(*(value if len(value) == 1 else value[index] for value in self.readout))
        limits = None
        if self.limits is not None:
            limits = Limits(*(value if len(value) == 1 else value[index] for value in self.limits))
        clipped = None if self.clipped is None else self.clipped[index]
        return MeasurementNoise(readout, limits, clipped, self.comparison)

    def variance(self, radiance: Tensor) -> Tensor:
        """Noise variance of a value of this true `radiance` [n, C]."""
        variance = self.readout.variance(radiance)
        return variance if self.comparison is None else variance / self.comparison.slope(radiance).square()

    def clipped_values(self) -> Clipped | None:
        """The clipped values; None where there are none."""
        if self.limits is None or self.clipped is None or not bool(self.clipped.any()):
            return None
        at = self.clipped.nonzero(as_tuple=True)
        lower, upper = (end.expand_as(self.clipped)[at] for end in self.limits)
        side = self.clipped[at].to(upper)
        return Clipped(at, side, torch.where(side > 0, upper, lower))


class Means(NamedTuple):
    """The pixels that each sample is the mean of.

    Attributes:
        pixels: number of pixels that each sample replaces [n, 1]; its radiance is as precise as their mean.
        scatter: mean square deviation of the radiance of those pixels from the samples [n, C].
    """

    pixels: Tensor
    scatter: Tensor


class Errors(NamedTuple):
    """Measured values for the relative error of a model where some are clipped, all [n, C].

    Attributes:
        measured: the radiance; of a clipped value the end of the sensor's range.
        usable: whether a value counts; a clipped one does where the model lies on the wrong side of that end.
    """

    measured: Tensor
    usable: Tensor


class LeastSquares(NamedTuple):
    """The least-squares problem that approximates the likelihood near a reference, all [n, C].

    Attributes:
        response: the measured radiance; where it was clipped, the reference moved by a Newton step.
        weight: inverse variance, less for what is clipped, 0 for outliers.
        plain: values that a goodness of fit may be judged by: measured, and not near the ends of the sensor's range
            where the reference is too.
        means: the pixels that samples are means of; None: every sample is one pixel.
        errors: values for the relative error; None: all of the response.
        rejection: square of the deviation, in standard deviations of the noise, beyond which values are outliers; one
            for all, or [n, 1].
    """

    response: Tensor
    weight: Tensor
    plain: Tensor
    means: Means | None = None
    errors: Errors | None = None
    rejection: Tensor | float = REJECTED**2

    def some(self, rows: Tensor) -> LeastSquares:
        """That of some samples, int64 [m]."""
        means = None if self.means is None else Means(*(part[rows] for part in self.means))
        errors = None if self.errors is None else Errors(*(part[rows] for part in self.errors))
        rejection = self.rejection[rows] if isinstance(self.rejection, Tensor) else self.rejection
        return LeastSquares(self.response[rows], self.weight[rows], self.plain[rows], means, errors, rejection)


class Deviations(NamedTuple):
    """How far values lie from a model, both [n, C].

    Attributes:
        size: in standard deviations of the noise; of a clipped value how far the model lies inside the sensor's range,
            or 0.
        clear: whether noise does not clip values of the model.
    """

    size: Tensor
    clear: Tensor


def first_guess(
    radiance: Tensor, noise: MeasurementNoise, means: Means | None = None, classes: Sequence[Tensor] = ()
) -> LeastSquares:
    """The problem for a first guess: one variance a channel, clipped values taken as measured.

    The variance is that of the median: weights from each measured radiance would be largest for dark outliers. A
    saturated highlight is too low then, but it is in the data. Wild values do not count: without bound, a single one
    would be all that the guess explains.

    Args:
        radiance: measured [n, C].
        noise: of the samples.
        means: what they are means of.
        classes: rows of samples that a highlight brightens alike.
    """
    typical = radiance.median(dim=0, keepdim=True).values if len(radiance) else radiance
    weight = _of_means((1 / noise.variance(typical)).expand_as(radiance), means)
    tame = torch.ones_like(weight, dtype=torch.bool)
    size = radiance.abs()
    if len(radiance) and bool((size > (limit := _WILD_RATIO * size.quantile(_TAME_SHARE, dim=0))).any()):
        for rows in classes:
            tame[rows] = size[rows] <= torch.maximum(_WILD_RATIO * size[rows].quantile(_TAME_SHARE, dim=0), limit)
    return LeastSquares(radiance, weight * tame, torch.ones_like(tame), means)


def about(
    reference: Tensor,
    radiance: Tensor,
    noise: MeasurementNoise,
    means: Means | None = None,
    residual_scale: Tensor | float = 1.0,
) -> LeastSquares:
    """The problem whose solution is, to second order, the maximum of the likelihood.

    Variances are those at the reference. A clipped value says that the radiance lies beyond the limit, with probability
    Φ(z), z = ±(reference − limit)/s: its score is φ/Φ and its information h (h + z), h = φ/Φ. Values far from the
    reference are outliers.

    Args:
        reference: model radiance near the solution [n, C].
        radiance: measured [n, C].
        noise: of the samples.
        means: what they are means of.
        residual_scale: typical residual in standard deviations of the noise, at least 1, one for all or [n, 1]: where
            the model does not hold, outliers are judged by it.
    """
    variance = noise.variance(reference)
    weight = 1 / variance
    if noise.comparison is not None:
        return _compared(reference, radiance, noise.comparison, _of_means(weight, means), means)
    squared = (radiance - reference).square() * weight
    rejection = (REJECTED * residual_scale) ** 2
    # Skipped where there is no outlier, as in most tiles.
    strays = bool((squared > (TRUSTED * residual_scale) ** 2).any())
    if strays:
        weight = _trust(squared.sqrt() / residual_scale) * weight
    if noise.limits is None:
        plain = torch.ones_like(weight, dtype=torch.bool)
        return LeastSquares(radiance, _of_means(weight, means), plain, means, rejection=rejection)
    std = variance.sqrt()
    plain = _clear(reference, noise.limits, std)
    if strays:
        # Rejected values were not clipped by noise. Those a little nearer may be its tail: to count only that of values
        # near the ends would make the noise look larger.
        plain = plain | (squared > rejection)
    response, weight = radiance, _of_means(weight, means)
    errors, clipped = None, noise.clipped_values()
    if clipped is not None:
        response, weight, plain = response.clone(), weight.clone(), plain.clone()
        errors, (at, side, end) = _errors(reference, radiance, clipped), clipped
        mean, stds = reference[at], std.expand_as(reference)[at]
        spread = stds * (residual_scale[at[0], 0] if isinstance(residual_scale, Tensor) else residual_scale)
        z = side * (mean - end) / spread
        trust = _trust(-z)
        # For larger −z, hazard and z would cancel to 0.
        z = z.clamp(min=-REJECTED)
        hazard = torch.exp(-0.5 * z.square() - torch.special.log_ndtr(z) - _LOG_ROOT_TWO_PI)
        response[at] = mean + side * spread / (hazard + z)
        weight[at] = trust * hazard * (hazard + z) / stds.square()
        # A clipped value is no measure of the fit, unless it is an outlier.
        plain[at] = trust == 0
    return LeastSquares(response, weight, plain, means, errors, rejection)


def deviations(reference: Tensor, radiance: Tensor, noise: MeasurementNoise) -> Deviations:
    """How far values lie from the model; arguments as in `about`."""
    std = noise.variance(reference).sqrt()
    size = (radiance - reference).abs() / std
    clear = torch.ones_like(size, dtype=torch.bool)
    if noise.limits is not None and noise.comparison is None:
        clear = _clear(reference, noise.limits, std)
        if (clipped := noise.clipped_values()) is not None:
            at, side, end = clipped
            size[at] = (side * (end - reference[at]) / std.expand_as(size)[at]).clamp(min=0)
            clear[at] = False
    return Deviations(size, clear)


def _clear(reference: Tensor, limits: Limits, std: Tensor) -> Tensor:
    """Where a model [n, C] lies so far inside the sensor's range that noise of `std` clips no value."""
    return torch.minimum(reference - limits.lower, limits.upper - reference) > _CLEAR_OF_CLIPPING * std


def _compared(
    reference: Tensor, radiance: Tensor, comparison: Comparison, weight: Tensor, means: Means | None
) -> LeastSquares:
    """The Gauss-Newton problem of a comparison: g is linear about the reference."""
    difference = comparison.function(radiance) - comparison.function(reference)
    everywhere = torch.ones_like(weight, dtype=torch.bool)
    response = reference + difference / comparison.slope(reference)
    return LeastSquares(response, weight, everywhere, means, Errors(radiance, everywhere))


def _errors(reference: Tensor, radiance: Tensor, clipped: Clipped) -> Errors:
    """Values for the relative error of a model of radiance `reference` [n, C]."""
    at, side, end = clipped
    measured, usable = radiance.clone(), torch.ones_like(radiance, dtype=torch.bool)
    measured[at] = end
    usable[at] = torch.where(side > 0, reference[at] < end, reference[at] > end)
    return Errors(measured, usable)


def squared_errors(reference: Tensor, radiance: Tensor, noise: MeasurementNoise) -> tuple[float, float]:
    """Sums of the squared residual and of the squared signal of all usable values, for a model `reference` [n, C]."""
    residual, signal = radiance - reference, radiance
    if (clipped := noise.clipped_values()) is not None:
        errors = _errors(reference, radiance, clipped)
        residual, signal = (errors.measured - reference) * errors.usable, errors.measured * errors.usable
    return float(residual.double().square().sum()), float(signal.double().square().sum())


def _of_means(weight: Tensor, means: Means | None) -> Tensor:
    """The weight of samples whose pixels have this weight each."""
    return weight if means is None else weight * means.pixels


def _trust(deviation: Tensor) -> Tensor:
    """Weight by the deviation in standard deviations: 1 up to `TRUSTED`, 0 from `REJECTED` on, linear between."""
    return ((REJECTED - deviation) / (REJECTED - TRUSTED)).clamp(0, 1)
