"""The image of a light in a mirror sphere, among everything else that the sphere shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from matest.errors import InputError
from matest.lights.sphere import MirrorSphere

# Share of the way from the sphere's median to the brightest place from which on a pixel belongs to a bright patch.
_PATCH = 0.75
# Share of the brightest place that some pixel of the light reaches. What is dimmer is something that it shines on.
_BRIGHT = 0.9
# Share of the way from what is around a patch to the brightest place from which on a pixel has weight: lower ones are
# streaks and flare, higher ones would leave out the soft edge that places the light between pixels.
_FOOT = 0.1
# The same of a second centroid. How far it is from the first shows how uneven the edge is, and what is around.
_HIGHER_FOOT = 0.25
# How far beyond its core a patch has weight, pixels: as far as the soft edges of sharp photographs reach.
_MARGIN = 3
# How far the window reaches beyond a patch in which its whole light is summed, pixels and radii of the patch at least:
# what lens and sensor blur is within.
_WIDEST_MARGIN = 9
_MARGIN_RADII = 1.5
# Percentiles of what is around a patch: its level is the median, and the others are how uneven it is.
_AROUND = (10, 50, 90)
# Highest level around a patch that is reckoned with, so that pixels of the patch lie above the higher foot.
_HIGHEST_LEVEL = 0.65
# What is narrower than this share of a patch's widest place is a streak and no part of its core.
_STREAK = 0.8
# Radius of the widest place from which on streaks are told from the rest, pixels.
_RESOLVED = 3.0
# Second largest patch as a share of the largest from which on nobody can say which one is the light.
_ALIKE = 0.5
# Share of the sphere that the light's image takes at most: a larger one is a bright room.
_LARGEST = 0.1
# Brightest place of an image as a share of that of the other images from which on its light is on.
_LIT = 0.2
# Share of the other images that show a patch at the same place from which on it belongs to the surroundings.
_STATIC = 0.5
# Patches of an image that are remembered, those with most pixels.
_PATCHES = 8
# Standard error of the weight of a pixel at the edge of a saturated patch whose neighbour is dark: that of an even
# distribution from 0 to 1, and as much again in variance, since neighbours along an edge err alike.
_STEP_STD = np.sqrt(2 / 12)


@dataclass(frozen=True)
class Window:
    """A patch and what is around it.

    Attributes:
        values: brightness H×W.
        seen: H×W, whether the sphere is seen there.
        distance: to the patch's core, pixels H×W.
        corner: column and row of its first pixel in the image.
        noise: standard deviation of a pixel's brightness.
    """

    values: np.ndarray
    seen: np.ndarray
    distance: np.ndarray
    corner: tuple[int, int]
    noise: float


@dataclass(frozen=True)
class Patch:
    """A bright patch of a sphere's image.

    Attributes:
        x, y: centres of its pixels and those around, in pixels from the image's left and upper edge [N].
        weights: of these pixels, 0 to 1 [N].
        covariance: of its place (x, y) in the image, pixels² [2, 2].
        pixels: bright ones.
        saturated: saturated ones among them.
        touches_rim: whether it reaches the sphere's outline.
        window: that shows it with what is around.
    """

    x: np.ndarray
    y: np.ndarray
    weights: np.ndarray
    covariance: np.ndarray
    pixels: int
    saturated: int
    touches_rim: bool
    window: Window

    @property
    def place(self) -> tuple[float, float]:
        """Its centroid in the image (x, y), pixels."""
        total = self.weights.sum()
        return float(self.weights @ self.x / total), float(self.weights @ self.y / total)

    @property
    def radius(self) -> float:
        """Of a circle of as many pixels."""
        return float(np.sqrt(self.pixels / np.pi))


@dataclass(frozen=True)
class Candidates:
    """The patches of one image that may be its light.

    Attributes:
        peak: brightest value on the sphere.
        patches: those with most pixels, largest first; none where no place stands out.
    """

    peak: float
    patches: tuple[Patch, ...]


def candidates(
    image: np.ndarray, sphere: MirrorSphere, mask: np.ndarray | None = None, saturation: float = 1.0
) -> Candidates:
    """The bright patches of a sphere.

    Args:
        image: H×W brightness, which saturation bounds.
        sphere: in that image.
        mask: H×W, nonzero where the sphere can be seen; None: everywhere inside its outline.
        saturation: brightness where the sensor is saturated; infinite where it never is.
    """
    from scipy import ndimage

    rows, columns = _window(sphere)
    y, x = (axis.ravel() + 0.5 for axis in np.mgrid[rows, columns])
    inside = sphere.contains(x, y).reshape(image[rows, columns].shape)
    seen = inside if mask is None else inside & (mask[rows, columns] > 0)
    if not seen.any():
        return Candidates(0.0, ())
    values = image[rows, columns]
    peak, median = float(values[seen].max()), float(np.median(values[seen]))
    if not peak > median:
        return Candidates(peak, ())
    # Fractions of the way from the median to the brightest place.
    height = np.where(seen, (values - median) / (peak - median), 0.0)
    labels, _ = ndimage.label(height >= _PATCH)
    sizes = np.bincount(labels.ravel())[1:]
    noise = _noise(values, seen) / (peak - median)
    saturated = seen & (values >= saturation)
    rim = ~ndimage.binary_erosion(inside, border_value=0)
    boxes, patches = ndimage.find_objects(labels), []
    for k in np.argsort(-sizes, kind="stable"):
        pixels = labels[boxes[k]] == k + 1
        bright = values[boxes[k]][pixels].max() >= _BRIGHT * peak
        if not bright or sizes[k] > _LARGEST * np.count_nonzero(seen):
            continue
        box = _grown(boxes[k], 2 * _MARGIN)
        corner = (columns.start + box[1].start, rows.start + box[0].start)
        pixels = labels[box] == k + 1
        wide = _grown(boxes[k], max(_WIDEST_MARGIN, round(_MARGIN_RADII * np.sqrt(sizes[k] / np.pi))))
        window = Window(
            values=values[wide],
            seen=seen[wide],
            distance=ndimage.distance_transform_edt(~_core(np.pad(labels[wide] == k + 1, 1))[1:-1, 1:-1]),
            corner=(columns.start + wide[1].start, rows.start + wide[0].start),
            noise=noise * (peak - median),
        )
        patches.append(_patch(pixels, height[box], saturated[box], rim[box], noise, corner, window))
        if len(patches) == _PATCHES:
            break
    return Candidates(peak, tuple(patches))


def choose(found: Sequence[Candidates], names: Sequence[object]) -> list[Patch]:
    """The patch of every image that is its light.

    A patch that other images show at the same place belongs to the surroundings; of the others the one with most
    pixels is the light.

    Args:
        found: candidates of every image.
        names: of the images.

    Raises:
        InputError: an image without a highlight, with two that are alike, or with one that the rim cuts off.
    """
    brightest = max(one.peak for one in found)
    chosen = []
    for index, (one, name) in enumerate(zip(found, names, strict=True)):
        others = [other for k, other in enumerate(found) if k != index]
        if one.peak < _LIT * brightest or one.peak <= 0:
            raise InputError(
                f"{name}: no highlight on the sphere: the image is dark there ({one.peak / max(brightest, 1e-300):.0%} "
                "of the brightest of the others); leave the image out, or expose it longer."
            )
        if not one.patches:
            raise InputError(
                f"{name}: no highlight on the sphere: no small place stands out from the rest; check the circle, or "
                "leave the image out."
            )
        moving = [patch for patch in one.patches if not _is_static(patch, others)] or list(one.patches)
        light, *rest = moving
        if rest and rest[0].pixels >= _ALIKE * light.pixels:
            places = " and ".join(f"({patch.place[0]:.0f}, {patch.place[1]:.0f})" for patch in (light, rest[0]))
            raise InputError(
                f"{name}: two highlights may be the light, at {places} pixels; make the mask zero where the wrong one "
                "is."
            )
        if light.touches_rim:
            x, y = light.place
            raise InputError(
                f"{name}: the highlight at ({x:.0f}, {y:.0f}) pixels reaches the rim of the sphere, which cuts it off; "
                "move the light to the front, or leave the image out."
            )
        chosen.append(light)
    return chosen


def _is_static(patch: Patch, others: Sequence[Candidates]) -> bool:
    """Whether most of several other images show a patch at the same place."""
    if len(others) < 2:
        return False
    place = np.array(patch.place)
    hits = [any(np.linalg.norm(place - other.place) < 1 + patch.radius / 2 for other in one.patches) for one in others]
    return sum(hits) > _STATIC * len(others)


def _window(sphere: MirrorSphere) -> tuple[slice, slice]:
    """Rows and columns of the image that hold the sphere."""
    x, y, radius = sphere.circle
    height, width = sphere.shape
    # The outline in perspective is an ellipse that is longer than its mean circle.
    reach = 1.2 * radius + 2 if sphere.distance else radius + 2
    rows = slice(int(np.clip(y - reach, 0, height)), int(np.clip(y + reach + 1, 0, height)))
    return rows, slice(int(np.clip(x - reach, 0, width)), int(np.clip(x + reach + 1, 0, width)))


def _grown(box: tuple[slice, slice], margin: int) -> tuple[slice, slice]:
    """Rows and columns with so many more on every side."""
    rows, columns = (slice(max(side.start - margin, 0), side.stop + margin) for side in box)
    return rows, columns


def _noise(values: np.ndarray, seen: np.ndarray) -> float:
    """Standard deviation of a pixel's noise, from the median difference of neighbours on the sphere."""
    both = seen[:, 1:] & seen[:, :-1]
    differences = np.abs(np.diff(values, axis=1)[both])
    return float(np.median(differences)) / 0.6745 / np.sqrt(2) if len(differences) else 0.0


def _patch(
    pixels: np.ndarray,
    height: np.ndarray,
    saturated: np.ndarray,
    rim: np.ndarray,
    noise: float,
    corner: tuple[int, int],
    window: Window,
) -> Patch:
    """The patch of some pixels of a window that reaches a little farther than they do.

    Args:
        pixels: of the patch, boolean.
        height: fractions of the way from the median to the brightest place.
        saturated, rim: pixels that are saturated, and those at the outline.
        noise: standard deviation of `height`.
        corner: column and row of the window's first pixel in the image.
        window: a wider one, to keep.
    """
    from scipy import ndimage

    core = _core(pixels)
    distance = ndimage.distance_transform_edt(~core)
    near = distance <= _MARGIN
    around = (distance > _MARGIN) & (distance <= 2 * _MARGIN) & ~pixels
    levels = np.clip(np.percentile(height[around], _AROUND), 0, _HIGHEST_LEVEL) if around.any() else np.zeros(3)
    low, level, high = levels.tolist()
    weights = np.where(near, _weights(height, level, _FOOT), 0.0)
    rows, columns = np.nonzero(near)
    places = np.stack([columns + corner[0] + 0.5, rows + corner[1] + 0.5])

    def centroid(weights: np.ndarray) -> np.ndarray:
        return np.asarray(places @ weights / weights.sum())

    offsets = (places - centroid(weights[near])[:, None]) / weights.sum()
    errors = (noise / (1 - level) / (1 - _FOOT)) ** 2 * (weights > 0) + _edge_variance(weights)
    drift = centroid(_weights(height[near], high, _HIGHER_FOOT)) - centroid(_weights(height[near], low, _FOOT))
    return Patch(
        x=places[0],
        y=places[1],
        weights=weights[near],
        covariance=(errors[near] * offsets) @ offsets.T + np.outer(drift, drift),
        pixels=int(core.sum()),
        saturated=int((core & saturated).sum()),
        touches_rim=bool((core & rim).any()),
        window=window,
    )


def _core(pixels: np.ndarray) -> np.ndarray:
    """The pixels of a patch without the streaks that a lens or scratches of the sphere draw from it.

    It is the opening with a disc of a share of the patch's widest place.

    Args:
        pixels: H×W, boolean; its border is False.
    """
    from scipy import ndimage

    depth = ndimage.distance_transform_edt(np.pad(pixels, 1))[1:-1, 1:-1]
    if depth.max() < _RESOLVED:
        return pixels
    reach = _STREAK * depth.max()
    core: np.ndarray = pixels & (ndimage.distance_transform_edt(depth <= reach) <= reach)
    return core


def _weights(height: np.ndarray, level: float, foot: float) -> np.ndarray:
    """Weights of pixels: 1 at the top, 0 up to a foot above the level around, linear between them.

    Args:
        height: of the pixels.
        level: of what is around.
        foot: as a share of the way from there to the top.
    """
    weights: np.ndarray = np.clip(((height - level) / (1 - level) - foot) / (1 - foot), 0, 1)
    return weights


def _edge_variance(weights: np.ndarray) -> np.ndarray:
    """Variance of pixels' weights by what saturation hides of where the edge runs between them.

    Next to a dark pixel a saturated one says nothing of the part of it that is lit; next to one of a soft edge the
    edge tells.
    """
    full = np.pad(weights >= 1, 1)
    padded = np.pad(weights, 1)
    variance = np.zeros_like(weights)
    for axis, shift in ((0, 1), (0, -1), (1, 1), (1, -1)):
        step = np.where(full, 1 - np.roll(padded, shift, axis), 0.0)
        variance += (_STEP_STD * step**2)[1:-1, 1:-1] ** 2
    return variance
