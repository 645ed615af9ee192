"""How far images are off because a few directions stand for a map of light from all around."""

from __future__ import annotations

from dataclasses import replace

import torch

from matest.scene import EnvironmentLight, Scene
from matest.shading import Material, render_pixels

# Error of the irradiance by harmonics, which does not depend on the number of directions: measured, rms over rms.
_HARMONICS = 0.001
# Pixels that are shaded with both numbers of directions.
_PIXELS = 256


def direction_note(scene: Scene, material: Material) -> str | None:
    """A sentence on `direction_error`; None where no light is a map."""
    error = direction_error(scene, material)
    if error is None:
        return None
    maps = [light for lights in scene.lights for light in lights if isinstance(light, EnvironmentLight)]
    count = max(len(light.environment.nodes) for light in maps)
    return (
        f"{count:,} directions stand for the map of light around the scene: with half of them the radiance of this "
        f"material differs by {max(error, _HARMONICS):.1%} rms; the light's key directions sets their number."
    )


def direction_error(scene: Scene, material: Material) -> float | None:
    """By how much the radiance changes if half as many directions stand for maps, rms over rms; None without maps.

    The error of a lobe falls in proportion to their number or faster, so this bounds that of all of them. Some pixels
    of the first photograph with a map, without cast shadows.
    """
    image = next((k for k, lights in enumerate(scene.lights) if any(map(_is_map, lights))), None)
    if image is None:
        return None
    coarse = tuple(_halved(light) if isinstance(light, EnvironmentLight) else light for light in scene.lights[image])
    count = len(scene.surface)
    index = torch.linspace(0, count - 1, min(count, _PIXELS)).long()
    bare = replace(scene, shadows=(), shadow_edge=(), unoccluded=None, ambient=scene.ambient[image, None])
    with torch.no_grad():
        fine, half = (
            render_pixels(replace(bare, lights=(lights,)), 0, material, index)
            for lights in (scene.lights[image], coarse)
        )
    return float((fine - half).square().mean().sqrt() / fine.square().mean().sqrt())


def _is_map(light: object) -> bool:
    return isinstance(light, EnvironmentLight)


def _halved(light: EnvironmentLight) -> EnvironmentLight:
    """The light with half as many directions."""
    return replace(light, environment=light.environment.with_count(max(len(light.environment.nodes) // 2, 1)))
