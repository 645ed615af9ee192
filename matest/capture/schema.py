"""The formats of capture and scene files as types, and their reader."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any, Literal, TypeVar

import msgspec

from matest.errors import InputError, nearest

Vector = tuple[float, float, float]


class _Table(msgspec.Struct, forbid_unknown_fields=True):
    pass


class GeometryTable(_Table):
    mesh: str | None = None
    normals: str | None = None
    positions: str | None = None
    width: float | None = None  # with normals alone: world units across the image of a surface in the plane z = 0
    shape: Literal["sphere"] | None = None
    centre: tuple[float, float] | None = None
    radius: float | None = None


class CameraTable(_Table):
    kind: Literal["orthographic", "perspective"] = "orthographic"
    position: Vector = (0.0, 0.0, 5.0)
    target: Vector = (0.0, 0.0, 0.0)
    up: Vector = (0.0, 1.0, 0.0)
    height: float | None = None
    fov_y: float | None = None
    matrix: tuple[Vector, Vector, Vector] | None = None
    distortion: list[float] = []
    file: str | None = None  # of another program, instead of all above
    frame: str | None = None  # the photograph in that file whose camera it is
    wavelength: list[float] | None = None
    resolution: tuple[int, int] | None = None  # scenes: width, height
    supersampling: int = 1  # scenes: rays per pixel and axis


class EncodingTable(_Table):
    transfer: Literal["linear", "srgb"] | float | None = None
    scale: float | None = None
    black: float | str = 0.0
    flat: str | None = None
    saturation: float | list[float] | None = None
    radiometry: Literal["absolute", "relative"] = "absolute"


class NoiseTable(_Table):
    read: float = 0.0
    gain: float = 0.0
    bits: Literal[8, 16] | None = None  # scenes: integer images; absent: float
    seed: int = 0  # scenes


class LightTable(_Table):
    direction: Vector | None = None
    position: Vector | None = None
    irradiance: float | list[float] | None = None
    intensity: float | list[float] | None = None
    radiance: float | list[float] | None = None
    solid_angle: float | None = None
    axis: Vector | None = None
    anisotropy: float | None = None
    size: float | tuple[float, float] | None = None  # diameter of a disc, or width and height of a rectangle
    up: Vector | None = None  # along the height of a rectangle

    @property
    def power_stated(self) -> bool:
        """Whether a key gives the strength of the light."""
        return any(value is not None for value in (self.irradiance, self.intensity, self.radiance))


class ImageTable(_Table):
    file: str | None = None
    exposure: float | None = None  # 1 where neither this nor the images of the capture say it
    lights: list[LightTable] = []
    ambient: float | list[float] = 0.0


class CaptureFile(_Table, kw_only=True):
    """`capture.toml`."""

    geometry: GeometryTable
    image: list[ImageTable]
    mask: str | None = None
    camera: CameraTable | None = None
    encoding: EncodingTable = msgspec.field(default_factory=EncodingTable)
    noise: NoiseTable | None = None
    uncertainty: dict[str, Any] = {}  # by the names of `samples.uncertainty`, which checks it


class SceneFile(CaptureFile, kw_only=True):
    """A capture file with a `[material]` table: what `matest render` turns into a capture."""

    material: dict[str, Any]


File = TypeVar("File", bound=CaptureFile)


def read(path: Path, kind: type[File]) -> File:
    """Parse and validate a TOML file.

    Raises:
        InputError: missing, not TOML, an unknown key (with the nearest known one), a value of the wrong type.
    """
    try:
        table = tomllib.loads(path.read_text("utf-8"))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; a capture is a folder with a capture.toml.") from None
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"{path}: expected a TOML file; {error}.") from None
    except RecursionError:
        raise InputError(f"{path}: expected a TOML file of a capture; its values are nested too deeply.") from None
    if "material" in table and kind is CaptureFile:
        raise InputError(f"{path}: this is a scene, not a capture; make photographs of it with 'matest render'.")
    try:
        return msgspec.convert(table, kind)
    except msgspec.ValidationError as error:
        raise InputError(f"{path}: {_explain(str(error), kind)}") from None


def _explain(message: str, kind: type) -> str:
    """msgspec's message as a sentence in the file's own words."""
    text, _, where = message.partition(" - at `$")
    where = where.rstrip("`").lstrip(".")
    unknown = re.search(r"unknown field `(.+)`", text)
    if unknown:
        key = unknown.group(1)
        inside = f"[{where}]" if where else "the file"
        return f"unknown key '{key}' in {inside}; {nearest(key, _fields(kind, where))}"
    missing = re.search(r"missing required field `(.+)`", text)
    if missing:
        inside = f"in [{where}]" if where else ""
        return f"the key '{missing.group(1)}' is missing {inside}".rstrip() + "; add it."
    choice = re.search(r"Invalid enum value '?(.+?)'?$", text)
    if choice:
        choices = _choices(kind, where)
        words = [str(value) for value in choices if isinstance(value, str) or type(value) is int]
        words += ["a number"] if {int, float} & {*choices} else []
        return f"{where}: unknown value '{choice.group(1)}'; expected {' or '.join(words)}."
    if re.match(r"Expected `object.*`, got `array`", text) and "[" not in where:
        return f"{where}: expected one table; write [{where}] with single brackets, once."
    expected = text.replace("Expected", "expected").replace("`", "")
    expected = expected.replace("array", "a list").replace("object", "a table")
    return f"{where or 'the file'}: {expected}; correct the value."


def _fields(kind: type, where: str) -> list[str]:
    """Keys of the table at the path `where`, such as `image[...].lights[...]`."""
    return [field.name for field in msgspec.structs.fields(_table(_choices(kind, where)))]


def _choices(kind: type, where: str) -> list[Any]:
    """The types, or the literal values, that the path `where` admits."""
    choices: list[Any] = [kind]
    for name in filter(None, re.sub(r"\[[^\]]*\]", "", where).split(".")):
        choices = _flatten(next(f.type for f in msgspec.structs.fields(_table(choices)) if f.name == name))
    return choices


def _table(choices: list[Any]) -> type[msgspec.Struct]:
    return next(kind for kind in choices if isinstance(kind, type) and issubclass(kind, msgspec.Struct))


def _flatten(annotation: Any) -> list[Any]:
    """The types and literal values that an annotation names at any depth."""
    arguments = getattr(annotation, "__args__", ())
    return [annotation] if not arguments else [t for a in arguments for t in _flatten(a)]
