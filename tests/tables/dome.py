"""A ball in a dome of LEDs, measured: a table of single measurements with formulas of its own."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

RADIUS, CENTRE = 30.0, np.array([5.0, -3.0, 10.0])
VIEWER = np.array([0.0, 40.0, 900.0])
BLACK, SATURATION = 64.0, 4000.0
ALBEDO = {"R": 0.6, "G": 0.4, "B": 0.2}
HEAD = (
    "pixel,channel,code,exposure,light_x,light_y,light_z,light_normal_x,light_normal_y,light_normal_z,"
    "point_x,point_y,point_z,normal_x,normal_y,normal_z,viewer_x,viewer_y,viewer_z"
)


def lambert(albedo: float, to_light: np.ndarray, to_viewer: np.ndarray, normal: np.ndarray) -> float:
    del to_light, to_viewer, normal
    return albedo / np.pi


def fujii(albedo: float, to_light: np.ndarray, to_viewer: np.ndarray, normal: np.ndarray, sigma: float = 0.5) -> float:
    """Fujii's improved form of Oren and Nayar's qualitative model, without interreflection."""
    a, b = 1 - 0.5 * sigma**2 / (sigma**2 + 0.33), 0.45 * sigma**2 / (sigma**2 + 0.09)
    cos_i, cos_o = normal @ to_light, normal @ to_viewer
    s = to_light @ to_viewer - cos_i * cos_o
    return albedo / np.pi * (a + b * s / (max(cos_i, cos_o) if s > 0 else 1))


@dataclass
class Dome:
    """The measurements that are written.

    Attributes:
        reflectance: f of albedo, directions and normal.
        power: of the cosine to the LED's normal that it radiates by.
        exposures: of the camera; every pixel is measured with each.
        noise: standard deviation of a code.
        scale: codes of radiance 1 at exposure 1.
        declared: lines of comments.
    """

    reflectance: Callable[..., float] = lambert
    power: float = 1.0
    exposures: tuple[float, ...] = (1.0,)
    noise: float = 0.0
    scale: float = 2.0e9
    lights: int = 12
    pixels: int = 60
    declared: Mapping[str, object] = field(default_factory=lambda: {"transfer": "linear", "black": BLACK})

    def rows(self) -> list[str]:
        rng = np.random.default_rng(4)
        rows = []
        tilt = np.radians(np.linspace(5, 70, self.lights))
        turn = 2.4 * np.arange(self.lights)
        for k in range(self.lights):
            inward = -np.array([np.sin(tilt[k]) * np.cos(turn[k]), np.sin(tilt[k]) * np.sin(turn[k]), np.cos(tilt[k])])
            place = -400 * inward
            for pixel in range(self.pixels):
                height = 0.25 + 0.75 * (pixel + 0.5) / self.pixels
                angle = 2.4 * pixel
                side = np.sqrt(1 - height**2)
                normal = np.array([side * np.cos(angle), side * np.sin(angle), height])
                point = CENTRE + RADIUS * normal
                to_light, to_viewer = place - point, VIEWER - point
                distance = np.linalg.norm(to_light)
                to_light, to_viewer = to_light / distance, to_viewer / np.linalg.norm(to_viewer)
                beam = max(-to_light @ inward, 0.0) ** self.power
                cosine = max(normal @ to_light, 0.0)
                numbers = ",".join(f"{x:.8g}" for x in (*place, *inward, *point, *(2 * normal), *VIEWER))
                for channel, albedo in ALBEDO.items():
                    radiance = self.reflectance(albedo, to_light, to_viewer, normal) * cosine * beam / distance**2
                    for exposure in self.exposures:
                        code = BLACK + self.scale * exposure * radiance + self.noise * rng.standard_normal()
                        rows.append(f"p{pixel},{channel},{min(code, SATURATION):.6f},{exposure},{numbers}")
        return rows

    def text(self) -> str:
        comments = [f"# {key}: {value}" for key, value in self.declared.items()]
        return "\n".join([*comments, HEAD, *self.rows()]) + "\n"

    def write(self, path: Path) -> Path:
        path.write_text(self.text(), "utf-8")
        return path
