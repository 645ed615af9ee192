"""Spheres under known lights, and models whose error bars are predicted for them."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from matest.brdf import Lambert, model
from matest.capture import Capture
from matest.identifiability import Check, Plan, check
from tests.captures import changed, directional
from tests.simulated import DIRECTIONS, Studio

RING = tuple(
    (math.cos(a) * math.sin(tilt), math.sin(a) * math.sin(tilt), math.cos(tilt))
    for tilt in (0.4, 0.9)
    for a in np.arange(6) * math.pi / 3 + tilt
)
LIGHTS = {1: DIRECTIONS[:1], 3: DIRECTIONS[:3], 12: RING}
VALUES: dict[str, dict[str, float]] = {
    "lambert": {"albedo": 0.6},
    "oren-nayar": {"albedo": 0.6, "sigma": 0.5},
    "cook-torrance": {"diffuse": 0.4, "specular": 0.8, "slope": 0.2},
    "li-torrance": {"k_dd": 0.5, "k_uds": 0.5, "correlation_length": 8.0},
}
FIXED = {name: {"f0": 0.04} if "torrance" in name else {} for name in VALUES}


def studio(directions: Any, size: int = 48, irradiance: float = 1.2, **kind: Any) -> Studio:
    return Studio(size=size, lights=tuple((directional(d, irradiance),) for d in directions), **kind)


def photograph(where: Studio, name: str, seed: int) -> Capture:
    return where.photograph(model(name)[0].replace(VALUES[name] | FIXED[name]), seed)


def checked(capture: Capture | Plan, name: str, **options: Any) -> Check:
    return check(capture, name, fix=FIXED.get(name, {}), **options)


def plate(tilt: float) -> Capture:
    """Of a sphere, only the part that faces the camera, lit from `tilt` degrees to the side."""
    angle = math.radians(tilt)
    capture = studio([(math.sin(angle), 0, math.cos(angle))]).photograph(Lambert(0.5), 1)
    surface = capture.scene.surface
    kept = (surface.normals[:, 2] > 0.98).numpy()
    scene = replace(capture.scene, surface=surface.take(kept))
    return changed(capture, scene=scene, stored=tuple(pixels[kept] for pixels in capture.photographs.stored))
