"""The numbers that keys of capture and scene files may have: declared beside the keys, checked in one place."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, get_args, get_type_hints

import msgspec

from matest.errors import Fault
from matest.photographs.images import LARGEST

# Digits of a whole number beyond which it is said how long it is instead of printing it.
_SHOWN_DIGITS = 20


@dataclass(frozen=True)
class Range:
    """Numbers from one to another, as a key of a file may have them; NaN is in no range.

    Attributes:
        rule: what the number must be, the end of a sentence that begins with the key.
        lower, upper: ends of the range.
        ends: whether the ends belong to it, the lower and the upper one.
    """

    rule: str
    lower: float = -LARGEST
    upper: float = LARGEST
    ends: tuple[bool, bool] = (False, False)

    def __contains__(self, value: float) -> bool:
        above = value >= self.lower if self.ends[0] else value > self.lower
        below = value <= self.upper if self.ends[1] else value < self.upper
        return above and below


FINITE = Range(f"must be finite and below {LARGEST:g}")
NOT_NEGATIVE = Range(f"must be below {LARGEST:g} and not negative", 0, ends=(True, False))
POSITIVE = Range(f"must be positive and below {LARGEST:g}", 0)
# Less than a pixel of any image, and more than what a division by it overflows.
_LEAST_PIXELS = 1e-3
PIXELS = Range(f"must be pixels, {_LEAST_PIXELS:g} or more and below {LARGEST:g}", _LEAST_PIXELS, ends=(True, False))
WORLD_UNITS = Range(f"must be positive world units, below {LARGEST:g}", 0)
# A fifth of an arc second: no lens sees less.
ANGLE_OF_VIEW = Range("must lie between 1e-6 and π rad", 1e-6, math.pi)
SOLID_ANGLE = Range("must lie between 0 and 4π sr", 0, 4 * math.pi, ends=(False, True))
# Those of cameras and screens lie between 0.4 and 2.6: a percentage or a typing error does not.
GAMMA = Range("as a number is a gamma and must lie between 0.1 and 10", 0.1, 10, ends=(True, True))
# Divided by less, a radiance leaves what single precision can square.
SCALE = Range(f"is the radiance of full scale and must lie between {1 / LARGEST:g} and {LARGEST:g}", 1 / LARGEST)
FACTOR = Range(f"must lie between {1 / LARGEST:g} and {LARGEST:g}", 1 / LARGEST)
PEDESTAL = Range("must be a fraction of full scale")
SATURATION = Range("must be a positive fraction of full scale, or one per channel", 0)
# Squares of radiance and its noise must stay within single precision.
POWER = Range(f"must be one number or one per channel, not negative and below {LARGEST:g}", 0, ends=(True, False))
# µm: values in nm lie far above.
WAVELENGTH = Range("is in µm (green is 0.55)", 0.1, 20)
# Beyond the exponent 1000 the half width at half maximum of a beam is below 2°.
ANISOTROPY = Range("must lie between 0 and 1000 (1: Lambertian)", 0, 1000, ends=(True, True))
# Every pixel is shaded once for each of them.
DIRECTIONS = Range("must be 16 to 65536 directions", 16, 65536, ends=(True, True))
# Whole numbers: seeds that a generator takes.
SEED = Range("must lie between 0 and 2⁶³", 0, 2**63, ends=(True, False))
# Sides of images that do not exist yet, pixels: a typo must not fill the memory.
SIDE = Range("must be width and height in pixels, 1 to 16384", 1, 16384, ends=(True, True))
# 16 × 16 rays resolve the coverage of a pixel to one step of 8 bits.
RAYS = Range("must be 1 to 16", 1, 16, ends=(True, True))


def range_faults(table: msgspec.Struct, place: str = "") -> Iterator[Fault]:
    """The numbers of a table, and of those in it, that are outside the ranges of their keys.

    Args:
        table: whose annotations may hold a `Range`; where there is none, any finite number is possible.
        place: where it is in the file, in front of the names of its keys.
    """
    for key, annotation in get_type_hints(type(table), include_extras=True).items():
        value = getattr(table, key)
        if isinstance(value, list) and value and isinstance(value[0], msgspec.Struct):
            for number, entry in enumerate(value):
                outside = f"{place.removesuffix(': ')}, " if place else ""
                yield from range_faults(entry, f"{outside}{key.removesuffix('s')} {number}: ")
        elif isinstance(value, msgspec.Struct):
            yield from range_faults(value, f"{place}{key}.")
        else:
            yield from _value_faults(value, _declared(annotation) or FINITE, place + key)


def shown(value: Any) -> str:
    """A number or a list of them as text; whole numbers without end by their number of digits."""
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(shown, value))}]"
    if isinstance(value, int) and abs(value) >= 10**_SHOWN_DIGITS:
        return f"a whole number of more than {_SHOWN_DIGITS} digits"
    return str(value)


def _value_faults(value: Any, admitted: Range, label: str) -> Iterator[Fault]:
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _value_faults(inner, admitted, f"{label}.{key}")
    else:
        wrong = any(number not in admitted for number in _numbers(value))
        yield wrong, f"{label} {admitted.rule}; got {shown(value) if wrong else ''}."


def _numbers(value: Any) -> Iterator[float]:
    """The numbers in a value, at any depth of lists."""
    if isinstance(value, Sequence) and not isinstance(value, str):
        for entry in value:
            yield from _numbers(entry)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield value


def _declared(annotation: Any) -> Range | None:
    """The range in an annotation, at any depth."""
    metadata = getattr(annotation, "__metadata__", ())
    inner = (_declared(argument) for argument in get_args(annotation))
    return next((one for one in (*metadata, *inner) if isinstance(one, Range)), None)
