"""The lights that mirror spheres show, as a terminal prints them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.console import Group
from rich.table import Column, Table
from rich.text import Text

from matest.lights.comparison import Comparison
from matest.lights.extent import Extent
from matest.lights.lights import Light, Lights
from matest.lights.mirror import Mirror
from matest.lights.strengths import Strengths
from matest.report.format import measured
from matest.report.tables import plain_table

# Photographs with another light of a list that a sentence names, at most.
_PAIRS = 3
# What strengths are called, by the number of channels.
_CHANNELS = {1: ("strength",), 3: ("strength: red", "green", "blue")}


def lights_report(
    lights: Lights,
    mirrors: Sequence[Mirror],
    strengths: Strengths | None = None,
    comparison: Comparison | None = None,
) -> Group:
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
    notes = [*lights.notes, *_bounds(lights)]
    if strengths is not None:
        stated += f", intensity = {strengths.uncertainty:.2g} (relative)"
        notes = [*notes, *_white(strengths), *strengths.notes]
    return Group(
        *(Text(line) for line in _spheres(mirrors)),
        table,
        _strengths(lights, strengths),
        Text(f"Uncertainty: {stated}."),
        *([] if comparison is None else _against(lights, comparison)),
        *(Text(f"Note: {note}", style="yellow") for note in notes),
    )


def lights_record(
    lights: Lights,
    mirrors: Sequence[Mirror],
    strengths: Strengths | None = None,
    comparison: Comparison | None = None,
) -> dict[str, Any]:
    """The same as plain values for JSON; angles in rad."""
    uncertainty, notes, matte, white = dict(lights.uncertainty), list(lights.notes), None, None
    records = [_record(light) for light in lights.lights]
    if strengths is not None:
        uncertainty["intensity"] = strengths.uncertainty
        notes += strengths.notes
        if strengths.normal is None:
            matte = {"sigma": strengths.sigma, "misfit": strengths.misfit}
        else:
            normal, std = strengths.normal.tolist(), strengths.normal_std
            white = {"normal": normal, "normal_std": std, "misfit": strengths.misfit}
        for record, power, std in zip(records, strengths.power.tolist(), strengths.std.tolist(), strict=True):
            record |= {"power": power, "power_relative_std": std}
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
        "matte": matte,
        "white": white,
        "lights": records,
        "uncertainty": uncertainty,
        "against": None if comparison is None else _compared(comparison),
        "notes": notes,
    }


def _white(strengths: Strengths) -> list[str]:
    """How a flat target lay, where that was estimated."""
    if strengths.normal is None or strengths.normal_std is None:
        return []
    normal = ", ".join(f"{number:.4f}" for number in strengths.normal)
    return [
        f"the white target faces {normal} ± {_degrees(strengths.normal_std)}, by lights that differ as little as "
        "possible; with --white-normal the strengths do not rest on that."
    ]


def _compared(comparison: Comparison) -> dict[str, Any]:
    """How far a list is from the lights, in rad."""
    return {
        "file": str(comparison.listed.file),
        "by_name": comparison.by_name,
        "angles": comparison.angles.tolist(),
        "median": float(np.median(comparison.angles)),
        "worst": float(comparison.angles.max()),
        "order": comparison.order.tolist(),
        "median_in_that_order": float(np.median(comparison.reordered)),
    }


def _against(lights: Lights, comparison: Comparison) -> list[Table | Text]:
    """The list beside what was found: a table, and what it comes to."""
    names = [light.name for light in lights.lights]
    table = plain_table(Column("image"), "direction in the list", Column("off by", justify="right", no_wrap=True))
    for name, direction, angle in zip(names, comparison.directions, comparison.angles.tolist(), strict=True):
        table.add_row(name, "  ".join(f"{number:7.4f}" for number in direction), _degrees(angle))
    worst = names[int(comparison.angles.argmax())]
    sentence = (
        f"Against {comparison.listed.file}, paired by {'name' if comparison.by_name else 'order'}: median "
        f"{_degrees(float(np.median(comparison.angles)))}, worst {_degrees(float(comparison.angles.max()))} ({worst})."
    )
    moved = comparison.moved
    if not len(moved):
        return [table, Text(f"{sentence} In no other order does the list fit better.")]
    pairs = ", ".join(f"{names[k]} the light of {names[comparison.order[k]]}" for k in moved[:_PAIRS])
    more = f" and {len(moved) - _PAIRS} more" if len(moved) > _PAIRS else ""
    median = _degrees(float(np.median(comparison.reordered)))
    note = f"Note: in another order the list fits better, median {median}: {pairs}{more}."
    return [table, Text(sentence), Text(note, style="yellow")]


def _record(light: Light) -> dict[str, Any]:
    position = light.position
    return {
        "file": light.name,
        "direction": light.direction.tolist(),
        "std": light.std,
        "apart": light.apart,
        "position": None if position is None else position.point.tolist(),
        "position_std": None if position is None else position.std.tolist(),
        "extent": _extent(light.extent),
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


def _extent(extent: Extent | None) -> dict[str, Any] | None:
    """The solid angle with its error, or its upper bound."""
    if extent is None:
        return None
    if extent.std is None:
        return {"at_most": extent.solid_angle, "clipped": extent.clipped}
    return {"solid_angle": extent.solid_angle, "std": extent.std}


def _strengths(lights: Lights, strengths: Strengths | None) -> Table:
    """The size of every light, and how strong it is in every channel."""
    table = plain_table(Column("image"), Column("solid angle, sr", justify="right", no_wrap=True))
    if strengths is not None:
        for name in _CHANNELS.get(strengths.power.shape[1], ()):
            table.add_column(name, justify="right", no_wrap=True)
    for number, light in enumerate(lights.lights):
        cells = [light.name, _solid_angle(light.extent)]
        if strengths is not None:
            stds = strengths.power[number] * strengths.std[number]
            pairs = zip(strengths.power[number].tolist(), stds.tolist(), strict=True)
            cells += [measured(value, std) for value, std in pairs]
        table.add_row(*cells)
    return table


def _bounds(lights: Lights) -> list[str]:
    """What to do about solid angles that are only bounds."""
    bounds = [light.extent for light in lights.lights if light.extent is not None and light.extent.std is None]
    clipped = sum(extent.clipped for extent in bounds)
    if clipped:
        return [
            f"solid angles with ≤ are upper bounds: the sensor clips {clipped} of {len(lights.lights)} highlights. "
            "Darker photographs of the mirror sphere would tell them."
        ]
    if bounds:
        return ["solid angles with ≤ are upper bounds: the highlights are as small as the blur. A larger sphere tells."]
    return []


def _solid_angle(extent: Extent | None) -> str:
    if extent is None:
        return "-"
    if extent.std is None:
        return f"≤ {extent.solid_angle:.2g}"
    return measured(extent.solid_angle, extent.std)


def _spheres(mirrors: Sequence[Mirror]) -> list[str]:
    """A sentence for each sphere."""
    lines = []
    for mirror in mirrors:
        for sphere in mirror.spheres:
            x, y, radius = sphere.circle
            sentence = f"{mirror.folder}: sphere at ({x:.2f}, {y:.2f}), radius {radius:.2f} px"
            if sphere.distance is not None:
                sentence += f", {sphere.distance:.3g} radii from the camera"
            if mirror.outline_seen:
                sentence += ", by the edges in the photographs: check it"
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
