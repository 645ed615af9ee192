"""Standard uncertainties of what a calibration states: lights, photometry, pose, shape, sharpness."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

from matest.errors import InputError, nearest

# The word that names every family.
ALL = "all"
# Largest angles, rad: more is no tangential angle of a direction, and degrees taken for radians lie above it.
_ANGLE = 0.5
# Largest uncertainties of a black level, fraction of full scale, and of a gamma: more leaves nothing to be stated.
_SHARE = 0.5
# Largest relative uncertainties: percentages taken for shares lie above it.
_RELATIVE = 1.0
# Largest lengths in the image, pixels: more than images are wide is a typing error.
_LENGTH = 1e4


class Family(NamedTuple):
    """Errors of one kind that a calibration can have.

    Attributes:
        unit: of one standard deviation; of a pair both, separated by a comma.
        doc: what the standard deviation is of.
        most: the largest that makes sense, one for each number.
    """

    unit: str
    doc: str
    most: tuple[float, ...]


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
    "pose": Family(
        "pixels,rad", "the object's shift along x and y of the image, its rotation about three axes", (_LENGTH, _ANGLE)
    ),
    "radius": Family("pixels", "the radius of the silhouette; of a mesh, its size", (_LENGTH,)),
    "normals": Family("rad", "each tangential angle of the normals, smooth over the object", (_ANGLE,)),
    "normal_noise": Family("rad", "each tangential angle of the normals, of each pixel by itself", (_ANGLE,)),
    "blur": Family("pixels", "the width of a Gaussian that the images are convolved with", (_LENGTH,)),
    "albedo": Family("relative", "the albedo, smooth over the object", (_RELATIVE,)),
    "albedo_noise": Family("relative", "the albedo of each pixel by itself", (_RELATIVE,)),
}


@dataclass(frozen=True, kw_only=True)
class Uncertainty:
    """One standard deviation of what a calibration states, by family; None: not stated.

    Attributes:
        direction, rotation, intensity, exposure, scale, ambient, black, vignetting, transfer, radius, normals,
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
        """Standard deviations by the name of their family.

        Raises:
            InputError: an unknown name, or a value that is refused.
        """
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


def families(names: Iterable[str]) -> tuple[str, ...]:
    """Names of families, each once; "all" stands for every one.

    Raises:
        InputError: an unknown name.
    """
    names = tuple(dict.fromkeys(names))
    if ALL in names:
        return tuple(NAMES)
    refuse_unknown(names)
    return names


def refuse_unknown(names: Iterable[str]) -> None:
    """Refuse a name that is no family's.

    Raises:
        InputError: with the nearest name.
    """
    for name in names:
        if name not in NAMES:
            raise InputError(f"unknown uncertainty '{name}'; {nearest(name, NAMES)}")


def _checked(name: str, value: Any) -> tuple[float, ...]:
    """The numbers of a standard deviation.

    Raises:
        InputError: they are too few, too many, no numbers, not positive or too large.
    """
    family = NAMES[name]
    values = value if isinstance(value, Sequence) and not isinstance(value, str) else [value]
    expected = "one number" if len(family.most) == 1 else f"{len(family.most)} numbers"
    if len(values) != len(family.most) or any(isinstance(v, bool) or not isinstance(v, int | float) for v in values):
        raise InputError(f"{name} must be {expected} ({family.unit}); got {value!r}.")
    for number, most, unit in zip(values, family.most, family.unit.split(","), strict=True):
        if not (math.isfinite(number) and number > 0):
            raise InputError(f"{name} is a standard deviation ({unit}) and must be positive; got {number:g}.")
        if number > most:
            raise InputError(f"{name} ({unit}) must be at most {most:g}; got {number:g}.{_meant(number, most, unit)}")
    return tuple(float(number) for number in values)


def _meant(number: float, most: float, unit: str) -> str:
    """A sentence with what a number that is too large stands for in another unit; empty where it would be too large."""
    if unit == "rad" and math.radians(number) <= most:
        return f" {number:g}° is {math.radians(number):.3g} rad."
    if unit in ("relative", "fraction of full scale") and number / 100 <= most:
        return f" {number:g} % is {number / 100:.3g}."
    return ""
