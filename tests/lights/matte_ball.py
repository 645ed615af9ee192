"""Photographs of matte balls, by Oren and Nayar's qualitative model with numpy alone."""

from __future__ import annotations

import numpy as np

SIZE = 120
CIRCLE = (60.4, 59.7, 50.0)
VIEW = np.array([0.0, 0.0, 1.0])


def reflected(normals: np.ndarray, toward: np.ndarray, sigma: float) -> np.ndarray:
    """Radiance of unit albedo under unit irradiance, for normals [n, 3] (Oren & Nayar 1994, eq. 17)."""
    cos_i, cos_r = np.clip(normals @ toward, 0, 1), np.clip(normals @ VIEW, 1e-3, 1)
    theta_i, theta_r = np.arccos(cos_i), np.arccos(cos_r)
    light, view = toward - cos_i[:, None] * normals, VIEW - cos_r[:, None] * normals
    lengths = np.linalg.norm(light, axis=1) * np.linalg.norm(view, axis=1)
    cos_phi = (light * view).sum(axis=1) / np.maximum(lengths, 1e-9)
    a, b = 1 - 0.5 * sigma**2 / (sigma**2 + 0.33), 0.45 * sigma**2 / (sigma**2 + 0.09)
    rough = np.sin(np.maximum(theta_i, theta_r)) * np.tan(np.minimum(theta_i, theta_r))
    result: np.ndarray = cos_i * (a + b * np.maximum(0, cos_phi) * rough) / np.pi
    return result


def photograph(
    toward: np.ndarray,
    power: np.ndarray,
    *,
    sigma: float = 0.3,
    albedo: float = 0.5,
    ambient: float = 0.0,
    texture: float = 0.0,
    noise: float = 0.0,
    seed: int = 0,
) -> np.ndarray:
    """A photograph in 16 bits [H, W, C] for irradiance [C].

    Args:
        toward: unit vector to the light.
        power: irradiance in each channel.
        sigma: standard deviation of the facets' slope angles.
        albedo: mean of it.
        ambient: radiance of the ball beside, in all channels.
        texture: relative standard deviation of the albedo of pixels, the same in every photograph.
        noise: standard deviation as a fraction of full scale.
        seed: of the noise.
    """
    rows, columns = np.indices((SIZE, SIZE)) + 0.5
    u, v = (columns - CIRCLE[0]) / CIRCLE[2], (CIRCLE[1] - rows) / CIRCLE[2]
    hit = u**2 + v**2 < 1
    normals = np.stack([u, v, np.sqrt(np.clip(1 - u**2 - v**2, 0, None))], axis=-1)[hit]
    pattern = albedo * (1 + texture * np.random.default_rng(99).standard_normal(len(normals)))
    image = np.zeros((SIZE, SIZE, len(power)))
    image[hit] = reflected(normals, np.asarray(toward), sigma)[:, None] * pattern[:, None] * power + ambient
    image += noise * np.random.default_rng(seed).standard_normal(image.shape)
    values: np.ndarray = np.round(65535 * np.clip(image, 0, 1)).astype(np.uint16)
    return values
