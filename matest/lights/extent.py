"""Solid angles of lights from the size of their images in a mirror sphere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from matest.lights.highlight import Patch
from matest.lights.sphere import MirrorSphere, standard_errors

# Share of the window's reach beyond which pixels tell the level around the light.
_AROUND = 0.7
# Pixels along which what is around varies together: so many are one in the error of its level.
_PATTERN = 9
# Share of its peak that blur leaves a light at least, for its size to be told: at one half, the correction is as large
# as what is left.
_RESOLVED = 0.5
# Share of the correction for blur that is its standard error: lights are not the even discs that it is exact for.
_CORRECTION_STD = 0.5
# Error of the ratio that tells blur, by pixels and unevenness of small lights.
_RATIO_STD = 0.05
# Pixels of a light's image, its light over its peak, from which on its peak is not lost between them; of an ellipse
# those of the circle in it.
_FEWEST_PIXELS = 10.0
# Standard errors that a bound lies above the estimate.
_BOUND = 2.0
# Standard errors by which a light differs from the mean of all from which on they are not alike.
_ALIKE = 3.0
# Largest z = R²/(2 s²) of a disc of radius R under a Gaussian of standard deviation s: a sharp one.
_SHARP = 1e4


@dataclass(frozen=True)
class Extent:
    """Solid angle of a light as a sphere shows it: all its light over its greatest radiance.

    Attributes:
        solid_angle: sr; an upper bound where there is no error.
        std: standard error; None: the image does not resolve the light, or the sensor clips it.
        clipped: whether the sensor clips it.
    """

    solid_angle: float
    std: float | None
    clipped: bool


def measure_extent(patch: Patch, sphere: MirrorSphere) -> Extent | None:
    """The solid angle Ω = ∫ L dω / L₀ of a light of radiance L and peak L₀, from all light of its image.

    Blur moves light but keeps its sum, and lowers the peak: without a correction Ω is too large, never too small; so is
    it where the sensor clips the peak. The image of a disc of radius R, blurred by a Gaussian of standard deviation s,
    has the peak 1 − e^(−z), z = R²/(2 s²), and (∫ L dω)² / ∫ L² dω = Ω / h, h = 1 − e^(−z) (I₀(z) + I₁(z)). The ratio
    of this area to that by the peak, from 1 of a sharp image to 2 of a point, tells z.

    Returns:
        Its solid angle, or a bound; None where the light does not stand out.
    """
    window = patch.window
    reach = window.distance.max()
    around = window.seen & (window.distance > _AROUND * reach)
    inside = window.seen & (window.distance <= _AROUND * reach)
    if not around.any():
        return None
    level = float(np.median(window.values[around]))
    low, high = np.percentile(window.values[around], (16, 84))
    level_std = float(high - low) / 2 / np.sqrt(max(np.count_nonzero(around) / _PATTERN, 1.0))
    light = np.where(inside, window.values - level, 0.0)
    peak = _peak(light)
    rows, columns = np.nonzero(inside)
    x, y = columns + window.corner[0] + 0.5, rows + window.corner[1] + 0.5
    angles, light = sphere.solid_angles(x, y), light[inside]
    # Noise adds to the sum of squares.
    total, square = float(angles @ light), float(angles @ (light**2 - window.noise**2))
    if not (peak > 0 and total > 0 and square > 0):
        return None
    solid_angle = total / peak
    # Of the peak: the value of a parabola through 3×3 pixels at its middle has 5/9 of their variance.
    variance = (window.noise**2 * 5 / 9 + level_std**2) / peak**2
    variance += ((window.noise * np.linalg.norm(angles)) ** 2 + (level_std * angles.sum()) ** 2) / total**2
    mean = float(angles @ light) / float(light.sum())
    for step in standard_errors(sphere.covariance):
        moved = float(sphere.solid_angles(x, y, sphere.outline + step) @ light) / float(light.sum())
        variance += (moved / mean - 1) ** 2
    ratio, spread = total**2 / square / solid_angle, _RATIO_STD + float(np.sqrt(variance))
    lower, share, upper = (_peak_share(ratio * factor) for factor in (1 + spread, 1.0, 1 - spread))
    # Toward the rim a disc looks like an ellipse. A share is 1 − e^(−z), and its short axis has a smaller z.
    scales = np.linalg.svd(sphere.slopes(*np.array(patch.place)[:, None])[0], compute_uv=False)
    slant = float(scales[1] / scales[0])
    if patch.saturated or 1 - (1 - lower) ** slant < _RESOLVED or light.sum() * slant < _FEWEST_PIXELS * peak:
        bound = solid_angle * (1 + _BOUND * np.sqrt(variance))
        return Extent(float(bound), None, patch.saturated > 0)
    variance += (_CORRECTION_STD * (1 - share)) ** 2 + ((upper - lower) / 2 / share) ** 2
    return Extent(solid_angle * share, solid_angle * share * float(np.sqrt(variance)), False)


def combine(extents: Sequence[Extent | None]) -> Extent | None:
    """What several sightings of one light say: the mean of those that resolve it, or else the least bound."""
    resolved = [extent for extent in extents if extent is not None and extent.std is not None]
    if resolved:
        return _mean(resolved)
    told = [extent for extent in extents if extent is not None]
    return min(told, key=lambda extent: extent.solid_angle, default=None)


def common_extent(extents: Sequence[Extent | None]) -> Extent | None:
    """The solid angle that lights have in common; None where one is not told, or they differ."""
    resolved = [extent for extent in extents if extent is not None and extent.std is not None]
    if len(resolved) < len(extents) or not resolved:
        return None
    mean = _mean(resolved)
    distances = [(extent.solid_angle - mean.solid_angle) / extent.std for extent in resolved if extent.std]
    return mean if max(map(abs, distances), default=0.0) < _ALIKE else None


def _mean(resolved: Sequence[Extent]) -> Extent:
    """Their mean, weighted by their errors."""
    values = np.array([extent.solid_angle for extent in resolved])
    weights = np.array([extent.std or np.inf for extent in resolved]) ** -2.0
    return Extent(float(weights @ values / weights.sum()), float(weights.sum() ** -0.5), False)


def _peak(light: np.ndarray) -> float:
    """Height of the parabola through the brightest 3×3 pixels, or of its middle pixel if that is lower."""
    from scipy import ndimage

    means = ndimage.uniform_filter(light, 3, mode="constant")
    row, column = np.unravel_index(np.argmax(means), light.shape)
    around = np.pad(light, 1)[row : row + 3, column : column + 3]
    # Least squares of 1, x, y, x², xy, y² at the middle: corners −1/9, sides 2/9, middle 5/9.
    weights = np.array([[-1, 2, -1], [2, 5, 2], [-1, 2, -1]]) / 9
    return float((weights * around).sum())


def _peak_share(ratio: float) -> float:
    """Peak of a blurred disc as a share of that of a sharp one, from the ratio of its two areas."""
    from scipy.optimize import brentq
    from scipy.special import ive

    def excess(z: float) -> float:
        return float(-np.expm1(-z) / (1 - ive(0, z) - ive(1, z))) - ratio

    if ratio >= excess(0.01) + ratio:
        return 0.0
    if excess(_SHARP) >= 0:
        return 1.0
    return float(-np.expm1(-brentq(excess, 0.01, _SHARP)))
