"""Maps smoothed as far as their error bars allow, with the error bars of what comes out."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d, pad

from matest.estimation.parameter_map import ParameterMap, TexelStatus
from matest.inference.quantities import ParameterEstimate
from matest.scene import Surface
from matest.workers import in_threads

# Standard deviation of the weight by distance, relative to the radius, at which it is cut off.
_WIDTH = 2 / 3
# Difference of two guiding values, in standard errors, at which the weight has fallen to exp(-1/2): a smaller one picks
# neighbours by their noise, a larger one blurs faint edges.
_EDGE = 1.5
# Radius of the means that guide the first filter, pixels: 3×3 pixels.
_FIRST = 1.5
# Filters, each guided by the one before: edges are sharp after the second.
_FILTERS = 2
# Least share of a squared error bar that is the pixel's own noise.
_LEAST_NOISE = 1e-2
# Pixels that are filtered at once: few enough for the processor's cache.
_AT_ONCE = 1 << 15


class _Values(NamedTuple):
    """Values and the variances of their noise, infinite where there is none, both [C, H, W]."""

    value: Tensor
    variance: Tensor


def smoothed(
    each: ParameterMap,
    surface: Surface,
    radius: int,
    mean: ParameterEstimate,
    chi2: float = 1.0,
    *,
    is_shape: bool = False,
) -> ParameterMap:
    """A map of weighted means over the pixels around every pixel that its error bar does not tell apart from it.

    A neighbour counts by its inverse variance, its distance, and how many standard errors it is off (a joint bilateral
    filter): first between means over 3×3 pixels, as single values would be picked by their noise, then between what
    that gives. Error bars are those of the weighted means, if the pixels that count have one value. Pixels whose own
    photographs do not tell them follow others and are not followed; those that no photograph shows keep no value.

    OpenCV's filters do not give the sums of squared weights that error bars need.

    Args:
        each: the map.
        surface: whose N pixels it has values at.
        radius: of the neighbourhood, pixels.
        mean: of the map, whose error all pixels share in proportion: no smoothing lessens it.
        chi2: of the fit, per degree of freedom. What error bars hold beyond noise where it is above 1 is of the model,
            which is wrong in the same way at neighbours: no smoothing lessens that either.
        is_shape: whether it is of a parameter that shapes the reflectance: its error bars grow with its values, by
            which weights of single pixels would draw means down, so that pixels take the mean variance around them.
    """
    squared = each.std.square()
    common = (each.value * _relative_error(mean).to(each.value)).square()
    noise = torch.maximum((squared - common) / max(chi2, 1.0), _LEAST_NOISE * squared)
    known = each.value.isfinite() & (noise > 0)
    rows, columns = _places(surface)

    def image(values: Tensor, elsewhere: float) -> Tensor:
        box = torch.full((values.shape[1], int(rows.max()) + 1, int(columns.max()) + 1), elsewhere)
        box[:, rows, columns] = values.float().T
        return box

    tells = known & (each.status != TexelStatus.SHARED)[:, None]
    spread = noise
    if is_shape:
        around = _box_mean(image(torch.where(tells, noise, 0.0), 0.0), image(tells, 0.0), radius)
        spread = torch.where(tells, around[:, rows, columns].T.to(noise), noise)
    values = _Values(
        image(torch.where(known, each.value, 0.0), 0.0), image(torch.where(known, spread, math.inf), math.inf)
    )
    offered = image(torch.where(tells, 1 / spread, 0.0), 0.0)
    means = _filtered(values, offered, _FIRST)
    guide = _Values(*(torch.where(offered > 0, *pair) for pair in zip(means, values, strict=True)))
    for _ in range(_FILTERS):
        guide = _filtered(values, offered, radius, guide)
    value, variance = (part[:, rows, columns].T.to(each.value) for part in guide)
    return replace(
        each,
        value=torch.where(known, value, each.value),
        std=torch.where(known, (variance + squared - noise).sqrt(), each.std),
    )


def smoothing_note(radius: int) -> str:
    """The sentence on what error bars of smoothed maps hold."""
    return (
        f"Smoothed maps (radius {radius} px) are weighted means: their error bars hold where the material is the same "
        "over that radius or changes by steps beyond the noise, and are too small at fainter steps and on gradients."
    )


def _relative_error(mean: ParameterEstimate) -> Tensor:
    """The standard error of a mean relative to it [1 or C]; 0 where there is none."""
    if mean.value is None or mean.std is None:
        return torch.zeros(1)
    value, std = (torch.atleast_1d(torch.as_tensor(part)) for part in (mean.value, mean.std))
    return torch.where(value != 0, std / value, 0.0)


def _places(surface: Surface) -> tuple[Tensor, Tensor]:
    """Rows and columns of the object's pixels in the box around them [N]."""
    rows, columns = np.divmod(surface.pixels.astype(np.int64), surface.shape[1])
    return torch.from_numpy(rows - rows.min()), torch.from_numpy(columns - columns.min())


def _box_mean(values: Tensor, counts: Tensor, radius: int) -> Tensor:
    """Means of the values that count, 1 or 0, over the square around every pixel [C, H, W]; 0 where none does."""
    side = 2 * radius + 1
    total, number = (avg_pool2d(part, side, stride=1, padding=radius) for part in (values, counts))
    return torch.where(number > 0, total / number, 0.0)


def _filtered(values: _Values, offered: Tensor, radius: float, guide: _Values | None = None) -> _Values:
    """Weighted means of the pixels around every pixel.

    Args:
        values: of all pixels.
        offered: weight of a pixel for others, its inverse variance or 0 [C, H, W].
        radius: of the neighbourhood, pixels.
        guide: whose differences lower weights; None: every neighbour counts by its inverse variance alone.
    """
    reach = int(radius)
    margin = (reach,) * 4
    around = [pad(values.value, margin), pad(offered, margin)]
    if guide is not None:
        around += [pad(guide.value, margin), pad(guide.variance, margin, value=math.inf)]
    _, height, width = offered.shape
    step = max(_AT_ONCE // width, 1)
    rows = [slice(first, min(first + step, height)) for first in range(0, height, step)]
    bands = in_threads(lambda some: _of_rows(values, around, guide, some, radius), rows)
    return _Values(*(torch.cat(parts, dim=1) for parts in zip(*bands, strict=True)))


def _of_rows(values: _Values, around: list[Tensor], guide: _Values | None, rows: slice, radius: float) -> _Values:
    """The same for some rows; `around` has values, weights and guide with a margin."""
    own = _Values(values.value[:, rows], values.variance[:, rows])
    # Every pixel counts for itself by its inverse variance, whatever it is for others.
    total = 1 / own.variance
    weighted, squares = total * own.value, total.clone()
    reach, width = int(radius), own.value.shape[2]
    for y in range(-reach, reach + 1):
        for x in range(-reach, reach + 1):
            distance = y * y + x * x
            if not 0 < distance <= radius * radius:
                continue
            window = (
                slice(None), slice(rows.start + reach + y, rows.stop + reach + y), slice(reach + x, reach + x + width)
            )  # fmt: skip
            value, weight, *guiding = (part[window] for part in around)
            if guide is not None:
                difference = (guide.value[:, rows] - guiding[0]).square() / (guide.variance[:, rows] + guiding[1])
                exponent = difference.mean(dim=0) / _EDGE**2 + distance / (_WIDTH * radius) ** 2
                closeness = torch.exp(-0.5 * exponent)
                weight = closeness * weight
                squares += closeness * weight
            else:
                squares += weight
            total += weight
            weighted += weight * value
    found = total > 0
    return _Values(torch.where(found, weighted / total, 0.0), torch.where(found, squares / total.square(), math.inf))
