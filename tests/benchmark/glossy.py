"""Radiance of a glossy object straight from the equations, in numpy: by neither matest's shader nor a peer's."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import erf


@dataclass(frozen=True, eq=False)
class Glossy:
    """f = diffuse/π + specular · F D G / (4 cos θi cos θr): Beckmann's D, Smith's G, a dielectric's F.

    Attributes:
        diffuse, specular: one value a channel [C].
        slope: rms slope of the facets m.
        f0: reflectance at normal incidence.

    Source: Cook & Torrance 1982 (D, F); Smith 1967, Walter et al. 2007 (G).
    """

    diffuse: np.ndarray
    specular: np.ndarray
    slope: float
    f0: float

    def radiance(self, normals: np.ndarray, toward: np.ndarray, irradiance: float) -> np.ndarray:
        """Radiance [N, C] seen from z = ∞.

        Args:
            normals: unit vectors [N, 3].
            toward: unit vector to the light [3].
            irradiance: of a surface facing the light.
        """
        cos_i = normals @ toward
        lit = cos_i > 0
        half = toward + np.array([0.0, 0.0, 1.0])
        half /= np.linalg.norm(half)
        cos_h, light, view = (normals @ half)[lit], cos_i[lit], normals[lit, 2]
        lobe = self._fresnel(half[2]) * self._beckmann(cos_h) * self._smith(light) * self._smith(view)
        lobe /= 4 * light * view
        reflected = self.diffuse / math.pi + self.specular * lobe[:, None]
        radiance = np.zeros((len(normals), len(self.diffuse)))
        radiance[lit] = reflected * (irradiance * light)[:, None]
        return radiance

    def _fresnel(self, cos: float) -> float:
        """By Snell's law and Fresnel's two amplitudes."""
        eta = (1 + math.sqrt(self.f0)) / (1 - math.sqrt(self.f0))
        inside = math.sqrt(1 - (1 - cos * cos) / eta**2)
        across, along = (cos - eta * inside) / (cos + eta * inside), (inside - eta * cos) / (inside + eta * cos)
        return (across**2 + along**2) / 2

    def _beckmann(self, cos: np.ndarray) -> np.ndarray:
        return np.exp((1 - 1 / cos**2) / self.slope**2) / (math.pi * self.slope**2 * cos**4)

    def _smith(self, cos: np.ndarray) -> np.ndarray:
        a = cos / np.sqrt(np.clip(1 - cos**2, 1e-12, None)) / self.slope
        return 2 / (1 + erf(a) + np.exp(-a * a) / (a * math.sqrt(math.pi)))
