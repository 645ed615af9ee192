"""The mistakes in the description of a capture that explain why it does not fit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from matest.photographs.alternatives import Alternative, alternatives, in_order
from matest.photographs.explanation import Explanation
from matest.photographs.lattice import on_lattice

if TYPE_CHECKING:
    from matest.photographs.photographs import Photographs

# Fewer photographs do not tell light from shape.
_MIN_IMAGES = 3
# Pixels that suffice to tell one reading from another, and fewer where there are many photographs,
_PIXELS = 4_000
# so that there are about this many values of each channel; but never fewer than so many.
_VALUES, _FEWEST = 40_000, 500
# A reading is as good as another if its misfit is at most this many times as large: sRGB and 2.2 differ by less.
_EQUAL = 1.5
# Relative misfit above which photographs are read grossly wrong, and the share of it that another reading may leave.
# Captures that are read right keep 0.9 of it in every other reading; others keep 0.02 to 0.5.
_GROSS, _LEFT = 0.04, 0.6
# The same of photographs that get other lights: exchanging two that are near to each other also undoes a part of what
# their directions are off, as much as half where that is 5°.
_GROSS_OF_LIGHTS, _LEFT_OF_LIGHTS = 0.15, 0.4

# Float above which powers of it leave single precision, fractions of full scale: electrons counted lie below.
_IMMENSE = 1e6


class _Tried(NamedTuple):
    """An alternative, and how well it explains the photographs that it changes.

    Attributes:
        alternative: that was tried.
        before, after: misfits as stated, and as read here, by one albedo and by one at each pixel.
        misfit: of all photographs, as read here.
    """

    alternative: Alternative
    before: tuple[float, float]
    after: tuple[float, float]
    misfit: float

    @property
    def explains(self) -> bool:
        """Whether one of the misfits is gross and comes down: what many albedos hide, one does not, and vice versa."""
        ordered = bool(self.alternative.order)
        gross, left = (_GROSS_OF_LIGHTS, _LEFT_OF_LIGHTS) if ordered else (_GROSS, _LEFT)
        pairs = zip(self.before, self.after, strict=True)
        return any(before > gross and after < left * before for before, after in pairs)


def better_readings(photographs: Photographs) -> list[Alternative]:
    """The ways to read some photographs that explain them far better than what is stated, all equally well.

    None where there is none. The photographs of an alternative have few pixels.
    """
    if len(photographs) < _MIN_IMAGES or _immense(photographs):
        return []
    thin = on_lattice(photographs, max(min(_PIXELS, _VALUES // len(photographs)), _FEWEST))
    tried = [one for one in _trials(thin) if one.explains]
    best = min((one.misfit for one in tried), default=0.0)
    return [one.alternative for one in tried if one.misfit <= _EQUAL * best]


def _immense(photographs: Photographs) -> bool:
    """Whether floats are so large that powers of them, as other readings take, leave single precision."""
    return any(
        stored.dtype.kind == "f" and float(np.abs(stored).max(initial=0)) > _IMMENSE for stored in photographs.stored
    )


def _trials(photographs: Photographs) -> Iterator[_Tried]:
    stated = Explanation(photographs)
    before = _misfits(stated)
    for alternative in alternatives(photographs):
        read = Explanation(alternative.photographs)
        yield _Tried(alternative, before, _misfits(read), read.misfit())
    if moved := [image for image, own in enumerate(stated.order) if image != own]:
        ordered = in_order(photographs, stated.order)
        read = Explanation(ordered.photographs, stated, stated.order)
        yield _Tried(ordered, _misfits(stated, moved), _misfits(read, moved), read.misfit())


def _misfits(explanation: Explanation, images: Sequence[int] = ()) -> tuple[float, float]:
    return explanation.misfit(images, textured=False), explanation.misfit(images)
