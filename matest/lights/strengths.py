"""How strong lights are, from photographs of a matte sphere under them, with error bars."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from matest.brdf import OrenNayar
from matest.directions import to_local
from matest.errors import InputError
from matest.lights.lights import Light, Lights
from matest.lights.mirror import Mirror
from matest.lights.position import Placement
from matest.lights.sphere import MirrorSphere, standard_errors
from matest.lights.strength_sums import Sums
from matest.progress import Progress, silent
from matest.scene import Points
from matest.shading import shade

# Samples of all photographs together: more make errors of the calibration no smaller.
_SAMPLES = 24_000
# Pixels of one photograph at most.
_PIXELS = 6_000
# Pixels of one photograph that determine its light at least.
_FEWEST_PIXELS = 30
# Pixels from the rim from which on pixels are used: nearer ones are blurred with the background.
_RIM = 1.5
# Cosine between normal and light from which on a pixel is used: nearer the terminator a small error of the direction
# counts for much.
_LIT = 0.15
# Albedo of the sphere, of a grey one: its facets light each other a little. Another one is a scale of all lights.
_ALBEDO = 0.5
# Largest standard deviation of the facets' slope angles, rad.
_ROUGHEST = 0.9
# Step of derivatives by it, rad.
_STEP = 0.01
# Share of the mean radiance below which a residual no longer counts relative to its own radiance.
_DIM = 0.2
# Residuals from which on they count less, in robust standard deviations: 95 % efficient where all is normal.
_HUBER = 1.345
# Rounds of weights and roughness, after which they no longer change by what matters.
_ROUNDS = 2
# Sectors of the sphere: errors are had from leaving out each of their cells.
_SECTORS = 6
# Rings that cut them into cells.
_RINGS = 3
# Misfit from which on the sphere is not as matte as is assumed here.
_GLOSSY = 0.1
# Least power, so that its logarithm is finite.
_LEAST = 1e-12

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Strengths:
    """The strength of every light, relative to the others.

    Attributes:
        power: irradiance of distant lights, intensity of near ones; irradiance on the sphere is π on average [K, C].
        std: relative standard errors [K, C].
        sigma: standard deviation of the slope angles of the sphere's facets, rad (Oren-Nayar); None of a flat target.
        misfit: rms residual over rms radiance.
        notes: sentences that a user should read.
        normal: unit vector of a flat target [3]; None of a sphere.
        normal_std: standard error of each of its two tangential angles, rad; None where it is stated.
    """

    power: Array
    std: Array
    sigma: float | None
    misfit: float
    notes: tuple[str, ...] = ()
    normal: Array | None = None
    normal_std: float | None = None

    @property
    def uncertainty(self) -> float:
        """Relative standard deviation of a light's strength, rms over lights and channels."""
        return float(np.sqrt(np.mean(self.std**2)))


@dataclass(frozen=True)
class _Samples:
    """P pixels of a matte sphere in K photographs.

    Attributes:
        radiance: of each [K, P, C]; NaN where it is saturated.
        x, y: centres of the pixels [P].
        cell: of the sphere that each pixel lies in [P].
    """

    radiance: Array
    x: Array
    y: Array
    cell: NDArray[np.int64]


@dataclass(frozen=True)
class _World:
    """What shines on a matte sphere, and from where it is seen.

    Attributes:
        sphere: the matte one.
        outline: of it [3].
        directions: unit vectors to the lights [K, 3].
        positions: of near lights [K, 3]; None: all are distant.
        radius: of the sphere in world units, which counts for near lights.
    """

    sphere: MirrorSphere
    outline: Array
    directions: Array
    positions: Array | None
    radius: float

    def shares(self, samples: _Samples, sigma: float) -> Array:
        """Radiance under lights of power 1, at every pixel under every light [K, P]; 0 near the terminator."""
        seen = self.sphere.reflect(samples.x, samples.y, self.outline)
        normals, mirrored = seen.normals, seen.directions
        view = 2 * (normals * mirrored).sum(axis=1, keepdims=True) * normals - mirrored
        if self.positions is None:
            toward = np.broadcast_to(self.directions[:, None], (len(self.directions), *normals.shape))
            power = np.ones(toward.shape[:2])
        else:
            offsets = self.positions[:, None] - self._places(normals)
            distances = np.linalg.norm(offsets, axis=2, keepdims=True)
            toward, power = offsets / distances, distances[..., 0] ** -2
        frames, toward_viewer, toward_light = (
            torch.from_numpy(np.broadcast_to(array, toward.shape).reshape(-1, 3).copy())
            for array in (normals, view, toward)
        )
        wi, wo = to_local(frames, toward_light, toward_viewer)
        points = Points(wi[:, None], wo, torch.from_numpy(power.reshape(-1, 1, 1)))
        albedo, spread = (torch.tensor(value, dtype=torch.float64) for value in (_ALBEDO, sigma))
        radiance = shade(OrenNayar(albedo=albedo, sigma=spread), points)[:, 0]
        lit = (wi[:, 2] > _LIT) & (wo[:, 2] > 0)
        shares: Array = torch.where(lit, radiance, 0).numpy().reshape(toward.shape[:2])
        return shares

    def irradiance(self) -> Array:
        """At the place of the sphere from lights of power 1 [K]."""
        if self.positions is None:
            return np.ones(len(self.directions))
        squared: Array = ((self.positions - self._places(np.zeros(3))) ** 2).sum(axis=1)
        return 1 / squared

    def _places(self, normals: Array) -> Array:
        """Where the sphere has these normals [..., 3], world units."""
        centre = np.asarray(self.sphere.camera.position) + self.radius * self.sphere.centre(self.outline)
        places: Array = centre + self.radius * normals
        return places


def measure(
    lights: Lights, matte: Mirror, placement: Placement | None = None, progress: Progress = silent
) -> Strengths:
    """The strength of lights that shine on a matte sphere, one in each photograph.

    Radiance is E f(σ) + b: the power E of each photograph's light in each channel, the share f of it that Oren and
    Nayar's model reflects, and light b of each channel that is the same in all photographs. E and b follow from robust
    least squares for every σ, which is searched. Errors are those of leaving out parts of the sphere, and those of
    directions and outlines.

    Args:
        lights: where they are.
        matte: photographs of the matte sphere under the same lights in the same order.
        placement: of the mirror spheres, whose radius the matte one has too; None: directions only.
        progress: called with a word, the number of images read and their total.

    Raises:
        InputError: other photographs than lights, several spheres, one that is not lit, near lights without its place.
    """
    world = _world(lights, matte, placement)
    samples = _read(matte, world, progress)
    sigma, sums = _fit(world, samples)
    power = sums.solve()
    dark = [file for file, values in zip(matte.files, power, strict=True) if not (values > _LEAST).all()]
    if dark:
        raise InputError(
            f"{dark[0]}: the matte sphere is dark where its light should be; give its photographs in the order of the "
            "lights, or leave this light out of both folders."
        )
    cells = sums.without_cells()
    logs = _relative(np.log(np.clip(cells, _LEAST, None)))
    variance = (len(logs) - 1) / len(logs) * ((logs - logs.mean(axis=0)) ** 2).sum(axis=0)

    def change(moved: _World) -> Array:
        other = replace(sums, share=moved.shares(samples, sigma)).solve()
        return np.asarray(np.log(np.clip(other, _LEAST, None) / power)[None])

    for moved in (*_moved_alone(world, lights.lights), *_moved_together(world, lights.lights)):
        variance = variance + _relative(change(moved))[0] ** 2
    scale = float((power * world.irradiance()[:, None]).mean()) / math.pi
    misfit = sums.misfit(power)
    return Strengths(power / scale, np.sqrt(variance), sigma, misfit, tuple(_notes(matte, misfit)))


def _world(lights: Lights, matte: Mirror, placement: Placement | None) -> _World:
    if len(matte.files) != len(lights.lights):
        raise InputError(
            f"{matte.folder}: expected {len(lights.lights)} photographs of the matte sphere, one for each light in "
            f"the same order; got {len(matte.files)}."
        )
    if len(matte.spheres) != 1:
        raise InputError(f"{matte.folder}: expected one matte sphere; got {len(matte.spheres)}.")
    sphere = matte.spheres[0]
    near = [light.position.point for light in lights.lights if light.position is not None]
    if near and (placement is None or sphere.camera.orthographic or len(near) < len(lights.lights)):
        raise InputError(
            f"{matte.folder}: strengths of near lights need positions of all of them and a perspective camera; leave "
            "out --radius to measure them as distant ones."
        )
    directions = np.stack([light.direction for light in lights.lights])
    radius = 1.0 if placement is None else placement.radius
    return _World(sphere, sphere.outline, directions, np.stack(near) if near else None, radius)


def _read(matte: Mirror, world: _World, progress: Progress) -> _Samples:
    """An even choice of the sphere's pixels in all photographs.

    Raises:
        InputError: a photograph that cannot be read, or that shows too little of the sphere.
    """
    height, width = matte.shape
    flat = np.arange(height * width)
    x, y = flat % width + 0.5, flat // width + 0.5
    inside = np.ones(len(flat), dtype=bool) if matte.mask is None else matte.mask.ravel() > 0
    for dx, dy in ((_RIM, 0), (-_RIM, 0), (0, _RIM), (0, -_RIM)):
        inside &= world.sphere.contains(x + dx, y + dy)
    pixels = flat[inside]
    count = min(_PIXELS, max(_SAMPLES // len(matte.files), _FEWEST_PIXELS))
    # Random pixels, so that no grid of the sensor or the texture agrees with their distances.
    if len(pixels) > count:
        pixels = np.sort(np.random.default_rng(0).choice(pixels, count, replace=False))
    x, y = x[pixels], y[pixels]
    column, row, radius = world.sphere.circle
    sector = np.floor((np.arctan2(y - row, x - column) / (2 * math.pi) + 0.5) * _SECTORS).clip(0, _SECTORS - 1)
    # Rings of equal areas.
    ring = np.floor(((x - column) ** 2 + (y - row) ** 2) / radius**2 * _RINGS).clip(0, _RINGS - 1)
    radiance = matte.radiances(pixels, "matte sphere", progress)
    places = (np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
    samples = _Samples(radiance, *places, (sector * _RINGS + ring).astype(np.int64))
    usable = (world.shares(samples, 0.0) > 0) & np.isfinite(samples.radiance).all(axis=2)
    for file, number in zip(matte.files, usable.sum(axis=1), strict=True):
        if number < _FEWEST_PIXELS:
            raise InputError(
                f"{file}: only {number} pixels of the matte sphere are lit and not saturated; expose it for the "
                "sphere, or check its circle."
            )
    return samples


def _fit(world: _World, samples: _Samples) -> tuple[float, Sums]:
    """σ, and the sums of the robust least squares there."""
    from scipy.optimize import minimize_scalar

    sigma = 0.3
    usable: NDArray[np.bool_] = np.asarray(np.isfinite(samples.radiance).all(axis=2))
    weights = np.repeat(usable[..., None].astype(np.float64), samples.radiance.shape[2], axis=2)
    sums = Sums(world.shares(samples, sigma), np.nan_to_num(samples.radiance), weights, samples.cell)
    for _ in range(_ROUNDS):
        sums = replace(sums, weights=_weights(sums, usable))

        def misfit(sigma: float, sums: Sums = sums) -> float:
            return replace(sums, share=world.shares(samples, sigma)).cost()

        sigma = float(minimize_scalar(misfit, bounds=(0, _ROUGHEST), method="bounded", options={"xatol": 5e-3}).x)
        sums = replace(sums, share=world.shares(samples, sigma))
    lower, upper = max(sigma - _STEP, 0), min(sigma + _STEP, _ROUGHEST)
    slope = (world.shares(samples, upper) - world.shares(samples, lower)) / (upper - lower)
    return sigma, replace(sums, weights=_weights(sums, usable), slope=slope)


def _weights(sums: Sums, usable: NDArray[np.bool_]) -> Array:
    """Weights of relative residuals, less for outliers [K, P, C]."""
    model, residual = sums.residuals(sums.solve())
    counts = usable & (sums.share > 0)
    scale = np.maximum(model, np.maximum(_DIM * model[counts].mean(axis=0), _LEAST))
    relative = residual / scale
    spread = np.median(np.abs(relative[counts]), axis=0) / 0.6745
    huber = np.clip(_HUBER * spread / np.maximum(np.abs(relative), 1e-300), None, 1)
    weights: Array = np.where(counts[..., None], huber / scale**2, 0)
    return weights


def _relative(logs: Array) -> Array:
    """Logarithms of powers [..., K, C] without what all lights have in common."""
    relative: Array = logs - logs.mean(axis=-2, keepdims=True)
    return relative


def _moved_alone(world: _World, lights: Sequence[Light]) -> Iterator[_World]:
    """Every light moved by one standard error of its own along each axis, every second one the other way.

    What the errors of two lights have in common is left out of their relative strength, and must not seem so.
    """
    signs = (-1.0) ** np.arange(len(lights))[:, None]
    if world.positions is not None:
        covariances = np.stack([light.position.covariance for light in lights if light.position is not None])
        for axis in np.moveaxis(standard_errors(covariances), 1, 0):
            yield replace(world, positions=world.positions + signs * axis)
        return
    for axis in np.moveaxis(standard_errors(np.stack([light.own for light in lights])), 1, 0):
        yield _turned(world, signs * axis)


def _moved_together(world: _World, lights: Sequence[Light]) -> Iterator[_World]:
    """All lights, or the outline of the matte sphere, moved by each error that all photographs share."""
    if world.positions is None:
        for change in np.stack([light.common for light in lights], axis=1):
            yield _turned(world, change)
    for step in standard_errors(world.sphere.covariance):
        yield replace(world, outline=world.outline + step)


def _turned(world: _World, changes: Array) -> _World:
    moved = world.directions + changes
    return replace(world, directions=moved / np.linalg.norm(moved, axis=1, keepdims=True))


def _notes(matte: Mirror, misfit: float) -> list[str]:
    if misfit < _GLOSSY:
        return []
    return [
        f"the sphere of {matte.folder} differs from a matte one by {misfit:.0%} (rms), so that strengths may be off by "
        "more than their errors: gloss, shadows on it, lights that are near or in another order?"
    ]
