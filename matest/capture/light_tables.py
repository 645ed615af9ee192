"""The lights of a capture from their tables."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import torch
from torch import Tensor

from matest.brdf.curvature import SHARPEST
from matest.capture.environment_maps import EnvironmentMaps
from matest.capture.schema import ImageTable, LightTable
from matest.errors import Fault, InputError, refuse
from matest.photographs.images import LARGEST
from matest.scene import Surface
from matest.scene.lights import DirectionalLight, Light, PointLight, unit_direction
from matest.scene.source import Source

# Largest exponent of the beam of a light: its half width at half maximum is 2°.
_LARGEST_EXPONENT = 1000.0
# Largest cosine between the axis of a source and the world's y axis for its height to stand upright.
_UPRIGHT = 0.99
# Least sine between the axis and the height of a source.
_LEAST_SINE = 1e-3


def lights_of(
    table: ImageTable, surface: Surface, channels: int, curvature: float | None, label: str, maps: EnvironmentMaps
) -> tuple[Light, ...]:
    """The lights of an image, with as many points for their sizes as the surface needs.

    Args:
        table: of the image.
        surface: that they shine on.
        channels: of the images.
        curvature: of what its material reflects, 1/rad²; None: it is not known.
        label: of the image, for refusals.
        maps: makes the lights that are maps.

    Raises:
        InputError: a light that makes no sense, or a near one without positions.
    """
    lights = tuple(_light(light, channels, f"{label}, light {k}", maps) for k, light in enumerate(table.lights))
    if surface.positions is None and any(light.near for light in lights):
        raise InputError(
            f"{label}: a light with a position needs the surface's positions; give a mesh, or positions beside the "
            "normal map."
        )
    return tuple(_resolved(light, surface, SHARPEST if curvature is None else curvature) for light in lights)


def _resolved(light: Light, surface: Surface, curvature: float) -> Light:
    """The light with as many points for its size as the surface needs."""
    if not isinstance(light, PointLight) or light.source is None or surface.positions is None:
        return light
    nearest = float(light.distance(surface.positions).min())
    return replace(light, source=light.source.for_curvature(curvature, nearest))


def _light(table: LightTable, channels: int, label: str, maps: EnvironmentMaps) -> Light:
    refuse(label, _light_faults(table))
    if table.environment is not None:
        return maps.light(table, label)
    source = None if table.size is None else _source(table, label)
    if table.radiance is not None and source is not None:
        power = colour(table.radiance, channels, f"{label}: radiance") * source.area
    elif table.radiance is not None and table.solid_angle is not None:
        power = colour(table.radiance, channels, f"{label}: radiance") * table.solid_angle
    else:
        key = "intensity" if table.direction is None else "irradiance"
        value = getattr(table, key)
        power = colour(math.pi if value is None else value, channels, f"{label}: {key}")
    if table.direction is not None:
        return DirectionalLight(unit_direction(list(table.direction), label), power, table.solid_angle)
    position = torch.tensor(table.position, dtype=torch.float64)
    if not bool(torch.isfinite(position).all()):
        raise InputError(f"{label}: position must be finite; got {list(table.position or ())}.")
    light = PointLight(position, power, table.solid_angle)
    if table.axis is None:
        return light
    axis = unit_direction(list(table.axis), label, "axis must point along the beam")
    # One with an axis and nothing else is Lambertian.
    anisotropy = 1.0 if table.anisotropy is None else table.anisotropy
    return replace(light, axis=axis, anisotropy=anisotropy, source=source)


def _source(table: LightTable, label: str) -> Source:
    """The shape of a light with a size: its height stands upright unless `up` says otherwise."""
    axis = unit_direction(list(table.axis or ()), label, "axis must point along the beam")
    upright = [0.0, 1.0, 0.0] if float(axis[1].abs()) < _UPRIGHT else [0.0, 0.0, 1.0]
    up = unit_direction(list(table.up or upright), label, "up must point along the height of the source")
    up = up - (up @ axis) * axis
    if not float(up.norm()) > _LEAST_SINE:
        raise InputError(f"{label}: up must not point along axis; give the direction of the height of the source.")
    up = up / up.norm()
    width, height = table.size if isinstance(table.size, tuple) else (table.size, table.size)
    sides = torch.stack([torch.linalg.cross(axis, up) * (width or 0) / 2, up * (height or 0) / 2])
    return Source(sides, round=not isinstance(table.size, tuple))


def _light_faults(table: LightTable) -> Iterator[Fault]:
    distant, near, angle = table.direction is not None, table.position is not None, table.solid_angle
    around = ("environment", "scale", "turn", "directions")
    if table.environment is not None:
        beside = [key for key in table.__struct_fields__ if key not in around and getattr(table, key) is not None]
        yield bool(beside), f"an environment has scale, turn and directions beside it; leave out {', '.join(beside)}."
        return
    for key in around[1:]:
        yield getattr(table, key) is not None, f"{key} goes with environment, the file of a map of light."
    sentence = "needs one of direction (a distant light), position (a near one) and environment (a map of all around)."
    yield distant == near, sentence
    wrong_power = (table.intensity if distant else table.irradiance) is not None
    yield wrong_power, "a light with direction has irradiance, one with position has intensity."
    possible = angle is None or 0 < angle <= 4 * math.pi
    yield not possible, f"solid_angle must lie between 0 and 4π sr; got {angle}."
    sized = table.size is not None
    powers = [value for value in (table.irradiance, table.intensity, table.radiance) if value is not None]
    useless = table.radiance is not None and (len(powers) > 1 or (not sized and (near or angle is None)))
    yield useless, "radiance goes with direction and solid_angle, or with size, and without irradiance and intensity."
    yield sized and table.axis is None, "size goes with position and axis, to which the source is square."
    yield sized and angle is not None, "size says how large the source is; leave out solid_angle."
    lengths = table.size if isinstance(table.size, tuple) else (table.size or 1.0,)
    possible = all(0 < length < math.inf for length in lengths)
    yield not possible, f"size is a diameter, or [width, height], in positive world units; got {table.size}."
    yield table.up is not None and not isinstance(table.size, tuple), "up goes with a size of [width, height]."
    exponent = table.anisotropy
    yield distant and table.axis is not None, "axis is that of a light with position, not with direction."
    yield exponent is not None and table.axis is None, "anisotropy goes with axis."
    possible = exponent is None or 0 <= exponent <= _LARGEST_EXPONENT
    yield not possible, f"anisotropy must lie between 0 and {_LARGEST_EXPONENT:g} (1: Lambertian); got {exponent}."


def colour(value: float | list[float], channels: int, label: str) -> Tensor:
    """A number or one number per channel as [C], not negative and below `LARGEST`; equal ones serve any C."""
    values = torch.atleast_1d(torch.as_tensor(value, dtype=torch.float64))
    if len(values.unique()) == 1:
        values = values[:1]
    if len(values) not in (1, channels) or not bool(((values >= 0) & (values < LARGEST)).all()):
        raise InputError(
            f"{label} must be one number or {channels} (one per channel of the images), not negative and below "
            f"{LARGEST:g}; got {value}."
        )
    return values.expand(channels).clone()
