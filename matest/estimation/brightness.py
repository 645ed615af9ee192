"""Whether photographs are as bright as surfaces can be under the lights that are stated."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import torch

from matest.brdf import Lambert
from matest.inference.quantities import ParameterEstimate
from matest.samples import Samples
from matest.shading import shade

if TYPE_CHECKING:
    from matest.estimation.warnings import Context

# Times the brightness of a white matte surface that no object has on the whole: highlights are small.
_TOO_BRIGHT = 10.0
# Albedo below that of every surface: carbon nanotubes, the darkest, have some 4e-4.
_TOO_DARK = 1e-4
# Samples that tell how bright photographs are.
_COUNT = 1000
_MEND = "encoding.scale, an exposure or an irradiance is likely wrong by that much; correct it."


def impossible_brightness(context: Context) -> Iterator[str]:
    """The rule that says when what is estimated is brighter or darker than any surface."""
    bright = too_bright(context.samples) if context.not_determined else ""
    amplitudes = sorted(context.solution.problem.brdf.structure.amplitudes)
    if sentence := bright or too_dark(context.parameters, amplitudes, context.samples.relative):
        yield sentence


def too_bright(samples: Samples) -> str:
    """A sentence on photographs that are brighter than anything could be; empty where they are not.

    Args:
        samples: of photographs.
    """
    level = _level(samples)
    if not level > _TOO_BRIGHT:
        return ""
    return f"The images are {level:.2g} times as bright as a white surface would be: {_MEND}"


def unlike_surfaces(samples: Samples) -> str:
    """A sentence on photographs that are brighter or darker than anything could be; empty where they are not."""
    level = _level(samples)
    if not 0 < level < _TOO_DARK:
        return too_bright(samples)
    return f"The images are {level:.2g} times as bright as a white surface would be: they are black, or {_MEND}"


def _level(samples: Samples) -> float:
    """Brightness as a multiple of that of a white matte surface; NaN where the strength of the lights is unknown."""
    measured = white = 0.0
    for batch in samples.pilot(_COUNT, seed=0):
        matte = Lambert(torch.tensor(1.0)).to(batch.radiance.dtype, batch.radiance.device)
        with torch.no_grad():
            white += float(shade(matte, batch.points).expand_as(batch.radiance).double().sum())
        measured += float(batch.radiance.double().sum())
    return measured / white if white > 0 and not samples.relative else math.nan


def too_dark(estimates: Mapping[str, ParameterEstimate], amplitudes: Sequence[str], relative: bool) -> str:
    """A sentence on strengths of which none is as large as those of a surface; empty where one is.

    Args:
        estimates: of parameters by name.
        amplitudes: names of those that the brightness is proportional to.
        relative: whether the strength of the lights is unknown.
    """
    values = [value for name in amplitudes if name in estimates for value in _numbers(estimates[name].value)]
    if relative or not values or not 0 < max(values) < _TOO_DARK:
        return ""
    return f"No surface is as dark as {max(values):.2g}, the largest of what is estimated: {_MEND}"


def _numbers(value: float | list[float | None] | None) -> list[float]:
    """The values that are determined."""
    return [one for one in (value if isinstance(value, list) else [value]) if one is not None]
