"""How well another program's material stands for ours, and the one of a family of its materials that does so best."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from scipy.optimize import least_squares
from torch import Tensor

from matest.brdf import Brdf
from matest.brdf.microfacet import beckmann
from matest.directions import Directions, from_angles
from matest.errors import InputError

# Pairs of directions that an error is measured at, and those that a family is fitted to, first roughly.
_PAIRS = 20_000
_FIT_PAIRS = 2_500
_ROUGH_PAIRS = 400
# Largest polar angle of both ends of a pair.
LARGEST_ANGLE = math.radians(80)
# Rms slopes of the facets that half of the pairs mirror, so that the narrowest lobe has pairs in its peak.
_SLOPES = (0.02, 0.05, 0.1, 0.2, 0.4)
# Evaluations of a rough fit from one start, and of the fit from the best of them.
_ROUGH_STEPS = 6
_STEPS = 20

# Pairs of directions, and the turn about the normal in rad, by which a material is found to have a direction.
_TURNED_PAIRS = 500
_TURN = 0.7
# Relative change with it that is rounding.
_TURN_ROUNDING = 1e-4

# A value this near to its bound is at it.
_AT_BOUND = 1e-6

# f in 1/sr [n, 1 or C] at directions to the light and to the viewer [n, 3].
Reflectance = Callable[[Tensor, Tensor], Tensor]


@dataclass(frozen=True)
class ConversionError:
    """How far a written material is from the original, at pairs of directions up to 80° from the normal.

    Attributes:
        relative_rmse: rms difference of f cos θi over its rms.
        median: relative difference of f that half of the reflected light is below.
    """

    relative_rmse: float
    median: float

    def __str__(self) -> str:
        return f"{self.relative_rmse:.2%} of the rms brightness, median {self.median:.2%}"


@dataclass(frozen=True)
class Conversion:
    """What was written for another program.

    Attributes:
        error: of the written material.
        parameters: as the other program names them.
        notes: sentences on how they came about.
        files: all that were written.
    """

    error: ConversionError
    parameters: Mapping[str, Any] = field(default_factory=dict)
    notes: Sequence[str] = ()
    files: Sequence[Path] = ()


@dataclass(frozen=True, eq=False)
class Pairs:
    """Directions to the light and to the viewer [n, 3], with weights [n, 1] that make sums integrals over both."""

    wi: Tensor
    wo: Tensor
    weight: Tensor

    def head(self, count: int) -> Pairs:
        return Pairs(self.wi[:count], self.wo[:count], self.weight[:count])


def pairs(count: int, seed: int = 0) -> Pairs:
    """Pairs of directions up to 80° from the normal: by turns even, and about the mirror direction."""
    generator = torch.Generator().manual_seed(seed)
    u = torch.rand(6, 2 * count, generator=generator, dtype=torch.float64)
    wi, wo = (_even(u[0], u[1]), _even(u[2], u[3]))
    slope = torch.tensor(_SLOPES, dtype=torch.float64)[(u[4] * len(_SLOPES)).long()]
    half = from_angles((slope * (-(1 - u[2]).log()).sqrt()).atan(), 2 * math.pi * u[3])
    mirrored = 2 * (wi * half).sum(-1, keepdim=True) * half - wi
    # Drawn by another number than the slope.
    wo = torch.where(u[5, :, None] < 0.5, wo, mirrored)
    kept = wo[:, 2] > math.cos(LARGEST_ANGLE)
    wi, wo = wi[kept][:count], wo[kept][:count]
    even = 1 / (2 * math.pi * (1 - math.cos(LARGEST_ANGLE)))
    directions = Directions(wi, wo)
    mirrored_density = torch.stack([_mirrored_density(directions, slope) for slope in _SLOPES]).mean(0)
    density = 0.5 * even + 0.5 * mirrored_density
    return Pairs(wi, wo, 1 / density)


def _even(u: Tensor, v: Tensor) -> Tensor:
    return from_angles((1 - (1 - math.cos(LARGEST_ANGLE)) * u).acos(), 2 * math.pi * v)


def _mirrored_density(directions: Directions, slope: float) -> Tensor:
    """Density of V = mirrored L [n, 1] where facets have Beckmann's distribution: D cos α/(4 L·H)."""
    facets = beckmann(directions, torch.tensor(slope, dtype=torch.float64)) * directions.cos2_half.sqrt()
    return facets / (4 * directions.cos_d)


def measured_error(material: Reflectance, written: Reflectance, sample: Pairs | None = None) -> ConversionError:
    """The error of a written material, and of what it reflects where it is defined (not NaN).

    Args:
        material: the original.
        written: what stands for it.
        sample: pairs of directions to measure it at; None: many.
    """
    sample = pairs(_PAIRS) if sample is None else sample
    with torch.no_grad():
        truth, values = (f(sample.wi, sample.wo).expand(-1, 3) for f in (material, written))
    known = values.isfinite().all(1)
    cosine, weight = sample.wi[known, 2:], sample.weight[known]
    truth, difference = truth[known] * cosine, (values - truth)[known] * cosine
    squares = [float((weight * part.square()).sum()) for part in (difference, truth)]
    relative = difference.abs() / truth.clamp(min=1e-300)
    return ConversionError(math.sqrt(squares[0] / max(squares[1], 1e-300)), _median(relative, weight * truth))


def _median(values: Tensor, weight: Tensor) -> float:
    """The weighted median of values, both [n, C]."""
    ordered, order = values.flatten().sort()
    total = weight.flatten()[order].cumsum(0)
    # A black material has no light to weigh with.
    return float(ordered[torch.searchsorted(total, 0.5 * total[-1]).clamp(max=len(ordered) - 1)])


def check_channels(material: Brdf, path: Path, what: str) -> None:
    """Refuse a material of another number of channels than one or three.

    Raises:
        InputError: it has such a number.
    """
    lengths = {len(value) for value in material.parameters.values() if value.ndim}
    if lengths - {1, 3}:
        raise InputError(
            f"{path}: {what} has the channels R, G, B, and the material has {max(lengths)}; fit it to RGB "
            "(--channels rgb)."
        )


# Values of a family by name, [] or [3].
Values = Mapping[str, Tensor]


@dataclass(frozen=True, eq=False)
class Family:
    """Materials of another program, one for every set of values.

    Attributes:
        name: of the family.
        reflectance: f [n, 1 or 3] of values at directions.
        starts: sets of values to fit from, the likeliest first.
        bounds: lower and upper end of every value that is free.
        held: values that all members share.
    """

    name: str
    reflectance: Callable[[Values, Directions], Tensor]
    starts: Sequence[Values]
    bounds: Mapping[str, tuple[float, float]]
    held: Values = field(default_factory=dict)

    def material(self, values: Values) -> Reflectance:
        """The member of the family at these values."""
        return lambda wi, wo: self.reflectance(values, Directions(wi, wo))


def best_fit(families: Sequence[Family], material: Brdf) -> tuple[Family, Values, ConversionError]:
    """The member of some families that is nearest to a material in f cos θi, its family, and its error."""
    sample = pairs(_FIT_PAIRS, seed=1)
    rough = [
        (family, *_least_squares(family, material, start, sample.head(_ROUGH_PAIRS), _ROUGH_STEPS))
        for family in families
        for start in family.starts
    ]
    family, start, _ = min(rough, key=lambda candidate: candidate[2])
    values, _ = _least_squares(family, material, start, sample, _STEPS)
    return family, values, measured_error(material, family.material(values))


def _least_squares(family: Family, material: Brdf, start: Values, sample: Pairs, steps: int) -> tuple[Values, float]:
    """Values at the least sum of squares, and that sum."""
    directions = Directions(sample.wi, sample.wo)
    root = sample.weight.sqrt() * sample.wi[:, 2:]
    with torch.no_grad():
        truth = material(sample.wi, sample.wo).expand(-1, 3) * root
    scale = truth.square().sum().sqrt().clamp(min=1e-300)
    sizes = [start[name].numel() for name in family.bounds]
    shapes = [start[name].shape for name in family.bounds]
    ends = [np.repeat([pair[side] for pair in family.bounds.values()], sizes) for side in (0, 1)]

    def unpacked(x: np.ndarray) -> Values:
        parts = torch.from_numpy(np.asarray(x)).split(sizes)
        free = {name: part.reshape(shape) for name, part, shape in zip(family.bounds, parts, shapes, strict=True)}
        return {**family.held, **free}

    def residuals(x: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            return ((family.reflectance(unpacked(x), directions) * root - truth) / scale).flatten().numpy()

    first = np.concatenate([start[name].flatten().numpy() for name in family.bounds])
    # A start at a bound could not move.
    margin = 1e-6 * np.minimum(ends[1] - ends[0], 1.0)
    first = np.clip(first, ends[0] + margin, ends[1] - margin)
    solution = least_squares(residuals, first, bounds=ends, x_scale="jac", max_nfev=steps, ftol=1e-6)
    # The solver stops just inside the bounds.
    x = solution.x
    for end in ends:
        x = np.where(np.abs(x - end) < _AT_BOUND, end, x)
    return unpacked(x), float(solution.cost)


def even_colour(material: Brdf) -> Tensor:
    """π f [3] away from every mirror direction: the albedo of a body, to begin with."""
    angle = torch.tensor(math.radians(45), dtype=torch.float64)
    wi, wo = (from_angles(angle, torch.tensor(phi, dtype=torch.float64)) for phi in (0.0, 0.5 * math.pi))
    with torch.no_grad():
        return (math.pi * material(wi, wo)).expand(3).clone()


def is_isotropic(material: Brdf) -> bool:
    """Whether a material stays the same when the surface turns about its normal."""
    sample = pairs(_TURNED_PAIRS)
    cos, sin = math.cos(_TURN), math.sin(_TURN)
    turn = torch.tensor([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]], dtype=torch.float64)
    with torch.no_grad():
        f, turned_f = material(sample.wi, sample.wo), material(sample.wi @ turn, sample.wo @ turn)
    return float((f - turned_f).abs().max()) <= _TURN_ROUNDING * float(f.abs().max())


def own_slopes(material: Brdf, *, pairs_of: bool = False) -> list[Tensor]:
    """Rms slopes that a fit of a lobe begins with: those of the material, and some that cover all.

    Args:
        material: to be fitted.
        pairs_of: whether slopes along tangent and bitangent are asked for [2]; otherwise one for both [].
    """
    named = [float(value.mean()) for name, value in material.parameters.items() if "slope" in name.rpartition(".")[2]]
    starts: list[Any] = [*named[:1], 0.08, 0.3]
    if pairs_of:
        starts = [*([named[:2]] if len(named) > 1 else []), (0.08, 0.3), (0.3, 0.08)]
    return [torch.tensor(start, dtype=torch.float64) for start in starts]


def own_f0(material: Brdf) -> float | None:
    """The reflectance of a material at normal incidence, where it has one value of it."""
    named = [value for name, value in material.parameters.items() if name.rpartition(".")[2] == "f0"]
    return float(named[0].mean()) if named else None
