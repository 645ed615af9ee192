"""Conventions that files of one layout differ in: the photographs decide between them."""

from __future__ import annotations

from dataclasses import replace

import msgspec

from matest.capture.description import Description
from matest.capture.schema import CaptureFile, LightTable, Vector
from matest.photographs.alternatives import alternatives
from matest.photographs.photographs import Photographs
from matest.photographs.readings import better_readings

# Axis of the lights that a mistake turns round, by its name in `photographs.alternatives`.
_TURNED = {"lights x left": 0, "lights y down": 1}
# The mistake that looks the same where the surface is a normal map, by that axis.
_NORMALS = ("normals x left", "normals y down")


def settled(photographs: Photographs, description: Description) -> tuple[Photographs, Description]:
    """Photographs and description with the axes of the lights that explain the photographs.

    Only what the layout leaves open is changed, and only where that explains the photographs far better; a note then
    says so.

    Args:
        photographs: as the description reads them.
        description: of a layout, or of a capture.toml, which leaves nothing open.
    """
    content = description.content
    if content is None or not content.open_causes:
        return photographs, description
    better = {alternative.cause for alternative in better_readings(photographs)}
    for cause in content.open_causes:
        if cause not in better:
            continue
        alternative = next(one for one in alternatives(photographs) if one.cause == cause)
        axis = _TURNED[cause]
        alike = f" A normal map with {'xy'[axis]} turned round would look the same." if _NORMALS[axis] in better else ""
        note = f"The photographs show that {alternative.finding}: read {alternative.instead}.{alike}"
        tables = _turned(description.tables, axis)
        axes = f"{content.axes}; in the file {'xy'[axis]} of the lights has the other sign, by the photographs"
        content = replace(content, tables=tables, axes=axes)
        photographs = replace(alternative.photographs, notes=(*photographs.notes, note))
        description = replace(description, tables=tables, content=content)
    return photographs, description


def _turned(tables: CaptureFile, axis: int) -> CaptureFile:
    """Tables with the sign of one axis of every light changed."""

    def turned(vector: Vector | None) -> Vector | None:
        if vector is None:
            return None
        x, y, z = (-value if index == axis else value for index, value in enumerate(vector))
        return x, y, z

    def of_light(light: LightTable) -> LightTable:
        return msgspec.structs.replace(light, direction=turned(light.direction), position=turned(light.position))

    images = [msgspec.structs.replace(image, lights=[*map(of_light, image.lights)]) for image in tables.image]
    return msgspec.structs.replace(tables, image=images)
