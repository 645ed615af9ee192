"""How a capture was understood: its conventions in words, for a person to check."""

from __future__ import annotations

from collections.abc import Sequence

from matest.capture.description import Description
from matest.photographs.photographs import Photographs
from matest.scene import EnvironmentLight, PointLight

_TRANSFERS = {"linear": "linear", "srgb": "sRGB"}
# Full scale of floats.
_FLOAT = "floats as stored"


def understood(description: Description, photographs: Photographs) -> dict[str, str]:
    """What was understood of a capture, by topic.

    Args:
        description: that it was read from.
        photographs: that the description gave.
    """
    return {
        "read from": _source(description),
        "shape": _shape(description, photographs),
        "axes": _axes(description),
        "transfer": _transfer(photographs),
        "units": _units(description, photographs),
        "lights": _lights(description, photographs),
        "scale": _scale(photographs),
    }


def _source(description: Description) -> str:
    names = ", ".join(file.name for file in description.sources)
    return names if description.layout is None else f"{names} ({description.layout})"


def _shape(description: Description, photographs: Photographs) -> str:
    geometry, surface = description.tables.geometry, photographs.scene.surface
    if surface.objects is not None:
        counts = (f"{name} ({surface.objects.pixels_of(k).sum():,})" for k, name in enumerate(surface.objects.names))
        return f"pixels of {len(surface.objects.names)} objects: {', '.join(counts)}"
    shape = f"normal map {geometry.normals}" if geometry.normals else f"mesh {geometry.mesh}"
    if geometry.shape is not None:
        place = "the file states" if surface.circle is None else "is fitted to the mask"
        shape = f"sphere whose circle {place}"
    inside = f" inside {description.tables.mask}" if description.tables.mask else ""
    return f"{shape}; {len(surface):,} pixels{inside}"


def _axes(description: Description) -> str:
    if description.content is not None:
        turned = "; turned into those of the mesh" if description.tables.light_axes == "camera" else ""
        return description.content.axes + turned
    if description.tables.geometry.mesh is None and not description.tables.object:
        return "x right, y up, z toward the viewer"
    camera = description.tables.camera
    if camera is None:
        return "those of the mesh"
    up, toward = ([float(f"{value:.4g}") for value in vector] for vector in (camera.up, camera.position))
    lights = "; lights in those of the camera" if description.tables.light_axes == "camera" else ""
    return f"those of the mesh; {camera.kind} camera at {toward}, up {up}{lights}"


def _transfer(photographs: Photographs) -> str:
    encoding, dtype = photographs.encoding, photographs.stored[0].dtype
    name = _TRANSFERS.get(str(encoding.transfer), f"gamma {encoding.transfer}")
    return f"{name}, " + (f"integers of {8 * dtype.itemsize} bits" if dtype.kind == "u" else _FLOAT)


def _units(description: Description, photographs: Photographs) -> str:
    geometry = description.tables.geometry
    if geometry.shape is not None:
        return "radii of the sphere, from its centre"
    if geometry.width is not None:
        return f"the image is {geometry.width:g} wide and lies in the plane z = 0, the origin at its centre"
    if photographs.scene.surface.positions is None:
        return "none: directions only"
    return "those of the mesh" if geometry.mesh or description.tables.object else f"those of {geometry.positions}"


def _lights(description: Description, photographs: Photographs) -> str:
    lights = [light for some in photographs.scene.lights for light in some]
    near = sum(isinstance(light, PointLight) for light in lights)
    around = sum(isinstance(light, EnvironmentLight) for light in lights)
    kinds = [(len(lights) - near - around, "distant"), (near, "near"), (around, "environment")]
    counted = " and ".join(f"{count} {kind}" for count, kind in kinds if count) or "no"
    tables = [light for image in description.tables.image for light in image.lights]
    stated = all(light.power_stated for light in tables)
    strength = f"strengths stated{_spread(photographs)}" if stated else "all equally strong"
    return f"{counted} light{'s' * (len(lights) != 1)} in {len(photographs)} images; {strength}"


def _spread(photographs: Photographs) -> str:
    """How much the strengths of lights differ, where they do."""
    powers: Sequence[float] = [float(light.power.mean()) for some in photographs.scene.lights for light in some]
    low, high = min(powers, default=0.0), max(powers, default=0.0)
    return f" ({low:.3g} to {high:.3g})" if high > low else ""


def _scale(photographs: Photographs) -> str:
    if photographs.relative:
        return "relative: lights are known up to one factor, and so is albedo"
    return f"absolute: full scale is radiance {photographs.encoding.scale:g}"
