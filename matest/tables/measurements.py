"""CSV tables of single measurements, as domes of lights give them: one row a code of one pixel under one light.

Columns, in any order, places in one unit of length:

pixel, channel                      which; any text. Without `channel` there is one.
code                                of the camera, proportional to light beyond `black`
exposure                            in any unit; without it all are alike
light_x, light_y, light_z           where the light is
light_normal_x, _y, _z              along which it radiates most; without it the light radiates evenly
intensity                           of the light along that; without it all are alike
point_x, point_y, point_z           where the surface is
normal_x, normal_y, normal_z        its normal
viewer_x, viewer_y, viewer_z        where the camera is

A line `# code: DN` says that the heading of a column is another one. `# transfer: linear` must be declared; what may be
is `# black: 64` and `# saturation: 4000` (both codes), `# anisotropy: 2` (the exponent of the cosine to the light's
normal, 1 without it), and `# radiometry: absolute` where (code − black)/exposure is a radiance by that intensity.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from matest.directions import to_local
from matest.errors import Fault, InputError, nearest, refuse
from matest.tables.columns import SLIP, Text, in_channels
from matest.tables.declaration import Declaration
from matest.tables.table import LARGEST, Table

CODE = "code"
_PIXEL, _CHANNEL, _EXPOSURE, _INTENSITY = "pixel", "channel", "exposure", "intensity"
_LIGHT, _LIGHT_NORMAL, _POINT, _NORMAL, _VIEWER = (
    tuple(f"{what}_{axis}" for axis in "xyz") for what in ("light", "light_normal", "point", "normal", "viewer")
)
_NEEDED = (_PIXEL, CODE, *_LIGHT, *_POINT, *_NORMAL, *_VIEWER)
_COLUMNS = (*_NEEDED, _CHANNEL, _EXPOSURE, _INTENSITY, *_LIGHT_NORMAL)
# What comments declare beside headings: words, and numbers with what they are where nothing is said.
_WORDS = {"transfer": ("linear",), "radiometry": ("relative", "absolute")}
_NUMBERS = {"black": 0.0, "saturation": math.inf, "anisotropy": 1.0}
# Share of the codes' range below the highest one that is just below it.
_JUST_BELOW = 0.02
# Rows with the highest code from which on they may be a plateau, and how many times those just below they then are.
_PLATEAU = 5
_PILED = 2
# Channel of a table that names none.
_ONLY = "value"
# Albedo that a matte surface is given where no strength of the light is known.
_ALBEDO = 0.5

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Measurements:
    """n rows of a table, as numbers.

    Attributes:
        lines: of the file [n].
        pixel, channel: numbers of them [n].
        channels: names of the channels, in the order of the file.
        code, exposure: [n].
        light, point, normal, viewer: [n, 3].
        light_normal: [n, 3]; None: lights radiate evenly.
        intensity: [n]; None: all are alike.
    """

    lines: NDArray[np.int64]
    pixel: NDArray[np.int64]
    channel: NDArray[np.int64]
    channels: list[str]
    code: Array
    exposure: Array
    light: Array
    point: Array
    normal: Array
    viewer: Array
    light_normal: Array | None
    intensity: Array | None

    @property
    def geometry(self) -> Array:
        """What rows of one measurement share beside the pixel [n, k]."""
        parts = [self.light, self.point, self.normal, self.viewer, self.light_normal]
        if self.intensity is not None:
            parts.append(self.intensity[:, None])
        return np.concatenate([part for part in parts if part is not None], axis=1)

    @property
    def finite(self) -> NDArray[np.bool_]:
        """Whether all numbers of a row are, and none is too large for one [n]."""
        numbers = np.column_stack([self.code, self.exposure, self.geometry])
        return np.asarray((np.abs(numbers) < LARGEST).all(axis=1))  # False for NaN


def headings(text: Text) -> dict[str, str]:
    """The heading of every column of a measurement that a file has, by the name of the column."""
    named = {key.lower(): value for _, key, value in text.comments if key.lower() in _COLUMNS}
    stated = {name: named.get(name, name) for name in _COLUMNS}
    return {name: heading for name, heading in stated.items() if heading in text.names}


def read(text: Text, declaration: Declaration) -> Table:
    """The reflectances f = L/(E cos θi) of the measurements in a CSV file, by the light E of each.

    Measurements of one pixel and channel under one light with several exposures become one: the sum of their codes over
    the sum of their exposures, without saturated ones. What lacks a channel is left out.

    Raises:
        InputError: a column or a declaration that is missing or makes no sense, numbers that no measurement has.
    """
    declaration.refuse_reading()
    words, numbers = _declared(text)
    rows = _measurements(text)
    finite = rows.finite
    highest = _plateau(rows.code[finite], numbers) if math.isinf(numbers["saturation"]) else None
    unsaturated = ~(rows.code >= (numbers["saturation"] if highest is None else highest))
    refuse(text.path, _faults(rows, finite, unsaturated))
    chosen, radiance = _merged(rows, np.flatnonzero(finite & unsaturated), numbers["black"])
    whole = np.isfinite(radiance).all(axis=1)
    wi, wo, irradiance = _lit(rows, chosen, numbers["anisotropy"])
    above = (wi[:, 2] > 0) & (wo[:, 2] > 0) & (irradiance > 0)
    kept = whole & above
    if not kept.any():
        raise InputError(
            f"{text.path}: expected lit points that the camera sees, with all channels ({', '.join(rows.channels)}), "
            "and there are none; check the normals and the saturation."
        )
    y = radiance[kept] / irradiance[kept, None]
    absolute = words.get("radiometry") == "absolute"
    if not absolute:
        y *= _ALBEDO * wi[kept, 2].mean() / max(math.pi * y.mean(), 1e-300)
    f = torch.from_numpy(y / wi[kept, 2:])
    values, channels, wavelengths, of_channels = in_channels(f, rows.channels, declaration)
    return Table(
        text.path, torch.from_numpy(wi[kept]), torch.from_numpy(wo[kept]), values, channels, wavelengths,
        relative=not absolute, notes=[_note(text, rows, numbers, highest), *of_channels],
        skipped={
            "not a number": int((~finite).sum()), "saturated": int((finite & ~unsaturated).sum()),
            "without all channels": int((~whole).sum()), "below the horizon": int((whole & ~above).sum()),
        },
    )  # fmt: skip


def _declared(text: Text) -> tuple[dict[str, str], dict[str, float]]:
    """What comments declare: words, and numbers.

    Raises:
        InputError: a word or number that makes no sense, a slip in a key, or codes that nobody calls linear.
    """
    words, numbers = {}, dict(_NUMBERS)
    known = (*_WORDS, *_NUMBERS, *_COLUMNS)
    for line, name, value in text.comments:
        key, label = name.lower(), f"{text.path}: line {line}"
        if key in _WORDS:
            if value.lower() not in _WORDS[key]:
                raise InputError(f"{label}: {key} must be {' or '.join(_WORDS[key])}; got '{value}'.")
            words[key] = value.lower()
        elif key in _NUMBERS:
            numbers[key] = _number(value, f"{label}: {key}")
        elif key in _COLUMNS and value not in text.names:
            raise InputError(f"{label}: {key} is the column '{value}', and there is none; {nearest(value, text.names)}")
        elif key not in known and difflib.get_close_matches(key, known, n=1, cutoff=SLIP):
            raise InputError(f"{label}: '{name}' declares nothing; {nearest(key, known)} Correct it.")
    if "transfer" not in words:
        raise InputError(
            f"{text.path}: nothing says that codes are proportional to light; if they are, add the line "
            "'# transfer: linear', and convert them if not."
        )
    return words, numbers


def _number(value: str, label: str) -> float:
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if not 0 <= number < math.inf:
        raise InputError(f"{label} must be a number from 0 on; got '{value}'.")
    return number


def _measurements(text: Text) -> _Measurements:
    """The rows of a table.

    Raises:
        InputError: a column that is missing, or text where a number should be.
    """
    there = headings(text)
    missing = [name for name in _NEEDED if name not in there]
    # A direction has three coordinates, or none.
    if any(name in there for name in _LIGHT_NORMAL):
        missing += [name for name in _LIGHT_NORMAL if name not in there]
    if missing:
        raise InputError(
            f"{text.path}: expected the column {missing[0]} of a table of measurements, and its columns are "
            f"{', '.join(text.names)[:200]}; name it so, or add a line '# {missing[0]}: HEADING'."
        )
    cells = text.cells()

    def of(*names: str) -> np.ndarray:
        return cells[:, [text.names.index(there[name]) for name in names]]

    numbers = {
        name: text.numbers(of(name))[:, 0]
        for name in (CODE, _EXPOSURE, _INTENSITY) if name in there
    }  # fmt: skip
    light, point, normal, viewer = (text.numbers(of(*names)) for names in (_LIGHT, _POINT, _NORMAL, _VIEWER))
    channels, channel = _numbered(of(_CHANNEL)[:, 0] if _CHANNEL in there else [_ONLY] * len(cells))
    return _Measurements(
        lines=np.array([line for line, _ in text.rows], dtype=np.int64),
        pixel=_numbered(of(_PIXEL)[:, 0])[1],
        channel=channel,
        channels=channels,
        code=numbers[CODE],
        exposure=numbers.get(_EXPOSURE, np.ones(len(cells))),
        light=light,
        point=point,
        normal=normal,
        viewer=viewer,
        light_normal=text.numbers(of(*_LIGHT_NORMAL)) if _LIGHT_NORMAL[0] in there else None,
        intensity=numbers.get(_INTENSITY),
    )


def _numbered(words: np.ndarray | list[str]) -> tuple[list[str], NDArray[np.int64]]:
    """Different words in their order, and the number of each [n]."""
    places = {word: place for place, word in enumerate(dict.fromkeys(words))}
    return list(places), np.array([places[word] for word in words], dtype=np.int64)


def _faults(rows: _Measurements, finite: NDArray[np.bool_], unsaturated: NDArray[np.bool_]) -> Iterator[Fault]:
    """What no measurement has, in the first line that has it."""
    yield (
        not (finite & unsaturated).any(),
        "expected rows with numbers and without saturation below the names of the columns, and there are none.",
    )

    def first(wrong: NDArray[np.bool_]) -> str:
        return f"line {rows.lines[np.argmax(wrong)]}" if wrong.any() else ""

    wrong = finite & ~(rows.exposure > 0)
    yield bool(wrong.any()), f"{first(wrong)}: exposure must be positive; correct it."
    if rows.intensity is not None:
        wrong = finite & ~(rows.intensity > 0)
        yield bool(wrong.any()), f"{first(wrong)}: intensity must be positive; correct it."
    vectors = {"normal": rows.normal, "light_normal": rows.light_normal}
    for name, vector in vectors.items():
        if vector is not None:
            wrong = finite & ~vector.any(axis=1)
            yield bool(wrong.any()), f"{first(wrong)}: {name} is 0 0 0, which is no direction; correct it."
    for name, place in (("light", rows.light), ("viewer", rows.viewer)):
        wrong = finite & (place == rows.point).all(axis=1)
        yield bool(wrong.any()), f"{first(wrong)}: the {name} is at the point of the surface; correct one of them."


def _merged(rows: _Measurements, used: NDArray[np.int64], black: float) -> tuple[NDArray[np.int64], Array]:
    """A row of every pixel and geometry among those used [m], and its radiance, NaN where a channel lacks [m, C]."""
    keys = np.column_stack([rows.pixel, rows.geometry])[used]
    _, first, place = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    codes, exposures = np.zeros((2, len(first), len(rows.channels)))
    for total, part in ((codes, rows.code - black), (exposures, rows.exposure)):
        np.add.at(total, (place.ravel(), rows.channel[used]), part[used])
    return used[first], np.where(exposures > 0, codes / np.where(exposures > 0, exposures, 1), np.nan)


def _lit(rows: _Measurements, index: NDArray[np.int64], anisotropy: float) -> tuple[Array, Array, Array]:
    """Local directions to light and viewer [m, 3], and the irradiance of a surface that faces the light [m]."""
    point, offset = rows.point[index], rows.light[index] - rows.point[index]
    distance = np.linalg.norm(offset, axis=1)
    toward = offset / distance[:, None]
    irradiance = distance**-2 if rows.intensity is None else rows.intensity[index] / distance**2
    if rows.light_normal is not None:
        cosine = -(toward * _unit(rows.light_normal[index])).sum(axis=1)
        irradiance = irradiance * cosine.clip(min=0) ** anisotropy
    normal, view = (torch.from_numpy(_unit(vector)) for vector in (rows.normal[index], rows.viewer[index] - point))
    wi, wo = to_local(normal, torch.from_numpy(toward), view)
    return wi.numpy(), wo.numpy(), irradiance


def _unit(vectors: Array) -> Array:
    lengths: Array = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors / lengths


def _plateau(code: Array, numbers: dict[str, float]) -> float | None:
    """The highest code where so many rows have it that it is where the camera clips; None where it is not."""
    top = float(code.max(initial=-math.inf))
    below = (code < top) & (code > top - _JUST_BELOW * (top - numbers["black"]))
    count = int((code == top).sum())
    return top if count >= _PLATEAU and count > _PILED * below.sum() else None


def _note(text: Text, rows: _Measurements, numbers: dict[str, float], highest: float | None) -> str:
    """How a table was read."""
    clipped = "" if highest is None else f", and {highest:g}, where they pile up, is saturated"
    even = (
        "evenly" if rows.light_normal is None else f"by the power {numbers['anisotropy']:g} of the cosine to its normal"
    )
    strength = "are equally strong" if rows.intensity is None else "have the intensities of the file"
    lights = len(np.unique(rows.light, axis=0))
    declared = any(key.lower() == "black" for _, key, _ in text.comments)
    black = f"{numbers['black']:g}" if declared else "0, as no black level is declared"
    return (
        f"Read as {len(rows.code):,} measurements of {rows.pixel.max() + 1:,} pixels under {lights:,} lights, which "
        f"{strength} and radiate {even}; codes are proportional to light beyond {black}{clipped}."
    )
