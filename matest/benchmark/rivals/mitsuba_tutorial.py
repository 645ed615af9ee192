"""Mitsuba 3 as its tutorials on inverse rendering use it: render, compare, one step of Adam."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import torch

from matest.benchmark.instruments.contest import GLOSSY, IMAGES
from matest.benchmark.instruments.photographs import FIX, IRRADIANCE, RADIUS, ring
from matest.benchmark.instruments.task import Trace, Values

VARIANT = "llvm_ad_rgb"
# A blend weighs each of its materials by half: twice the light makes it their sum.
_BLEND = 2.0
_KEYS = {
    "diffuse": "sphere.bsdf.bsdf_0.reflectance.value",
    "specular": "sphere.bsdf.bsdf_1.specular_reflectance.value",
    "slope": "sphere.bsdf.bsdf_1.alpha.value",
}


class Scenes:
    """One Mitsuba scene a light, all with the same material: `diffuse` beside a dielectric `roughconductor`.

    A conductor without extinction reflects as a dielectric does, and transmits nothing. The sampler takes the centre of
    every pixel, as the photographs do.

    Args:
        images: of a sphere of `GLOSSY` by `sphere_of`, or the first of them [K, S, S, 3].
        start: `diffuse` [3], `specular` [3], `slope`.

    Raises:
        ImportError: Mitsuba or LLVM is missing.
    """

    def __init__(self, images: np.ndarray, start: Values) -> None:
        import mitsuba as mi

        mi.set_variant(VARIANT)
        material, camera = mi.load_dict(_material(start)), _camera(images.shape[1])
        self.scenes = [
            mi.load_dict(
                {
                    "type": "scene",
                    "integrator": {"type": "direct", "bsdf_samples": 0, "emitter_samples": 1},
                    "camera": camera,
                    "sphere": {"type": "sphere", "bsdf": material},
                    "light": {
                        "type": "directional",
                        "direction": (-toward).tolist(),
                        "irradiance": _rgb([_BLEND * IRRADIANCE] * 3),
                    },
                }
            )
            for toward in ring(IMAGES)[: len(images)]
        ]
        self.parameters = mi.traverse(self.scenes[0])

    def render(self, number: int) -> Any:
        """One image [S, S, 3], differentiable in the material."""
        import mitsuba as mi

        return mi.render(self.scenes[number], self.parameters, spp=1)


def tutorial(images: np.ndarray, start: Values, rate: float, done: Callable[[Trace], bool]) -> Trace:
    """Adam on the mean squared difference of the images, one backward pass an image, from scenes not yet loaded.

    It goes on until `done`, which is asked after every step.
    """
    import drjit as dr
    import mitsuba as mi

    trace = Trace(rate=rate, note=f"learning rate {rate:g}")
    scenes = Scenes(images, start)
    targets = [mi.TensorXf(image.astype(np.float32)) for image in images]
    optimiser = mi.ad.Adam(lr=rate)
    for key in _KEYS.values():
        optimiser[key] = scenes.parameters[key]
    scenes.parameters.update(optimiser)
    while not done(trace):
        for number, target in enumerate(targets):
            dr.backward(dr.mean(dr.square(scenes.render(number) - target), axis=None))
        optimiser.step()
        for name, key in _KEYS.items():
            optimiser[key] = dr.clip(optimiser[key], 1e-3 if name == "slope" else 0.0, 1.0)
        scenes.parameters.update(optimiser)
        trace.add({name: _tensor(optimiser[key]) for name, key in _KEYS.items()})
    return trace


def _material(start: Values) -> dict[str, Any]:
    root = math.sqrt(FIX[GLOSSY]["f0"])
    return {
        "type": "blendbsdf",
        "weight": 1 / _BLEND,
        "body": {"type": "diffuse", "reflectance": _rgb(start["diffuse"].tolist())},
        "surface": {
            "type": "roughconductor",
            "distribution": "beckmann",
            "alpha": float(start["slope"]),
            "eta": (1 + root) / (1 - root),
            "k": 0.0,
            "specular_reflectance": _rgb(start["specular"].tolist()),
        },
    }


def _camera(size: int) -> dict[str, Any]:
    """An orthographic camera of so many pixels a side, in which a unit sphere has its radius in the photographs."""
    import mitsuba as mi

    half, place = 1 / (2 * RADIUS), mi.ScalarTransform4f()
    view = place.look_at(origin=[0, 0, 5], target=[0, 0, 0], up=[0, 1, 0]) @ place.scale([half, half, 1])
    film = {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}, "pixel_format": "rgb"}
    return {
        "type": "orthographic",
        "to_world": view,
        "film": {**film, "component_format": "float32"},
        "sampler": {"type": "stratified", "jitter": False, "sample_count": 1},
    }


def _rgb(values: list[float]) -> dict[str, Any]:
    return {"type": "rgb", "value": values}


def _tensor(value: Any) -> torch.Tensor:
    flat = torch.from_numpy(np.array(value)).flatten()
    return flat if len(flat) > 1 else flat[0]
