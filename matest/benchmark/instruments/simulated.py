"""Small subjects with known truth, drawn at random."""

from __future__ import annotations

import math
from zlib import crc32

import numpy as np
import torch

from matest.benchmark.instruments.photographs import CLEAN, Conditions, Sensor, Subject, sphere, subject, vase
from matest.brdf import model
from matest.photographs.noise import Noise

SIZE = 64
# The farthest that a light stands off the camera, degrees.
_OBLIQUE = 75.0
# Ranges that the truth is drawn from: (lowest, highest, logarithmic).
_RANGES = {
    "albedo": (0.1, 0.9, False),
    "sigma": (math.radians(5), math.radians(50), False),
    "diffuse": (0.05, 0.8, False),
    "specular": (0.1, 0.9, False),
    "slope": (0.05, 0.5, True),
    "k_dd": (0.1, 0.9, False),
    "k_uds": (0.05, 0.8, False),
    # rms slope 2σ/τ of 0.05 to 0.5 at the default height σ = 1 µm.
    "correlation_length": (4.0, 40.0, True),
}


def draw(expression: str, seed: int, conditions: Conditions = CLEAN) -> Subject:
    """Draw at random: sphere or vase; 1, 3 or 12 lights; one channel or three; material, noise and exposure.

    Args:
        expression: of the model. Albedos and scales of lobes 0.05 to 0.9, σ 5° to 50°, slopes 0.05 to 0.5; other
            parameters keep their defaults.
        seed: the same seed draws the same.
        conditions: of the camera.
    """
    generator = np.random.default_rng([crc32(expression.encode()), seed])
    brdf = model(expression)[0]
    channels = int(generator.choice((1, 3)))
    values = {}
    for name, declared in brdf.declared.items():
        if name in _RANGES:
            low, high, log = _RANGES[name]
            share = generator.random(channels if declared.per_channel else 1)
            value = low * (high / low) ** share if log else low + (high - low) * share
            values[name] = torch.as_tensor(value if declared.per_channel else value[0])
    surface = (sphere, vase)[generator.integers(2)](SIZE)
    lights = np.array([_direction(generator) for _ in range(generator.choice((1, 3, 12)))])
    sensor = Sensor(
        noise=Noise(5e-4 * 10 ** generator.random(), 1e-5 * 100 ** generator.random()),
        black=float(generator.choice((0.0, 0.03))),
        exposed=0.5 + 0.4 * generator.random(),
        conditions=conditions,
    )
    return subject(surface, lights, brdf.replace(values), sensor, channels=channels, seed=seed)


def _direction(generator: np.random.Generator) -> list[float]:
    """A unit vector, evenly drawn within `_OBLIQUE` of the camera."""
    z = 1 - generator.random() * (1 - math.cos(math.radians(_OBLIQUE)))
    turn = 2 * math.pi * generator.random()
    across = math.sqrt(1 - z * z)
    return [across * math.cos(turn), across * math.sin(turn), z]
