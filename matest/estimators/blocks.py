"""Blocks of unknowns: what there is to estimate, how many of it, and how it enters a model."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

from torch import Tensor

from matest.parameters import Domain, non_negative
from matest.samples.calibration import Family
from matest.samples.groups import GroupAxis

# How many unknowns a block has: one, one per channel, one per image, light or group of samples, or as many as a family
# of errors of the calibration.
Axis = Literal["one", "channel", "family"] | GroupAxis
# How a block enters the model: a parameter of it; the reciprocal of the unknown common scale of the lights, which the
# gauge parameters of the model take; a multiplier of the radiance of each image, light or group of samples; an error of
# the calibration.
Kind = Literal["parameter", "light_scale", "multiplier", "nuisance"]
# The axes that blocks of each kind may have.
_AXES: dict[Kind, tuple[Axis, ...]] = {
    "parameter": ("one", "channel"),
    "light_scale": ("one", "channel"),
    "multiplier": ("image", "light", "group"),
    "nuisance": ("family",),
}


@dataclass(frozen=True)
class Block:
    """Unknowns that belong together.

    Attributes:
        name: of the parameter (in a sum: its path), or of what is calibrated.
        domain: of each unknown.
        axis: what there is one unknown for.
        kind: how it enters the model.
        start: where it starts, and the mean of its prior.
        prior: standard deviation of a Gaussian prior about `start`; None: flat.
        centred: whether the mean of the unknowns is `start`.

    Raises:
        ValueError: an axis that blocks of its kind cannot have.
    """

    name: str
    domain: Domain
    axis: Axis = "one"
    kind: Kind = "parameter"
    start: float = 0.5
    prior: float | None = None
    centred: bool = False

    def __post_init__(self) -> None:
        if self.axis not in _AXES[self.kind]:
            raise ValueError(f"{self.name}: a {self.kind} cannot have the axis {self.axis}.")


def multipliers(name: str, axis: GroupAxis, prior: float | None) -> Block:
    """Multiples of the stated radiance; held at 1 where they are no block of a problem.

    The exposures of images, the powers of lights that light one image each or several, the albedo of groups.

    Args:
        name: of what is multiplied.
        axis: what there is one unknown for.
        prior: standard deviation.
    """
    return Block(name, non_negative, axis, "multiplier", start=1.0, prior=prior)


def nuisance(family: Family, prior: float, *, centred: bool = False) -> Block:
    """The unknown errors of a family.

    Args:
        family: of the calibration.
        prior: standard deviation of the error as a whole.
        centred: whether they are 0 on average.
    """
    everywhere = Domain(-math.inf, math.inf)
    return Block(family.name, everywhere, "family", "nuisance", start=0.0, prior=prior * family.spread, centred=centred)


class Multiplier(NamedTuple):
    """What multiplies the radiance of the samples of each group.

    Attributes:
        value: [G].
        slopes: its derivatives by the M unknowns that a group touches [G, M].
    """

    value: Tensor
    slopes: Tensor
