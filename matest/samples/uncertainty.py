"""Standard uncertainties of what a calibration states: lights, photometry, pose, shape, sharpness."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from numbers import Real
from typing import Any, NamedTuple

from matest.errors import InputError, nearest

# The word that names every family.
ALL = "all"
# The word that stands for the families that explain residuals.
FOUND = "auto"
# Largest angles, rad: 11° is more than anyone would state, and half a degree taken for radians lies above it.
_ANGLE = 0.2
# Largest uncertainties of a black level, fraction of full scale, and of a gamma: more leaves nothing to be stated.
_SHARE = 0.5
# Largest relative uncertainties: percentages taken for shares lie above it.
_RELATIVE = 1.0
# Units of shares.
_SHARES = ("relative", "fraction of full scale")
# Other units of a text: how it ends, what it is converted to, and how many are one of that.
_OTHER_UNITS = (("%", _SHARES, 100.0), ("°", ("rad",), math.degrees(1)), ("deg", ("rad",), math.degrees(1)))
# Largest lengths in the image, pixels: more than images are wide is a typing error.
_LENGTH = 1e4


class Family(NamedTuple):
    """Errors of one kind that a calibration can have.

    Attributes:
        unit: of one standard deviation; of a pair both, separated by a comma.
        doc: what the standard deviation is of.
        most: the largest that makes sense, one for each number.
        example: of what one may state, as files and options write it.
    """

    unit: str
    doc: str
    most: tuple[float, ...]
    example: str = "0.01"

    @property
    def units(self) -> list[str]:
        """One for each number."""
        return self.unit.split(",")


# Families by the name that files, options and results call them.
NAMES: dict[str, Family] = {
    "direction": Family("rad", "each of two tangential angles of each light", (_ANGLE,)),
    "rotation": Family("rad", "each of three angles of a rotation common to all lights", (_ANGLE,)),
    "intensity": Family("relative", "the strength of each light", (_RELATIVE,)),
    "exposure": Family("relative", "the exposure of each image", (_RELATIVE,)),
    "scale": Family("relative", "the strength of all lights together", (_RELATIVE,)),
    "ambient": Family(
        "relative",
        "π times the radiance of an even sky, the same in all images, over the mean irradiance of each one's brightest "
        "light",
        (_RELATIVE,),
    ),
    "black": Family("fraction of full scale", "the black level of each channel", (_SHARE,)),
    "vignetting": Family(
        "relative", "the loss of radiance at the corner of the image, which grows as r²", (_RELATIVE,)
    ),
    "transfer": Family("relative", "the exponent of the transfer function", (_SHARE,)),
    "curve": Family(
        "relative", "the share of the way from a power that is stated to sRGB's transfer, or from that", (_RELATIVE,)
    ),
    "pose": Family(
        "pixels,rad",
        "the object's shift along x and y of the image, its rotation about three axes",
        (_LENGTH, _ANGLE),
        "0.5,0.01",
    ),
    "radius": Family("pixels", "the radius of the silhouette; of a mesh, its size", (_LENGTH,), "0.5"),
    "normals": Family("rad", "each tangential angle of the normals, smooth over the object", (_ANGLE,)),
    "normal_noise": Family("rad", "each tangential angle of the normals, of each pixel by itself", (_ANGLE,)),
    "blur": Family("pixels", "the width of a Gaussian that the images are convolved with", (_LENGTH,), "0.5"),
    "albedo": Family("relative", "the albedo, smooth over the object", (_RELATIVE,)),
    "albedo_noise": Family("relative", "the albedo of each pixel by itself", (_RELATIVE,)),
}
# What results call the errors that a name stands for, where they do not call them by that name.
PARTS: dict[str, tuple[str, ...]] = {"pose": ("shift", "tilt"), "albedo": ("albedo_field",)}


@dataclass(frozen=True, kw_only=True)
class Uncertainty:
    """One standard deviation of what a calibration states, by family; None: not stated.

    Attributes:
        direction, rotation, intensity, exposure, scale, ambient, black, vignetting, transfer, curve, radius, normals,
            normal_noise, blur, albedo, albedo_noise: in the units and of the quantities of `NAMES`.
        pose: in pixels, and rad. Of a sphere only the pixels matter.

    Raises:
        InputError: a value that is not positive and finite, or too large to be meant; `pose` that is no pair.
    """

    direction: float | None = None
    rotation: float | None = None
    intensity: float | None = None
    exposure: float | None = None
    scale: float | None = None
    ambient: float | None = None
    black: float | None = None
    vignetting: float | None = None
    transfer: float | None = None
    curve: float | None = None
    pose: tuple[float, float] | None = None
    radius: float | None = None
    normals: float | None = None
    normal_noise: float | None = None
    blur: float | None = None
    albedo: float | None = None
    albedo_noise: float | None = None

    def __post_init__(self) -> None:
        for name, value in self.stated.items():
            numbers = _checked(name, value)
            object.__setattr__(self, name, numbers if len(NAMES[name].most) > 1 else numbers[0])

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Uncertainty:
        """Standard deviations by the name of their family; None: not stated.

        Raises:
            InputError: no mapping, an unknown name, or a value that is refused.
        """
        if not isinstance(values, Mapping):
            raise InputError(f"what is stated are numbers by name, as {{'direction': 0.01}}; got {values!r}.")
        refuse_unknown(values)
        return cls(**values)

    @property
    def stated(self) -> dict[str, float | tuple[float, float]]:
        """What is stated, by name."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: value for name, value in values.items() if value is not None}

    def merged(self, other: Uncertainty) -> Uncertainty:
        """What either states; where both do, what `other` states."""
        return Uncertainty.of({**self.stated, **other.stated})


def families(names: str | Iterable[str]) -> tuple[str, ...]:
    """Names of families of errors, each once; "all" becomes every one, "auto" stays.

    Args:
        names: of `NAMES` or `PARTS`, several or one text that commas separate.

    Raises:
        InputError: an unknown name, a text without any, or no names at all.
    """
    if isinstance(names, str):
        names = [name for name in map(str.strip, names.split(",")) if name] or [""]
    if not isinstance(names, Iterable) or not all(isinstance(name, str) for name in names):
        raise InputError(f"names of errors are expected, as 'direction,intensity'; got {names!r}.")
    names = tuple(dict.fromkeys(names))
    if "" in names:
        raise InputError("it names no errors; name some, as direction,intensity, or leave it out.")
    refuse_unknown(name for name in names if name not in (ALL, FOUND) and whole(name) == name)
    return tuple(NAMES) if ALL in names else names


def whole(part: str) -> str:
    """The name of `NAMES` that errors belong to, by what results call them."""
    return next((name for name, parts in PARTS.items() if part in parts), part)


def labelled(part: str) -> str:
    """What results call errors, and behind that the name to state them by where it is another."""
    return part if whole(part) == part else f"{part} ({whole(part)})"


def refuse_unknown(names: Iterable[Any]) -> None:
    """Refuse a name that is no family's.

    Raises:
        InputError: with the nearest name.
    """
    for name in names:
        if name not in NAMES:
            family = whole(name)
            meant = nearest(str(name), NAMES) if family == name else f"state {family}={NAMES[family].example}."
            raise InputError(f"unknown uncertainty '{name}'; {meant}")


def read(name: str, text: str) -> list[float]:
    """The numbers that a text states of a family: `0.01`, `0.5,0.01`; also `1deg` or `1°` of angles, `3%` of shares.

    Raises:
        InputError: an unknown name, or another text.
    """
    refuse_unknown([name])
    try:
        return [_number(part.strip(), unit) for part, unit in zip(text.split(","), NAMES[name].units, strict=True)]
    except ValueError:
        raise InputError(f"{_expected(name)}; got '{text}'.") from None


def _number(text: str, unit: str) -> float:
    """A number in a unit, or in one that goes into it.

    Raises:
        ValueError: the text is neither.
    """
    for suffix, kind, per in _OTHER_UNITS:
        if unit in kind and text.endswith(suffix):
            return float(text.removesuffix(suffix)) / per
    return float(text)


def _expected(name: str) -> str:
    """The clause that refuses what is no standard deviation of a family."""
    family = NAMES[name]
    count = "one number" if len(family.most) == 1 else f"{len(family.most)} numbers"
    return f"{name} must be {count} ({family.unit}), as {family.example}"


def _checked(name: str, value: Any) -> tuple[float, ...]:
    """The numbers of a standard deviation.

    Raises:
        InputError: they are too few, too many, no numbers, not positive or too large.
    """
    family = NAMES[name]
    values = value if isinstance(value, Sequence) and not isinstance(value, str) else [value]
    if len(values) != len(family.most) or not all(isinstance(v, Real) and not isinstance(v, bool) for v in values):
        raise InputError(f"{_expected(name)}; got {value!r}.")
    for number, most, unit in zip(map(float, values), family.most, family.units, strict=True):
        if not (math.isfinite(number) and number > 0):
            raise InputError(f"{name} is a standard deviation ({unit}) and must be positive; got {number:g}.")
        if number > most:
            raise InputError(f"{name} ({unit}) must be at most {most:g}; got {number:g}.{_meant(number, most, unit)}")
    return tuple(float(number) for number in values)


def _meant(number: float, most: float, unit: str) -> str:
    """A sentence with what a number that is too large is in another unit; empty for a length."""
    if unit == "rad":
        meant, sentence = math.radians(number), f" {number:g}° is {math.radians(number):.3g} rad"
    elif unit in _SHARES:
        meant, sentence = number / 100, f" {number:g} % is {number / 100:.3g}"
    else:
        return ""
    return sentence + (", which is too much as well." if meant > most else ".")
