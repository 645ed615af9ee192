"""How strong lights are, from photographs of a flat white target under them, with error bars."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from matest.errors import InputError
from matest.lights.lights import Lights
from matest.lights.mirror import Mirror
from matest.lights.sphere import standard_errors
from matest.lights.strengths import Strengths
from matest.progress import Progress, silent

# Pixels of a photograph at most.
_PIXELS = 20_000
# Pixels that are not saturated in any photograph, at least.
_FEWEST_PIXELS = 30
# Cells along the columns and rows of the target: errors are had from leaving out each.
_CELLS = (6, 3)
# Cosine between normal and light from which on a light counts: nearer to grazing, errors of its direction are large.
_LIT = 0.1
# Lights that determine the normal and the scatter of their strengths, at least.
_FEWEST_LIGHTS = 5
# Unevenness between photographs from which on the target is not as flat, or the lights not as distant, as is assumed.
_UNEVEN = 0.05

Array = NDArray[np.float64]


def measure_white(
    lights: Lights, target: Mirror, normal: tuple[float, float, float] | None = None, progress: Progress = silent
) -> Strengths:
    """The strength of distant lights that shine on a flat Lambertian target, one in each photograph.

    The radiance of a pixel is a E n·l: a its albedo over π, the same in all photographs, E the irradiance of the light
    l. A normal n that is not stated is the one with which the logarithms of the strengths scatter least: lights that
    grow stronger to one side cannot be told from a tilt, so that its error, and with it those of the strengths, is as
    large as the strengths scatter. Errors are those of leaving out parts of the target, of the directions and of the
    normal.

    Args:
        lights: where they are.
        target: photographs of the target, in the order of the lights; its mask shows the target, else all of them do.
        normal: of the target, toward the viewer, in world coordinates; None: estimated.
        progress: called with a word, the number of images read and their total.

    Raises:
        InputError: other photographs than lights, near lights, a target that is not lit, or saturated, too few lights
            to estimate the normal.
    """
    _check(lights, target)
    radiance, cell = _read(target, progress)
    directions = np.stack([light.direction for light in lights.lights])
    pattern = radiance.mean(axis=0)
    measured = radiance.mean(axis=1)
    without_cells = np.stack([radiance[:, cell != number].mean(axis=1) for number in np.unique(cell)])
    residual = radiance - (measured / measured.mean(axis=0))[:, None] * pattern
    misfit = float(np.sqrt((residual**2).mean() / (radiance**2).mean()))
    if normal is None:
        unit, turns = _estimated_normal(np.log(measured.mean(axis=1)), directions, target)
    else:
        unit, turns = np.array(normal) / np.linalg.norm(normal), np.zeros((0, 3))
    cosines = directions @ unit
    for file, cosine in zip(target.files, cosines, strict=True):
        if cosine < _LIT:
            raise InputError(
                f"{file}: its light stands {math.degrees(math.acos(max(cosine, -1.0))):.0f}° from the normal of the "
                "target, which it hardly lights; turn the target, check the normal, or leave the light out."
            )
    power = measured / cosines[:, None]
    logs = np.log(without_cells)
    logs -= logs.mean(axis=1, keepdims=True)
    variance = (len(logs) - 1) / len(logs) * ((logs - logs.mean(axis=0)) ** 2).sum(axis=0)
    for change in _changes(lights, directions, unit, turns, cosines):
        variance = variance + ((change - change.mean()) ** 2)[:, None]
    scale = float(power.mean()) / math.pi
    std = float(np.sqrt((turns**2).sum() / 2)) if len(turns) else None
    return Strengths(
        power / scale, np.sqrt(variance), None, misfit, tuple(_notes(target, misfit)), normal=unit, normal_std=std
    )


def _check(lights: Lights, target: Mirror) -> None:
    if len(target.files) != len(lights.lights):
        raise InputError(
            f"{target.folder}: expected {len(lights.lights)} photographs of the white target, one for each light in "
            f"the same order; got {len(target.files)}."
        )
    if any(light.position is not None for light in lights.lights):
        raise InputError(
            f"{target.folder}: a white target measures distant lights; leave out --radius, or measure near ones by a "
            "matte sphere (--diffuse)."
        )


def _read(target: Mirror, progress: Progress) -> tuple[Array, NDArray[np.int64]]:
    """Radiance of pixels of the target [K, P, C] that no photograph saturates, and the cell of each [P].

    Raises:
        InputError: a photograph that cannot be read, or a target that is too small, or saturated.
    """
    height, width = target.shape
    pixels = np.arange(height * width) if target.mask is None else np.flatnonzero(target.mask)
    if len(pixels) > _PIXELS:
        pixels = np.sort(np.random.default_rng(0).choice(pixels, _PIXELS, replace=False))
    radiance = target.radiances(pixels, "white target", progress)
    usable = np.isfinite(radiance).all(axis=(0, 2))
    if usable.sum() < _FEWEST_PIXELS:
        shares = np.isnan(radiance).any(axis=2).mean(axis=1)
        worst = int(shares.argmax())
        raise InputError(
            f"{target.files[worst]}: only {usable.sum()} pixels of the white target are saturated in no photograph, "
            f"and {shares[worst]:.0%} are in this one; expose for the target, or give a larger mask."
        )
    radiance, pixels = radiance[:, usable], pixels[usable]
    for file, values in zip(target.files, radiance, strict=True):
        if not (values.mean(axis=0) > 0).all():
            raise InputError(
                f"{file}: the white target is dark where its light should be; give its photographs in the order of the "
                "lights, or leave this light out of both folders."
            )
    ranks = [np.argsort(np.argsort(part, kind="stable"), kind="stable") for part in (pixels % width, pixels // width)]
    column, row = (rank * count // len(pixels) for rank, count in zip(ranks, _CELLS, strict=True))
    return radiance, column * _CELLS[1] + row


def _estimated_normal(logs: Array, directions: Array, target: Mirror) -> tuple[Array, Array]:
    """The normal with which strengths scatter least, and its changes by one standard error of two angles [2, 3].

    Raises:
        InputError: too few lights.
    """
    from scipy.optimize import least_squares

    if len(directions) < _FEWEST_LIGHTS:
        raise InputError(
            f"{target.folder}: {len(directions)} lights do not tell the normal of the white target from their "
            f"strengths, {_FEWEST_LIGHTS} would; state it with --white-normal X,Y,Z."
        )
    # As if all lights were alike: photometric stereo.
    start = np.linalg.lstsq(directions, np.exp(logs - logs.max()), rcond=None)[0]
    start /= np.linalg.norm(start)
    across = np.linalg.svd(start[None])[2][1:]

    def turned(angles: Array) -> Array:
        vector: Array = start + angles @ across
        return vector / np.linalg.norm(vector)

    def scatter(angles: Array) -> Array:
        strengths: Array = logs - np.log((directions @ turned(angles)).clip(min=_LIT / 10))
        return strengths - strengths.mean()

    solution = least_squares(scatter, np.zeros(2))
    # A mean and two angles are estimated.
    variance = 2 * solution.cost / (len(logs) - 3)
    covariance = variance * np.linalg.inv(solution.jac.T @ solution.jac)
    normal = turned(solution.x)
    steps = standard_errors(covariance)
    return normal, np.stack([turned(solution.x + step) - normal for step in steps])


def _changes(lights: Lights, directions: Array, normal: Array, turns: Array, cosines: Array) -> Iterator[Array]:
    """Changes of the logarithms of all strengths [K] with every error of directions and normal."""
    for number, light in enumerate(lights.lights):
        for axis in standard_errors(light.own):
            alone = np.zeros(len(directions))
            alone[number] = axis @ normal / cosines[number]
            yield alone
    for change in np.stack([light.common for light in lights.lights], axis=1):
        yield change @ normal / cosines
    for turn in turns:
        yield directions @ turn / cosines


def _notes(target: Mirror, misfit: float) -> list[str]:
    if misfit < _UNEVEN:
        return []
    return [
        f"the photographs of {target.folder} differ by {misfit:.0%} (rms) in more than their brightness, so that "
        "strengths may be off by more than their errors: a target that is not flat, or near lights?"
    ]
