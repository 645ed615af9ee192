"""Photographs of a simulated sphere on disk, as large as a camera's."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import tomli_w

from matest.benchmark.instruments.simulated import SATURATION
from matest.simulate import simulate

# The object's share of the image: 0.8 million pixels of 1024×1024.
_RADIUS = math.sqrt(0.8e6 / 1024**2 / math.pi)

MATERIALS = {
    "oren-nayar": {"albedo": [0.7, 0.5, 0.3], "sigma": 0.6},
    "cook-torrance": {"diffuse": [0.4, 0.2, 0.1], "specular": [0.8, 0.8, 0.8], "slope": 0.2, "f0": 0.04},
    "cook-torrance(masking=smith)": {
        "diffuse": [0.4, 0.2, 0.1],
        "specular": [0.8, 0.8, 0.8],
        "slope": 0.2,
        "f0": 0.04,
    },
}


def take(folder: Path, model: str, *, images: int, size: int) -> Path:
    """Photograph a sphere of `MATERIALS[model]`: 16-bit RGB PNG, camera noise, one light an image.

    Args:
        folder: where the capture goes.
        model: its expression.
        images: their number; lights stand 10° to 60° off the camera, all around it.
        size: of the square images in pixels.
    """
    scene = {
        "material": {"model": model, **MATERIALS[model]},
        "geometry": {"shape": "sphere", "centre": [size / 2, size / 2], "radius": _RADIUS * size},
        "camera": {"resolution": [size, size]},
        "encoding": {"transfer": "linear", "saturation": SATURATION},
        "noise": {"read": 0.002, "gain": 0.0002, "bits": 16, "seed": 1},
        "image": [
            {"lights": [{"direction": direction.tolist(), "irradiance": [3.0, 3.0, 3.0]}]}
            for direction in lights(images)
        ],
    }
    file = folder / "scene.toml"
    file.write_text(tomli_w.dumps(scene), "utf-8")
    return simulate(file)


def lights(count: int) -> np.ndarray:
    """Unit vectors [count, 3] to the lights."""
    number = np.arange(count)
    polar = np.deg2rad(10 + 50 * (number + 0.5) / count)
    # The golden angle: no two lights on one side.
    azimuth = number * math.pi * (3 - math.sqrt(5))
    return np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=1)
