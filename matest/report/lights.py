"""The lights that mirror spheres show, as a terminal prints them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.console import Group
from rich.table import Column
from rich.text import Text

from matest.lights.lights import Light, Lights
from matest.lights.mirror import Mirror
from matest.report.format import measured
from matest.report.tables import plain_table


def lights_report(lights: Lights, mirrors: Sequence[Mirror]) -> Group:
    """The spheres, the light of every photograph, and what to know of them."""
    several = any(light.apart is not None for light in lights.lights)
    near = any(light.position is not None for light in lights.lights)
    place = "apart" if several else "highlight"
    heads = ("error", place)
    table = plain_table(Column("image"), "direction", *(Column(head, justify="right", no_wrap=True) for head in heads))
    if near:
        table.add_column("position")
    for light in lights.lights:
        where = _degrees(light.apart) if light.apart is not None else "{:.1f}, {:.1f}".format(*light.sightings[0].place)
        row = [light.name, "  ".join(f"{number:7.4f}" for number in light.direction), f"± {_degrees(light.std)}", where]
        table.add_row(*row, *([_position(light)] if near else []))
    stated = ", ".join(f"{name} = {std:.2g} rad ({_degrees(std)})" for name, std in lights.uncertainty.items())
    return Group(
        *(Text(line) for line in _spheres(mirrors)),
        table,
        Text(f"Uncertainty: {stated}."),
        *(Text(f"Note: {note}", style="yellow") for note in lights.notes),
    )


def lights_record(lights: Lights, mirrors: Sequence[Mirror]) -> dict[str, Any]:
    """The same as plain values for JSON; angles in rad."""
    return {
        "schema": "matest.lights/1",
        "spheres": [
            {
                "capture": str(mirror.folder),
                "circle": list(sphere.circle),
                "distance": sphere.distance,
            }
            for mirror in mirrors
            for sphere in mirror.spheres
        ],
        "lights": [_record(light) for light in lights.lights],
        "uncertainty": lights.uncertainty,
        "notes": list(lights.notes),
    }


def _record(light: Light) -> dict[str, Any]:
    position = light.position
    return {
        "file": light.name,
        "direction": light.direction.tolist(),
        "std": light.std,
        "apart": light.apart,
        "position": None if position is None else position.point.tolist(),
        "position_std": None if position is None else position.std.tolist(),
        "highlights": [
            {
                "place": list(one.place),
                "saturated": one.saturated,
                "direction": one.ray.direction.tolist(),
                "std": math.sqrt(one.variance),
            }
            for one in light.sightings
        ],
    }


def _spheres(mirrors: Sequence[Mirror]) -> list[str]:
    """A sentence for each sphere."""
    lines = []
    for mirror in mirrors:
        for sphere in mirror.spheres:
            x, y, radius = sphere.circle
            sentence = f"{mirror.folder}: sphere at ({x:.2f}, {y:.2f}), radius {radius:.2f} px"
            if sphere.distance is not None:
                sentence += f", {sphere.distance:.3g} radii from the camera"
            lines.append(sentence + ".")
    return lines


def _position(light: Light) -> str:
    if light.position is None:
        return "-"
    pairs = zip(light.position.point.tolist(), np.asarray(light.position.std).tolist(), strict=True)
    return "\n".join(measured(value, std) for value, std in pairs)


def _degrees(angle: float) -> str:
    """Degrees with two digits after the point, or as many as show something."""
    degrees = math.degrees(angle)
    return f"{degrees:.2f}°" if degrees >= 0.01 else f"{degrees:.1g}°"
