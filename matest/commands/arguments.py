"""Arguments of the commands: from text to numbers, pairs and lists."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from matest.errors import InputError, errors_of
from matest.report.picture_size import PictureSize

if TYPE_CHECKING:
    from matest.estimation.options import Options
    from matest.samples.uncertainty import Uncertainty

Choice = TypeVar("Choice", bound=Enum)
Value = TypeVar("Value")
# The comma between two assignments, as in a=1,b=2: those between numbers have no name after them.
_BETWEEN_ASSIGNMENTS = re.compile(r"\s*,\s*(?=[a-z][\w.-]*\s*=)")
# A number of bytes: kilo to tera, i for powers of 1,024.
_SIZE = re.compile(r"(\d+\.?\d*)\s*([KMGT])(i?)B?", re.IGNORECASE)
# Options that several commands take.
Json = Annotated[bool, typer.Option("--json", help="Print machine-readable JSON on standard output.")]
Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="Print errors only, and what --json asks for.")]
Transfer = Annotated[
    str | None, typer.Option(help="How pixels encode light: linear, srgb or a gamma; overrides the capture's.")
]
Model = Annotated[str, typer.Option(help="A model or sum, as 'oren-nayar+torrance-sparrow'; see 'matest models'.")]
Seed = Annotated[int, typer.Option(help="Of the subsample that the search starts from.")]
Fix = Annotated[list[str] | None, typer.Option(metavar="NAME=VALUE", help="Hold a parameter at a value.")]
Free = Annotated[list[str] | None, typer.Option(metavar="NAME", help="Estimate a parameter held by default.")]
Tie = Annotated[list[str] | None, typer.Option(metavar="NAME=OTHER", help="Give a parameter another's value.")]
UncertaintyOf = Annotated[
    list[str] | None,
    typer.Option(
        "--uncertainty",
        metavar="NAME=VALUE",
        help="One standard deviation of what the calibration states, overrides the capture's: direction, rotation, "
        "normals, normal_noise (rad); intensity, exposure, scale, ambient, vignetting, transfer, curve, albedo, "
        "albedo_noise (relative); black (of full scale); radius, blur (pixels); pose=PIXELS,RAD. 1deg and 3% are "
        "understood.",
        show_default=False,
    ),
]
Refine = Annotated[
    str | None,
    typer.Option(
        metavar="NAME,...|all|auto",
        help="Errors of the calibration to estimate with the material: names of --uncertainty, or of the result; auto: "
        "those that explain the residuals.",
        show_default=False,
    ),
]
Pictures = Annotated[
    PictureSize,
    typer.Option(help="Pictures of photographs, model and difference: small, as large as the photographs, or none."),
]
AllowOutside = Annotated[
    bool, typer.Option("--allow-outside", help="Read files outside the captures' folder that they refer to or link.")
]
Object = Annotated[
    str | None, typer.Option("--object", metavar="NAME", help="One of several objects.", show_default=False)
]
Out = Annotated[Path | None, typer.Option("-o", "--out", help="Where to write.", show_default=False)]


def options(
    model: str | None,
    fix: list[str] | None,
    free: list[str] | None,
    tie: list[str] | None,
    transfer: str | None,
    **others: Any,
) -> Options:
    """Options from their texts; `others` need no conversion."""
    from matest.estimation.options import Options

    return Options(
        model=model,
        fix=once(map(assignment, fix or []), "--fix"),
        free=tuple(free or ()),
        tie=once((pair(text, "--tie") for text in tie or []), "--tie"),
        transfer=encoding(transfer),
        **others,
    )


def assignment(text: str, option: str = "--fix") -> tuple[str, float | list[float]]:
    """Name and value of a text such as `f0=0.04` or `albedo=0.7,0.6,0.5`."""
    # Imported here: the catalogue of models needs torch, and --help must not.
    from matest.brdf.expression import number

    name, value = pair(text, option)
    numbers = [number(part, f"{option} {name}") for part in value.split(",")]
    return name, numbers[0] if len(numbers) == 1 else numbers


def pair(text: str, option: str) -> tuple[str, str]:
    """Name and value of a text `NAME=VALUE` that an option was given."""
    name, equals, value = (part.strip() for part in text.partition("="))
    if not (name and equals and value):
        raise InputError(f"{option}: '{text}' must read NAME=VALUE.")
    several = _BETWEEN_ASSIGNMENTS.split(text)
    if len(several) > 1:
        raise InputError(f"{option} takes one NAME=VALUE; repeat it: {' '.join(f'{option} {one}' for one in several)}.")
    return name, value


def once(pairs: Iterable[tuple[str, Value]], option: str) -> dict[str, Value]:
    """Values by name.

    Raises:
        InputError: a name with two values.
    """
    values: dict[str, Value] = {}
    for name, value in pairs:
        if name in values:
            raise InputError(f"{option} {name} is given twice; keep one.")
        values[name] = value
    return values


def uncertainty(texts: list[str] | None) -> Uncertainty:
    """Standard deviations of a calibration of texts such as `direction=0.01`, `direction=1deg` or `pose=0.5,0.01`."""
    from matest.samples.uncertainty import Uncertainty, read

    stated = once((pair(text, "--uncertainty") for text in texts or []), "--uncertainty")
    with errors_of("--uncertainty"):
        return Uncertainty.of({name: read(name, text) for name, text in stated.items()})


def root(capture: Path, allow_outside: bool) -> Path | None:
    """The folder that references of a capture may not leave; None: its own."""
    return Path(capture.absolute().anchor) if allow_outside else None


def size(text: str | None) -> int | None:
    """Bytes of a text such as `800MB`, `4GB` or `1.5GiB`; None of none."""
    if text is None:
        return None
    match = _SIZE.fullmatch(text.strip())
    if match is None:
        raise InputError(f"--memory takes a number with MB or GB, as 800MB or 4GB; got '{text}'.")
    number, prefix, binary = match.groups()
    return int(float(number) * (1024 if binary else 1000) ** (" KMGT".index(prefix.upper())))


def indices(text: str) -> list[int]:
    try:
        return [int(part) for part in text.split(",") if part.strip()]
    except ValueError:
        raise InputError(f"--holdout takes image numbers separated by commas, as 0,3; got '{text}'.") from None


def noise(text: str) -> tuple[float, float]:
    read, gain = _numbers(text, 2, "--noise takes READ,GAIN (fractions of full scale), as 0.002,0.0005")
    return read, gain


def table_noise(text: str) -> float | tuple[float, float]:
    """Relative noise of a table, or that and a floor."""
    expected = "--noise takes R or R,FLOOR (a share of the value, and 1/sr), as 0.01 or 0.01,0.0001"
    if "," not in text:
        return _numbers(text, 1, expected)[0]
    relative, floor = _numbers(text, 2, expected)
    return relative, floor


def choice(text: str, kind: type[Choice], option: str) -> Choice:
    """The member of an enumeration that has this value."""
    try:
        return kind(text)
    except ValueError:
        values = [str(member.value) for member in kind]
        raise InputError(f"{option} must be one of {', '.join(values)}; got '{text}'.") from None


def line(text: str) -> tuple[float, float, float, float]:
    x0, y0, x1, y1 = _numbers(text, 4, "--line takes X0,Y0,X1,Y1 in pixels")
    return x0, y0, x1, y1


def circle(text: str) -> tuple[float, float, float]:
    """Centre and radius of a circle in an image."""
    x, y, radius = _numbers(text, 3, "--circle takes X,Y,R in pixels, as 253.8,148.2,119.5")
    return x, y, radius


def centre(text: str) -> tuple[float, float, float]:
    """A place in the world."""
    x, y, z = _numbers(text, 3, "--centre takes X,Y,Z in world units, as 0,0.1,0.5")
    return x, y, z


def normal(text: str) -> tuple[float, float, float]:
    """The direction that a surface faces."""
    expected = "--white-normal takes a direction X,Y,Z, as 0,0,1"
    x, y, z = _numbers(text, 3, expected)
    if not 0 < math.hypot(x, y, z) < math.inf:
        raise InputError(f"{expected}; got '{text}'.")
    return x, y, z


def _numbers(text: str, count: int, expected: str) -> list[float]:
    """So many numbers separated by commas; `expected` begins the refusal of anything else."""
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != count:
        raise InputError(f"{expected}; got '{text}'.")
    return numbers


def encoding(text: str | None) -> str | float | None:
    if text is None or text in ("linear", "srgb"):
        return text
    try:
        return float(text)
    except ValueError:
        raise InputError(f"--transfer must be linear, srgb or a number (gamma); got '{text}'.") from None
