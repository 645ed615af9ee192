"""The outline of a sphere in photographs without a mask, from the edges that they show."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

# Longest side of the picture in which a circle is looked for, pixels: texture and scratches are gone there.
_SEARCHED = 300
# Higher threshold of Canny's edges, in 255 steps.
_EDGE = 60
# How perfect a circle of them must be; 1: perfect.
_PERFECT = 0.6
# Smallest radius of a circle as a share of the picture's shorter side.
_SMALLEST = 0.06
# Largest one.
_LARGEST = 1.0
# Directions from the centre along which the edge is looked for, and how far from the first circle, as a share of it.
_DIRECTIONS = 360
_REACH = 0.08
# Standard deviation of the smoothing before the derivative along them, pixels.
_SMOOTHING = 1.5
# Largest distance of a point of the edge from the circle, pixels.
_STRAY_PIXELS = 1.5
# The same as a share of the radius: the larger counts.
_STRAY_SHARE = 0.01
# Share of the directions in which the edge must lie on the circle.
_COMPLETE = 0.5
# Circles through three points that are tried.
_TRIALS = 500


def find_outline(photographs: Sequence[np.ndarray]) -> np.ndarray | None:
    """Points (x, y) along the outline of the sphere in photographs H×W from one place [n, 2]; None where none is seen.

    The mean of the photographs is searched for circles (the gradient's Hough transform). Along rays from the centre of
    the best one the steepest place is the edge; the circle through most of these places (random sample consensus) says
    which of them are the sphere's.
    """
    import cv2
    from scipy import ndimage
    from skimage.measure import CircleModel, ransac

    # Roots show the dark surroundings of bright lights.
    picture = np.sqrt(np.clip(np.mean(photographs, axis=0), 0, None)).astype(np.float32)
    top = float(np.percentile(picture, 99.5))
    if not top > 0:
        return None
    picture = np.clip(picture / top, 0, 1)
    scale = max(max(picture.shape) / _SEARCHED, 1.0)
    size = tuple(round(side / scale) for side in reversed(picture.shape))
    small = cv2.GaussianBlur(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), (0, 0), _SMOOTHING)
    shorter = min(size)
    circles = cv2.HoughCircles(
        np.round(255 * small).astype(np.uint8),
        cv2.HOUGH_GRADIENT_ALT,
        1.5,
        shorter / 4,
        param1=_EDGE,
        param2=_PERFECT,
        minRadius=round(_SMALLEST * shorter),
        maxRadius=round(_LARGEST * shorter),
    )
    if circles is None:
        return None
    x, y, radius = scale * circles[0, 0].astype(np.float64)
    angles = np.linspace(0, 2 * np.pi, _DIRECTIONS, endpoint=False)
    along = np.arange((1 - _REACH) * radius - 2, (1 + _REACH) * radius + 2, 0.5)
    columns = x + np.cos(angles)[:, None] * along
    rows = y + np.sin(angles)[:, None] * along
    smooth = ndimage.gaussian_filter(picture, _SMOOTHING)
    # Pixel centres lie at +0.5; places outside the image have no edge.
    profiles = ndimage.map_coordinates(smooth, [rows - 0.5, columns - 0.5], order=1, mode="nearest")
    steps = np.abs(np.diff(profiles, axis=1))
    best = steps.argmax(axis=1).clip(1, steps.shape[1] - 2)
    before, at, after = (steps[np.arange(_DIRECTIONS), best + shift] for shift in (-1, 0, 1))
    bend = before - 2 * at + after
    offset = np.where(bend < 0, (before - after) / 2 / np.where(bend < 0, bend, 1), 0.0).clip(-1, 1)
    distance = along[0] + 0.5 * (best + 0.5 + offset)
    points = np.stack([x + np.cos(angles) * distance, y + np.sin(angles) * distance], axis=1)
    height, width = picture.shape
    inside = ((points > 1) & (points < (width - 1, height - 1))).all(axis=1)
    points = points[inside & (at > 0)]
    if len(points) < _COMPLETE * _DIRECTIONS:
        return None
    stray = max(_STRAY_PIXELS, _STRAY_SHARE * radius)
    model, on_circle = ransac(
        points, CircleModel, min_samples=3, residual_threshold=stray, max_trials=_TRIALS, rng=np.random.default_rng(0)
    )
    if not model or on_circle.sum() < _COMPLETE * _DIRECTIONS:
        return None
    edge: np.ndarray = points[on_circle]
    return edge
