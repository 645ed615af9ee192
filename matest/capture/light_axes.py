"""Lights that are stated in the axes of the camera, as lists of photographs of mirror balls have them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import msgspec
import numpy as np

from matest.capture.description import Description
from matest.capture.geometry import camera_of
from matest.capture.schema import File, LightTable
from matest.errors import Fault, refuse

_NOTE = (
    "The directions of the lights are stated in the axes of the camera (x right, y up, z toward the viewer) and were "
    "turned into those of the mesh."
)


def in_world(description: Description[File]) -> tuple[Description[File], tuple[str, ...]]:
    """The description with directions of lights in world axes, and a sentence where they were turned.

    Args:
        description: whose camera has a pose.

    Raises:
        InputError: a place of a light in the axes of the camera.
    """
    tables = description.tables
    if tables.light_axes == "world":
        return description, ()
    refuse(description.file, _faults(description))
    if tables.camera is None or (tables.geometry.mesh is None and not tables.object):
        # Normal maps and spheres lie in the axes of the camera.
        return description, ()
    # Rows: right, up and backward.
    axes = camera_of(tables.camera, str(description.file)).axes()

    def turned(light: LightTable) -> LightTable:
        if light.direction is None:
            return light  # a map of light, which is turned about the world's y
        x, y, z = (np.array(light.direction) @ axes).tolist()
        return msgspec.structs.replace(light, direction=(x, y, z))

    images = [msgspec.structs.replace(image, lights=[*map(turned, image.lights)]) for image in tables.image]
    return replace(description, tables=msgspec.structs.replace(tables, image=images, light_axes="world")), (_NOTE,)


def _faults(description: Description) -> Iterator[Fault]:
    for number, image in enumerate(description.tables.image):
        near = any(light.position is not None for light in image.lights)
        yield (
            near,
            f"image {number} has a light with a position, which is stated in world units and axes, and light_axes = "
            "'camera' is for directions alone; give the directions of all lights, or leave light_axes out.",
        )
