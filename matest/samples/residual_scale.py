"""How large residuals are where a model does not hold: by class of half angle, as a lobe that it lacks has them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from matest.samples.likelihood import TRUSTED, Deviations
from matest.scene.points import Points

# Samples of a class of half angle, at least: outliers are then a tenth of none by chance.
_CLASS_SAMPLES = 100
# Share of the samples nearer to the mirror direction that a class has: a lobe that shows in few of them fills some.
_CLASS_GROWTH = 0.25
# Share of the values of a class that may be outliers: what more of them have in common is the model's failure.
_MAX_OUTLIER_SHARE = 0.1
# Median of |N(0, 1)|.
_MEDIAN_DEVIATION = 0.6745
# Standard deviation of the median of n such values relative to it, times √n.
_MEDIAN_STD = 1.166
# Standard deviations of that median up to which the residuals of one of so many classes are the noise.
_CHANCE_DEVIATIONS = 5.0


@dataclass(frozen=True, eq=False)
class ResidualScale:
    """Typical residuals in standard deviations of the noise, at least 1, by which outliers are judged.

    A lobe that a model lacks shows at some half angles: values that miss the model together there are its failure, and
    keep their weight; an outlier misses it by more than others of like half angle.

    Attributes:
        ends: sin² of the half angle where the classes after the first begin, ascending [K − 1].
        values: of the classes [K].
    """

    ends: Tensor
    values: Tensor

    @classmethod
    def uniform(cls, value: float = 1.0) -> ResidualScale:
        """One for all half angles."""
        return cls(torch.zeros(0), torch.tensor([value], dtype=torch.float64))

    @classmethod
    def of(cls, half_angles: Tensor, deviations: Deviations) -> ResidualScale:
        """The scale of the residuals of n samples, whose half angles [n] are as `half_angle` gives them."""
        ends, classes = like_angled(half_angles)
        values = [_scale(deviations.size[rows], deviations.clear[rows]) for rows in classes]
        return cls(ends, torch.tensor(values, dtype=torch.float64))

    @cached_property
    def smallest(self) -> float:
        return float(self.values.min())

    @cached_property
    def typical(self) -> float:
        """The median of the classes."""
        return float(self.values.median())

    def above(self, limit: float) -> tuple[float, float] | None:
        """The half angles, in radians, about the class of the largest scale if it is above a limit; else None."""
        high = (self.values > limit).tolist()
        start = end = int(self.values.argmax())
        if not high[start]:
            return None
        while start and high[start - 1]:
            start -= 1
        while end < len(high) - 1 and high[end + 1]:
            end += 1
        bounds = [0.0, *self.ends.clamp(0, 1).tolist(), 1.0]
        return math.asin(bounds[start] ** 0.5), math.asin(bounds[end + 1] ** 0.5)

    def at(self, points: Points) -> Tensor | float:
        """The scale at n points [n, 1], or one for all."""
        if self.smallest == float(self.values.max()):
            return self.smallest
        angles = half_angle(points).flatten()
        label = torch.bucketize(angles, self.ends.to(angles), right=True)
        return self.values.to(angles)[label][:, None]


# Of a model that describes the samples to their noise.
NOISE_ALONE = ResidualScale.uniform()


def half_angle(points: Points) -> Tensor:
    """sin² of the angle between the normal and the half vector, of the light that comes nearest to its mirror [...]."""
    half = points.wi + points.wo[..., None, :]
    across = half[..., :2].square().sum(-1)
    squared = across / (across + half[..., 2].square()).clamp(min=torch.finfo(half.dtype).tiny)
    dark = (points.irradiance == 0).all(-1)
    return torch.where(dark, 1.0, squared).amin(-1) if half.shape[-2] else half.new_ones(half.shape[:-2])


def like_angled(half_angles: Tensor) -> tuple[Tensor, Sequence[Tensor]]:
    """Classes of n samples of these half angles, narrow ones at highlights.

    Returns:
        Where the classes but the first begin [K − 1], and the rows of the samples of each.
    """
    ascending, order = half_angles.sort()
    places, place = [], _CLASS_SAMPLES
    while place <= len(half_angles) - _CLASS_SAMPLES:
        places.append(place)
        place += max(_CLASS_SAMPLES, int(_CLASS_GROWTH * place))
    index = torch.tensor(places, dtype=torch.int64)
    # Samples of one half angle are of one class.
    index = index[ascending[index - 1] < ascending[index]]
    return ascending[index], order.tensor_split(index.tolist())


def _scale(size: Tensor, clear: Tensor) -> float:
    """The scale of residuals of n samples, [n, C] as in `Deviations`.

    It is the median as a multiple of a Gaussian's, of values that noise does not clip; at least 1, and large enough for
    no more than a tenth of all values to be outliers.
    """
    if not size.numel():
        return 1.0
    trusted_count = max(int((1 - _MAX_OUTLIER_SHARE) * size.numel()), 1)
    largest_trusted = float(size.flatten().kthvalue(trusted_count).values)
    judged, typical = size[clear], 1.0
    if len(judged):
        typical = float(judged.median()) / _MEDIAN_DEVIATION
    # Clipped values count with this scale and others without: one that is chance would move the optimum.
    if typical < 1 + _CHANCE_DEVIATIONS * _MEDIAN_STD / math.sqrt(max(len(judged), 1)):
        typical = 1.0
    return max(typical, largest_trusted / TRUSTED, 1.0)
