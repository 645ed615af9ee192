"""The formats of capture and scene files as types, and their reader."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import msgspec

from matest.capture import ranges
from matest.capture.ranges import range_faults
from matest.errors import Fault, InputError, nearest, refuse

Vector = tuple[float, float, float]
_Row = tuple[float, float, float, float]
Transform = tuple[_Row, _Row, _Row, _Row]
_Power = Annotated[float | list[float], ranges.POWER]


class _Table(msgspec.Struct, forbid_unknown_fields=True):
    pass


class GeometryTable(_Table):
    mesh: str | None = None
    normals: str | None = None
    positions: str | None = None
    width: Annotated[float, ranges.WORLD_UNITS] | None = (
        None  # with normals alone: world units across the image of a surface in the plane z = 0
    )
    shape: Literal["sphere"] | None = None
    centre: tuple[float, float] | None = None
    radius: Annotated[float, ranges.PIXELS] | None = None


class ObjectTable(_Table):
    """One of several objects before the camera."""

    name: str
    mesh: str | None = None
    transform: Transform | None = None  # of a mesh, from its own coordinates to the world's
    shape: Literal["sphere"] | None = None
    position: Vector | None = None  # of the centre of a sphere, or of the origin of a mesh
    radius: Annotated[float, ranges.WORLD_UNITS] | None = None
    material: dict[str, Any] | None = None  # scenes


class CameraTable(_Table):
    kind: Literal["orthographic", "perspective"] = "orthographic"
    position: Vector = (0.0, 0.0, 5.0)
    target: Vector = (0.0, 0.0, 0.0)
    up: Vector = (0.0, 1.0, 0.0)
    height: Annotated[float, ranges.WORLD_UNITS] | None = None
    fov_y: Annotated[float, ranges.ANGLE_OF_VIEW] | None = None
    matrix: tuple[Vector, Vector, Vector] | None = None
    distortion: list[float] = []
    file: str | None = None  # of another program, instead of all above
    frame: str | None = None  # the photograph in that file whose camera it is
    wavelength: Annotated[list[float], ranges.WAVELENGTH] | None = None
    resolution: Annotated[tuple[int, int], ranges.SIDE] | None = None  # scenes: width, height
    supersampling: Annotated[int, ranges.RAYS] = 1  # scenes: rays per pixel and axis


class EncodingTable(_Table):
    transfer: Literal["linear", "srgb"] | Annotated[float, ranges.GAMMA] | None = None
    scale: Annotated[float, ranges.SCALE] | None = None
    black: Annotated[float, ranges.PEDESTAL] | str = 0.0
    flat: str | None = None
    saturation: Annotated[float | list[float], ranges.SATURATION] | None = None
    radiometry: Literal["absolute", "relative"] = "absolute"


class NoiseTable(_Table):
    read: Annotated[float, ranges.NOT_NEGATIVE] = 0.0
    gain: Annotated[float, ranges.NOT_NEGATIVE] = 0.0
    bits: Literal[8, 16] | None = None  # scenes: integer images; absent: float
    seed: Annotated[int, ranges.SEED] = 0  # scenes


class LightTable(_Table):
    direction: Vector | None = None
    position: Vector | None = None
    irradiance: _Power | None = None
    intensity: _Power | None = None
    radiance: _Power | None = None
    solid_angle: Annotated[float, ranges.SOLID_ANGLE] | None = None
    axis: Vector | None = None
    anisotropy: Annotated[float, ranges.ANISOTROPY] | None = None
    size: float | tuple[float, float] | None = None  # diameter of a disc, or width and height of a rectangle
    up: Vector | None = None  # along the height of a rectangle
    environment: str | None = None  # a map of radiance in latitude and longitude, instead of all above
    scale: Annotated[float, ranges.FACTOR] | None = None  # of that radiance
    turn: float | None = None  # of that map about y, rad
    directions: Annotated[int, ranges.DIRECTIONS] | None = None  # that stand for it

    @property
    def power_stated(self) -> bool:
        """Whether a key gives the strength of the light."""
        return any(value is not None for value in (self.irradiance, self.intensity, self.radiance, self.environment))


class ImageTable(_Table):
    file: str | None = None
    exposure: Annotated[float, ranges.POSITIVE] | None = (
        None  # 1 where neither this nor the images of the capture say it
    )
    lights: list[LightTable] = []
    ambient: _Power = 0.0


class CaptureFile(_Table, kw_only=True):
    """`capture.toml`."""

    image: list[ImageTable]
    geometry: GeometryTable = msgspec.field(default_factory=GeometryTable)
    object: list[ObjectTable] = []  # several objects, instead of one in [geometry]
    mask: str | None = None
    light_axes: Literal["world", "camera"] = "world"  # of the directions of lights
    camera: CameraTable | None = None
    encoding: EncodingTable = msgspec.field(default_factory=EncodingTable)
    noise: NoiseTable | None = None
    uncertainty: dict[str, Any] = {}  # by the names of `samples.uncertainty`, which checks it


class SceneFile(CaptureFile, kw_only=True):
    """A capture file with a `[material]`, or one for each object: what `matest render` turns into a capture."""

    material: dict[str, Any] | None = None


File = TypeVar("File", bound=CaptureFile)
# A key of more tables than any file has: Python needs time and memory as the square of their number.
_DEEP_KEY = re.compile(r"""(?m)(?:^|[\[{,])[ \t]*(?:["']?[\w-]+["']?[ \t]*\.[ \t]*){9}""")
# The key of a number that is too long for Python, which may stand in a list.
_LONG_NUMBER = re.compile(r"([\w.\"-]+)\s*=\s*[^=]*?\d{4301}")


def read(path: Path, kind: type[File]) -> File:
    """Parse and validate a TOML file.

    Raises:
        InputError: missing, not TOML, an unknown key (with the nearest known one), a value of the wrong type.
    """
    try:
        # Editors of Windows begin files with a mark of their encoding.
        text = path.read_text("utf-8-sig")
        if _DEEP_KEY.search(text):
            raise RecursionError
        table = tomllib.loads(text)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; a capture is a folder with a capture.toml.") from None
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"{path}: expected a TOML file; {error}.") from None
    except ValueError:
        # Python reads no whole numbers of thousands of digits.
        key = _LONG_NUMBER.search(text)
        where = f"{key[1]} is" if key else "it has"
        raise InputError(f"{path}: {where} a whole number of thousands of digits; correct it.") from None
    except RecursionError:
        raise InputError(f"{path}: expected a TOML file of a capture; its values are nested too deeply.") from None
    if kind is CaptureFile and has_material(table):
        raise InputError(f"{path}: this is a scene, not a capture; make photographs of it with 'matest render'.")
    try:
        tables = msgspec.convert(table, kind)
    except msgspec.ValidationError as error:
        raise InputError(f"{path}: {_explain(str(error), kind)}") from None
    refuse(path, _absent(table, kind))
    check_ranges(tables, path)
    return tables


def _absent(table: dict[str, Any], kind: type) -> Iterator[Fault]:
    """Tables that a file of one object needs."""
    alone = not table.get("object")
    for key in ("geometry", *(["material"] if issubclass(kind, SceneFile) else [])):
        yield alone and key not in table, f"the key '{key}' is missing; add it."


def has_material(table: dict[str, Any]) -> bool:
    """Whether the content of a file is that of a scene: it or one of its objects has a material."""
    objects = table.get("object")
    parts = [table, *(part for part in (objects if isinstance(objects, list) else []) if isinstance(part, dict))]
    return any("material" in part for part in parts)


def check_ranges(tables: CaptureFile, label: object) -> None:
    """Refuse tables with a number outside the range of its key.

    Raises:
        InputError: it names the key.
    """
    refuse(label, range_faults(tables))


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
