"""What Mitsuba renders of a material that was exported, beside what matest shades, pixel by pixel."""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from matest.brdf import Brdf
from matest.directions import to_local
from matest.scene import Camera
from matest.scene.surface import Surface

# It needs no LLVM, and images of some thousand pixels take it a fraction of a second.
_VARIANT = "scalar_rgb"
# Share of the brightest pixel from which on pixels are compared: below, single precision counts.
_LIT = 1e-3


@dataclass(frozen=True)
class Difference:
    """How far images are from ours.

    Attributes:
        rms: rms difference over the rms of ours.
        largest: largest relative difference of a pixel brighter than a thousandth of the brightest.
    """

    rms: float
    largest: float


def load(files: Sequence[Path]) -> Any:
    """The BSDF or the shape that Mitsuba makes of an exported scene file, whose plugin, if any, is among the files.

    Raises:
        ImportError: Mitsuba is not installed.
    """
    import mitsuba as mi

    mi.set_variant(_VARIANT)
    for plugin in (file for file in files if file.suffix == ".py"):
        spec = importlib.util.spec_from_file_location(plugin.stem, plugin)
        assert spec is not None
        assert spec.loader is not None
        spec.loader.exec_module(importlib.util.module_from_spec(spec))
    return mi.load_file(str(files[0]))


def rendered(shape: Any, camera: Camera, toward: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Radiance [H, W, 3] at the centres of pixels, of a shape under a distant light of irradiance 1.

    Args:
        shape: of Mitsuba, or a dictionary of one.
        camera: an orthographic one.
        toward: unit vector to the light [3].
        size: height and width of the image.
    """
    import mitsuba as mi

    height, width = size
    assert camera.height is not None
    half = camera.height / 2 * width / height
    place = mi.ScalarTransform4f()
    pose = place.look_at(origin=list(camera.position), target=list(camera.target), up=list(camera.up))
    film = {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"}, "pixel_format": "rgb"}
    sensor = {
        "type": "orthographic",
        "to_world": pose @ place.scale([half, half, 1]),
        "film": {**film, "component_format": "float32"},
        "sampler": {"type": "stratified", "jitter": False, "sample_count": 1},
    }
    light = {"type": "directional", "direction": (-toward).tolist(), "irradiance": {"type": "rgb", "value": [1, 1, 1]}}
    integrator = {"type": "direct", "bsdf_samples": 0, "emitter_samples": 1}
    scene = {"type": "scene", "integrator": integrator, "sensor": sensor, "light": light, "shape": shape}
    return np.array(mi.render(mi.load_dict(scene)), dtype=float)


def shaded(material: Brdf, surface: Surface, toward: np.ndarray) -> np.ndarray:
    """The same by matest at the pixels of a surface [N, 3]."""
    normals = surface.normals.double()
    light = torch.from_numpy(toward).expand_as(normals)
    wi, wo = to_local(normals, light, surface.view.double().expand_as(normals))
    return (material(wi, wo) * wi[:, 2:].clamp(min=0)).expand(-1, 3).numpy()


def difference(
    shape: Any, material: Brdf, surface: Surface, camera: Camera, lights: Sequence[np.ndarray]
) -> Difference:
    """How far Mitsuba's images of a shape are from ours of its material, off the rim.

    Args:
        shape: of Mitsuba, or a dictionary of one.
        material: with one value, or one at every pixel of the surface.
        surface: as the camera sees it.
        camera: an orthographic one.
        lights: unit vectors to the light of each image [3].
    """
    kept = ~surface.rim
    pairs = [
        (rendered(shape, camera, light, surface.shape).reshape(-1, 3)[surface.pixels], shaded(material, surface, light))
        for light in lights
    ]
    theirs, ours = (np.stack(side)[:, kept] for side in zip(*pairs, strict=True))
    lit = ours > _LIT * ours.max()
    rms = np.sqrt(((theirs - ours) ** 2).mean() / (ours**2).mean())
    return Difference(float(rms), float(np.abs(theirs / np.where(lit, ours, 1) - 1)[lit].max()))
