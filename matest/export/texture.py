"""Maps of one or more views of a mesh in its texture, merged by their error bars."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from matest.estimation.parameter_map import ParameterMap, TexelStatus
from matest.export.atlas import Atlas, Texels
from matest.scene.camera import Camera
from matest.scene.mesh import Mesh
from matest.scene.surface import Surface

# Sides of textures whose size nobody gives: powers of two from the smaller to the larger.
_SIZES = (256, 4096)
# Texels around what is seen that take the value of the nearest, for what looks up between texels.
GUTTER = 4
# Largest distance of a place from that in a pixel beside it, pixels' widths on the surface: across a corner it is 1.4,
# and more where the surface is bent.
_BESIDE = 3.0
# Smallest cosine of the angle between surface and viewer by which a width on the surface is reckoned.
_GRAZING = 0.1
# Weight of a pixel on the rim, which may mix two surfaces, beside others: it counts where no other pixel does.
_RIM_WEIGHT = 1e-3
# The same of one whose value is that of its region.
_SHARED_WEIGHT = 1e-6
# Weight from which a view meets others, rather than fills in where they show nothing.
_MEETS = 0.5
# χ² per degree of freedom above which views that differ raise the standard error.
_DIFFERENT = 4.0
# Smallest standard error that weighs a value, relative to the largest value: maps of exact photographs have none.
_EXACT = 1e-6
# Largest one: maps of what photographs do not tell have an infinite one.
_UNKNOWN = 1e3
# In place of infinity, so that shares of it can be added.
_INFINITE = 1e100
# Distance of a ray's origin from its facet, share of the mesh's extent: rays then miss the facet itself.
_RAY_OFFSET = 1e-4
# Rays that are cast at a time.
_AT_ONCE = 1 << 15


@dataclass(frozen=True, eq=False)
class View:
    """Maps of a result, and from where they are seen.

    Attributes:
        surface: the object's N pixels.
        camera: that sees the mesh of an `Atlas`.
        maps: over the N pixels, by name of the parameter.
        relative: whether they are known up to a scale that other views do not share.
    """

    surface: Surface
    camera: Camera
    maps: Mapping[str, ParameterMap]
    relative: bool = False


@dataclass(frozen=True, eq=False)
class Texture:
    """A parameter at the texels of a mesh, the upper row first.

    Attributes:
        value: [S, S, C]; 0 where no view shows the surface, except in the gutter around what is seen.
        std: standard errors [S, S, C]; 0 likewise.
        status: uint8 [S, S] (`TexelStatus`); `UNSEEN` where no view shows the surface, and off it.
        mean: over the seen area of the surface [C].
    """

    value: np.ndarray
    std: np.ndarray
    status: np.ndarray
    mean: np.ndarray

    @property
    def filled(self) -> np.ndarray:
        """The values, with the mean where there are none [S, S, C]."""
        known = (self.std > 0).any(axis=2) | (self.status != TexelStatus.UNSEEN)
        return np.where(known[..., None], self.value, self.mean.astype(self.value.dtype))


@dataclass(frozen=True, eq=False)
class Coverage:
    """How much of a mesh the views show.

    Attributes:
        seen: share of the surface's area that a view shows.
        repeated: share that two views or more show.
        difference: median difference of views there, in standard errors of it; None where no two views meet.
    """

    seen: float
    repeated: float
    difference: float | None


def texture_size(atlas: Atlas, views: Sequence[View]) -> int:
    """Texels a side, a power of two, at which a texel is about as wide as a pixel of the sharpest view."""
    widths = []
    for view in views:
        assert view.surface.positions is not None
        depth = view.camera.coordinates(view.surface.positions.numpy())[:, 2]
        widths.append(float(np.median(view.camera.footprint(view.surface.shape, depth))))
    # Half a power more or less is as near.
    power = round(np.log2(atlas.resolution(min(widths))))
    return int(np.clip(2.0**power, *_SIZES))


def merged(
    atlas: Atlas, views: Sequence[View], size: int, scaled: frozenset[str] = frozenset()
) -> tuple[dict[str, Texture], Coverage, list[float]]:
    """The textures of views that have maps of the same parameters.

    Args:
        atlas: the mesh that all see.
        views: one or more.
        size: texels a side.
        scaled: parameters whose values are known up to a scale in views that are `relative`: where such a view meets
            those before it, it is brought to their scale.

    Returns:
        Textures by name of the parameter, what of the mesh is seen, and the factor by which `scaled` parameters of
        each view were multiplied: NaN where its scale is unknown and it meets none of those before it.
    """
    texels = atlas.texels(size)
    seen = [_seen(view, atlas, texels) for view in views]
    samples = [
        {name: _sample(each, pixels) for name, each in view.maps.items()}
        for view, pixels in zip(views, seen, strict=True)
    ]
    scales = _scales(
        [{name: each for name, each in one.items() if name in scaled} for one in samples],
        [view.relative for view in views],
    )
    for one, scale in zip(samples, scales, strict=True):
        for name in scaled & one.keys():
            one[name] = one[name].times(scale if np.isfinite(scale) else 1.0)
    area = atlas.texel_area(texels)
    textures, differences = {}, []
    for name in views[0].maps:
        parts = [one[name] for one in samples]
        total, difference = _mean(parts)
        textures[name] = _texture(total, texels, area)
        differences.append(difference)
    weights = np.stack([next(iter(one.values())).weight for one in samples])
    apart = np.concatenate(differences)
    coverage = Coverage(
        seen=float(area[weights.max(axis=0) > 0].sum() / area.sum()),
        repeated=float(area[(weights >= _MEETS).sum(axis=0) > 1].sum() / area.sum()),
        difference=float(np.median(apart)) if len(apart) else None,
    )
    return textures, coverage, scales


@dataclass(frozen=True, eq=False)
class _Pixels:
    """The pixels about some texels, which a view shows.

    Attributes:
        texels: number of all texels.
        index: of the texels that are seen [n].
        pixels: numbers of the four pixels about each [n, 4].
        weight: of each, bilinear, 0 where the pixel shows another part [n, 4].
    """

    texels: int
    index: np.ndarray
    pixels: np.ndarray
    weight: np.ndarray


@dataclass(frozen=True, eq=False)
class _Sample:
    """What a view says at T texels: value and standard error [T, C], weight beside other views, status [T]."""

    value: np.ndarray
    std: np.ndarray
    weight: np.ndarray
    status: np.ndarray

    @property
    def known(self) -> np.ndarray:
        """Whether the view shows the texel [T]."""
        return self.weight > 0

    def times(self, scale: float) -> _Sample:
        return _Sample(scale * self.value, scale * self.std, self.weight, self.status)


def _seen(view: View, atlas: Atlas, texels: Texels) -> _Pixels:
    """The pixels of a view about the texels that it shows."""
    mesh, camera, surface = atlas.mesh, view.camera, view.surface
    assert surface.positions is not None
    places = camera.project(surface.shape, texels.mixed(mesh.triangles)) - 0.5
    height, width = surface.shape
    inside = np.isfinite(places).all(axis=1) & (places > -1).all(axis=1) & (places < (width, height)).all(axis=1)
    index = np.flatnonzero(inside)
    index = index[_facing(mesh, camera, texels, index)]
    points = texels.mixed(mesh.triangles, index)
    toward = camera.toward(points)
    distance = np.linalg.norm(toward, axis=1)
    cosine = np.einsum("ij,ij->i", toward, mesh.face_normals(texels.faces[index])) / distance
    reach = _BESIDE * camera.footprint(surface.shape, distance) / np.maximum(cosine, _GRAZING)
    numbers = surface.image(np.arange(len(surface), dtype=np.int64) + 1).ravel() - 1
    left, upper = (np.floor(places[index, axis]).astype(np.int64) for axis in (0, 1))
    rest = places[index] - np.stack([left, upper], axis=1)
    pixels, weights = [], []
    positions = surface.positions.numpy()
    for down in (0, 1):
        for across in (0, 1):
            column, row = left + across, upper + down
            number = numbers[row.clip(0, height - 1) * width + column.clip(0, width - 1)]
            weight = np.abs(1 - across - rest[:, 0]) * np.abs(1 - down - rest[:, 1])
            on_image = (column >= 0) & (column < width) & (row >= 0) & (row < height)
            near = np.linalg.norm(positions[number] - points, axis=1) < reach
            weights.append(np.where(on_image & (number >= 0) & near, weight, 0))
            pixels.append(number)
    weight = np.stack(weights, axis=1)
    kept = weight.sum(axis=1) > 0
    about = np.stack(pixels, axis=1)[kept]
    return _Pixels(len(texels), index[kept], about, weight[kept] * np.where(surface.rim[about], _RIM_WEIGHT, 1.0))


def _facing(mesh: Mesh, camera: Camera, texels: Texels, index: np.ndarray) -> np.ndarray:
    """Whether some texels face the camera and nothing stands between [n]."""
    visible = np.zeros(len(index), dtype=bool)
    for first in range(0, len(index), _AT_ONCE):
        part = index[first : first + _AT_ONCE]
        points, normals = texels.mixed(mesh.triangles, part), mesh.face_normals(texels.faces[part])
        toward = camera.toward(points)
        smooth = np.einsum("ij,ij->i", toward, texels.mixed(mesh.corner_normals, part))
        facing = np.flatnonzero((np.einsum("ij,ij->i", toward, normals) > 0) & (smooth > 0))
        origins = points[facing] + _RAY_OFFSET * mesh.extent * normals[facing]
        ends = camera.toward(origins)
        reach = None if camera.orthographic else np.linalg.norm(ends, axis=1)
        unit = ends / np.linalg.norm(ends, axis=1, keepdims=True)
        visible[first + facing] = ~mesh.blocked(origins, unit, reach)
    return visible


def _sample(each: ParameterMap, pixels: _Pixels) -> _Sample:
    """A map at the texels that a view shows.

    Errors of neighbouring pixels count as one, since they share those of the parameters in common.
    """
    value, std, status = each.value.double().numpy(), each.std.double().numpy(), each.status.numpy()
    codes = status[pixels.pixels]
    weight = pixels.weight * np.where(codes == TexelStatus.SHARED, _SHARED_WEIGHT, 1.0)
    weight[codes == TexelStatus.UNSEEN] = 0
    total = weight.sum(axis=1)
    kept = total > 0
    index, weight, total = pixels.index[kept], weight[kept], total[kept]
    channels = value.shape[1]
    room = pixels.texels
    values, stds = np.zeros((room, channels)), np.zeros((room, channels))
    out = _Sample(values, stds, np.zeros(room), np.zeros(room, dtype=np.uint8))
    share = weight / total[:, None]
    for part, place in ((value, out.value), (std, out.std)):
        place[index] = np.einsum("nk,nkc->nc", share, np.nan_to_num(part, posinf=_INFINITE)[pixels.pixels[kept]])
    out.weight[index] = total
    out.status[index] = codes[kept][np.arange(len(index)), weight.argmax(axis=1)]
    return out


def _scales(views: Sequence[Mapping[str, _Sample]], relative: Sequence[bool]) -> list[float]:
    """The factor of every view that brings it to the scale of those before it, by the texels that they share."""
    scales = [1.0]
    for number in range(1, len(views)):
        ratios: list[np.ndarray] = []
        if not relative[number]:
            scales.append(1.0)
            continue
        for name, own in views[number].items():
            before = [view[name].times(scale) for view, scale in zip(views, scales, strict=False) if np.isfinite(scale)]
            total, _ = _mean(before)
            common = (own.weight >= _MEETS) & (total.weight >= _MEETS)
            ratio = total.value[common] / np.where(own.value[common] > 0, own.value[common], np.nan)
            ratios.append(ratio[np.isfinite(ratio)])
        every = np.concatenate(ratios) if ratios else np.zeros(0)
        scales.append(float(np.median(every)) if len(every) else float("nan"))
    return scales


def _mean(parts: Sequence[_Sample]) -> tuple[_Sample, np.ndarray]:
    """The mean of views weighted by 1/std², and the differences of views where they meet, in standard errors."""
    largest = max(float(np.abs(part.value).max(initial=np.finfo(np.float32).tiny)) for part in parts)
    sums = {key: np.zeros_like(parts[0].value) for key in ("weight", "value", "variance", "square")}
    status, best = np.zeros(len(parts[0].status), np.uint8), np.zeros(len(parts[0].weight))
    count = np.sum([part.weight >= _MEETS for part in parts], axis=0)
    for part in parts:
        variance = np.square(part.std.clip(_EXACT * largest, _UNKNOWN * largest))
        weight = part.weight[:, None] / variance
        sums["weight"] += weight
        sums["value"] += weight * part.value
        sums["variance"] += weight * weight * variance
        sums["square"] += weight * part.value**2
        clearest = weight.sum(axis=1)
        status = np.where(clearest > best, part.status, status)
        best = np.maximum(clearest, best)
    weight = np.where(sums["weight"] > 0, sums["weight"], 1)
    value = sums["value"] / weight
    std = np.sqrt(sums["variance"]) / weight
    several = count > 1
    misfit = np.zeros_like(value)
    if several.any():
        chi2 = np.maximum(sums["square"][several] - weight[several] * value[several] ** 2, 0)
        misfit[several] = chi2 / (count[several] - 1)[:, None]
    std = np.where(misfit > _DIFFERENT, std * np.sqrt(misfit), std)
    total = _Sample(value, std, np.max([part.weight for part in parts], axis=0), status)
    return total, np.sqrt(misfit[several]).ravel()


def _texture(total: _Sample, texels: Texels, area: np.ndarray) -> Texture:
    """Values of texels laid out, with a gutter."""
    from scipy.ndimage import distance_transform_edt

    size = texels.size

    def laid_out(values: np.ndarray) -> np.ndarray:
        image = np.zeros((size * size, *values.shape[1:]), values.dtype)
        image[texels.places] = values
        return image.reshape(size, size, *values.shape[1:])

    value, std = (laid_out(part.astype(np.float32)) for part in (total.value, total.std))
    known = laid_out(total.known)
    if known.any():
        distance, nearest = distance_transform_edt(~known, return_indices=True)
        gutter = (distance > 0) & (distance <= GUTTER)
        rows, columns = nearest[0][gutter], nearest[1][gutter]
        value[gutter], std[gutter] = value[rows, columns], std[rows, columns]
    weight = area * total.known
    mean = (weight[:, None] * total.value).sum(axis=0) / max(weight.sum(), np.finfo(float).tiny)
    return Texture(value, std, laid_out(total.status), mean)
