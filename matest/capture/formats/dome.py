"""RTI's description of a dome: `.dome`, JSON as Relight writes it, beside photographs in the order of their names.

The origin is the centre of the image; x points right, y up, z toward the camera. `lightConfiguration` says what counts:
`directional` the `directions`, `spherical` lights on a dome of `domeDiameter` whose centre lies `verticalOffset` above
the surface, `lights3d` the `positions3d`. Lengths have any one unit: only their ratio to `imageWidth` matters.
`ledAdjust` multiplies the pixels of each photograph so that all lights are equally strong.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matest.capture.formats import folder
from matest.capture.formats.layout import Content, Layout
from matest.capture.schema import CaptureFile, EncodingTable, GeometryTable, ImageTable, LightTable, Vector
from matest.errors import InputError
from matest.photographs.images import LARGEST

_DIRECTIONAL, _SPHERICAL, _LIGHTS3D = "directional", "spherical", "lights3d"
# Keys that hold the positions of the lights in each configuration that has them, the present name first.
_POSITIONS = {_SPHERICAL: ("positionsSphere",), _LIGHTS3D: ("positions3d", "positions")}
# Share of the radius by which lights may lie off the sphere that the file says they lie on.
_OFF_SPHERE = 0.1


def _find(path: Path) -> tuple[Path, ...]:
    return folder.list_of_lights(path, ".dome")


def _read(files: tuple[Path, ...]) -> Content:
    file = files[0]
    dome = _Dome(file)
    configuration = dome.configuration()
    near = configuration != _DIRECTIONAL
    vectors = dome.positions(configuration) if near else dome.vectors("directions")
    _check(file, vectors)
    photographs = folder.images_in_order(file, len(vectors))
    mask = folder.mask(file.parent)
    assumptions = ["the photographs have the lights of the file in the order of their names"]
    geometry = dome.plane(folder.normal_map(file.parent)) if near else folder.geometry(file.parent)
    if near:
        assumptions.append("the surface lies in the plane z = 0, with the origin at the centre of the image")
    elif geometry.shape is not None:
        assumptions.append("the mask is the outline of a sphere")
    adjustments = dome.adjustments(len(vectors))
    if adjustments is None:
        assumptions.append("all lights are equally strong")
    # So that they shine with about π on the middle of the surface, as lights of unknown strength do elsewhere.
    power = math.pi * (math.fsum(_squared(vector) for vector in vectors) / len(vectors) if near else 1.0)
    strengths: list[list[float] | None] = [None] * len(vectors)
    if near or adjustments is not None:
        strengths = [[power / factor for factor in factors] for factors in adjustments or [[1.0]] * len(vectors)]
    tables = CaptureFile(
        geometry=geometry,
        mask=None if mask is None else mask.name,
        encoding=EncodingTable(radiometry="relative"),
        image=[
            ImageTable(file=image.name, lights=[_light(vector, strength, near)])
            for image, vector, strength in zip(photographs, vectors, strengths, strict=True)
        ],
    )
    return Content(
        tables=folder.with_view(tables, file.parent),
        axes="x right, y up, z toward the viewer",
        assumptions=tuple(assumptions),
        open_causes=("lights y down",) if geometry.mesh is None else (),
    )


def _light(vector: Vector, strength: list[float] | None, near: bool) -> LightTable:
    if strength is None:
        return LightTable(direction=vector)
    power = strength[0] if len({*strength}) == 1 else strength
    return LightTable(position=vector, intensity=power) if near else LightTable(direction=vector, irradiance=power)


def _squared(vector: Vector) -> float:
    return math.fsum(value * value for value in vector)


def _check(file: Path, vectors: Sequence[Vector]) -> None:
    """Refuse lights that stand nowhere, and those of a program that wrote x three times."""
    for number, vector in enumerate(vectors):
        if not any(vector):
            raise InputError(f"{file}: light {number} (from 0) is 0 0 0, which is no place of a light; correct it.")
    if len(vectors) > 1 and all(x == y == z for x, y, z in vectors):
        raise InputError(
            f"{file}: every light has x = y = z, as an early Relight wrote by mistake; calibrate the dome again."
        )


class _Dome:
    """The content of a `.dome` file.

    Args:
        file: its path.

    Raises:
        InputError: no JSON object.
    """

    def __init__(self, file: Path) -> None:
        self.file = file
        try:
            self._content: dict[str, Any] = json.loads(file.read_text("utf-8-sig"))
        except (OSError, ValueError, RecursionError) as error:
            raise InputError(f"{file}: expected the JSON of a dome; {error}. Save it again.") from None
        if not isinstance(self._content, dict):
            raise InputError(f"{file}: expected the JSON object of a dome; got {type(self._content).__name__}.")

    def configuration(self) -> str:
        """What the lights are: directional, spherical or lights3d."""
        stated = self._content.get("lightConfiguration")
        if stated is None:
            keys = [key for key in ("positions", "directions") if self._content.get(key)]
            if len(keys) == 1:
                return _LIGHTS3D if keys[0] == "positions" else _DIRECTIONAL
            raise InputError(
                f"{self.file}: has {' and '.join(keys) or 'no lights'}, and nothing says which count; add "
                '"lightConfiguration": "directional" or "lights3d".'
            )
        if stated not in (_DIRECTIONAL, _SPHERICAL, _LIGHTS3D):
            raise InputError(
                f"{self.file}: lightConfiguration must be directional, spherical or lights3d; got {stated!r}."
            )
        return stated

    def vectors(self, key: str) -> list[Vector]:
        """Directions or positions: objects with x, y and z, or lists of three numbers."""
        entries = self._content.get(key)
        if not isinstance(entries, list) or not entries:
            raise InputError(
                f"{self.file}: expected the lights in '{key}'; got none. Calibrate and save the dome again."
            )
        return [self._numbers(entry, "xyz", f"{key}, light {k} (from 0)") for k, entry in enumerate(entries)]

    def positions(self, configuration: str) -> list[Vector]:
        """Where the lights stand."""
        key = next((key for key in _POSITIONS[configuration] if self._content.get(key)), None)
        if configuration == _LIGHTS3D:
            return self.vectors(key or _POSITIONS[configuration][0])
        radius, offset = self._length("domeDiameter", "diameter") / 2, self._number("verticalOffset")
        if key is None:
            directions = self.vectors("directions")
            _check(self.file, directions)
            factors = [radius / math.sqrt(_squared(vector)) for vector in directions]
            return [
                (factor * x, factor * y, factor * z + offset)
                for factor, (x, y, z) in zip(factors, directions, strict=True)
            ]
        positions = self.vectors(key)
        for number, (x, y, z) in enumerate(positions):
            distance = math.sqrt(_squared((x, y, z - offset)))
            if abs(distance - radius) > _OFF_SPHERE * radius:
                raise InputError(
                    f"{self.file}: light {number} (from 0) lies {distance:.4g} from the centre of a dome whose radius "
                    f"is {radius:.4g}; give both in one unit, or say lights3d."
                )
        return positions

    def plane(self, normals: Path | None) -> GeometryTable:
        """The normal map of a flat surface, as wide as the image."""
        if normals is None:
            raise InputError(
                f"{self.file}: positions of lights belong to a surface in the plane z = 0, which needs a normal map "
                "(normals.exr) in the folder; for another shape say directional, or write a capture.toml."
            )
        return GeometryTable(normals=normals.name, width=self._length("imageWidth"))

    def adjustments(self, count: int) -> list[list[float]] | None:
        """By what the pixels of each photograph are to be multiplied; None where nothing is said."""
        entries = self._content.get("ledAdjust")
        if not entries:
            return None
        if not isinstance(entries, list) or len(entries) != count:
            raise InputError(f"{self.file}: expected {count} entries in ledAdjust, one a light; correct or remove it.")
        factors = [[*self._numbers(entry, "rgb", f"ledAdjust {k}")] for k, entry in enumerate(entries)]
        if not min(map(min, factors)) > 0:
            raise InputError(f"{self.file}: ledAdjust must be positive; got {min(map(min, factors)):g}.")
        return factors

    def _length(self, *keys: str) -> float:
        """A positive length under one of some keys."""
        key = next((key for key in keys if key in self._content), keys[0])
        value = self._number(key)
        if not value > 0:
            raise InputError(f"{self.file}: positions of lights need {key}, in their unit; got {value:g}. Add it.")
        return value

    def _number(self, key: str) -> float:
        value = self._content.get(key, 0.0)
        if not _finite(value):
            raise InputError(f"{self.file}: {key} must be a number; got {value!r}.")
        return float(value)

    def _numbers(self, entry: Any, keys: str, label: str) -> Vector:
        values = [entry.get(key) for key in keys] if isinstance(entry, dict) else entry
        if not isinstance(values, list) or len(values) != len(keys) or not all(map(_finite, values)):
            raise InputError(f"{self.file}: {label} must have the numbers {', '.join(keys)}; got {str(entry)[:60]}.")
        first, second, third = map(float, values)
        return first, second, third


def _finite(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < LARGEST


LAYOUT = Layout("RTI dome", "a .dome file", _find, _read)
