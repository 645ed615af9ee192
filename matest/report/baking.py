"""Tables of a material's terms that a graphics card interpolates, so that its shader needs to know no model.

A model is a sum of terms: a product of amplitudes times a shape f, a function of the directions and of shape
parameters. Amplitudes stay live; shapes are tabled over three angles, with H = L + V the half vector:

- θh, of H from the normal N;
- ψ, of the light from H in the plane of N and H, positive toward the horizon: |ψ| ≤ π/2 − θh above it;
- ω, of the light from that plane.

So cos θi = cos ω cos(θh + ψ), cos θr = cos ω cos(θh − ψ), and θd from H to the light has cos θd = cos ω cos ψ.
With ψ divided by its largest value the domain is a box; with θd and its azimuth it would not be. To exchange light and
viewer turns ψ about.

A table holds asinh(f/unit) − TOP, which is logarithmic in a lobe and linear in its foot: on that scale lobes of
different widths interpolate well. A shape parameter moves the table along a line of nodes of its own. Several add up,
which is exact where the shape is a product of functions of one parameter each.

Source of angles about the half vector: Rusinkiewicz, "A new change of variables for efficient BRDF representation",
1998.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from matest.brdf import Brdf
from matest.brdf.terms import Product
from matest.directions import Directions
from matest.parameters import Parameter

# Nodes over θh from 0 to π/2: lobes of slope 0.03 and rims are exact to 2/255 on a screen.
HALF_NODES = 64
# Nodes over ψ/(π/2 − θh) from 0 to 1; where light and viewer may not be exchanged, as many again from −1.
ALONG_NODES = 20
# Nodes over ω from 0 to π/2.
ACROSS_NODES = 12
# Nodes of a shape parameter on either side of its estimate.
SIDE_NODES = 3
# Value, relative to the largest, below which the scale of a table is linear: what is less is not seen beside it.
_FOOT = 1e-6
# The largest value on that scale. Tables hold what is above it, so that half floats are exact near the largest.
TOP = math.asinh(1 / _FOOT)
# Share of the range of an angle by which the last node stays short of the horizon, where a cosine is 0.
_SHORT = 1e-4
# Factor by which a parameter that varies over decades may be moved.
_FACTOR = 2.0
# Factor below the estimate beyond which no node lies: a map may have a 0.
_FARTHEST = 1000.0
# Share of its value by which another parameter may be moved, at least.
_SHARE = 0.5
# Share of its domain likewise.
_DOMAIN_SHARE = 0.1
# Relative difference up to which a shape counts as the same with light and viewer exchanged.
_SAME = 1e-6


@dataclass(frozen=True, eq=False)
class Span:
    """How far a parameter of a material may be moved.

    Attributes:
        value: of the estimate; of a parameter that has a map its mean [1 or C].
        lower, upper: ends [1 or C].
        log: whether nodes are spaced by factors.
    """

    value: Tensor
    lower: Tensor
    upper: Tensor
    log: bool

    def node(self, values: Tensor) -> Tensor:
        """Place among the nodes, 0 to 2·SIDE_NODES, of values [..., 1 or C]."""
        at, middle, low, high = (v.log() if self.log else v for v in (values, self.value, self.lower, self.upper))
        side = torch.where(at < middle, middle - low, high - middle)
        share = torch.where(side > 0, (at - middle) / side, 0.0)
        return SIDE_NODES * (1 + share.clamp(-1, 1))

    def at(self, node: int) -> Tensor:
        """The value [1 or C] at a node."""
        middle, low, high = (v.log() if self.log else v for v in (self.value, self.lower, self.upper))
        share = node / SIDE_NODES - 1
        value = middle + share * (middle - low if share < 0 else high - middle)
        return value.exp() if self.log else value

    def widened(self, lower: Tensor, upper: Tensor) -> Span:
        """The same with ends at least this far out, as far as there are nodes."""
        if self.log:
            lower = torch.maximum(lower, self.value / _FARTHEST)
        return Span(self.value, torch.minimum(self.lower, lower), torch.maximum(self.upper, upper), self.log)


@dataclass(frozen=True, eq=False)
class TermTable:
    """The tables of one term; nodes over ω, ψ and θh follow each other in [W, P, H, 1 or C].

    Attributes:
        factors: amplitudes, and complements, that multiply it.
        unit: of the shape in asinh, 1/sr.
        base: at the estimate [W, P, H, 1 or C].
        moves: by shape parameter what each of its nodes adds [2·SIDE_NODES + 1, W, P, H, 1 or C].
    """

    factors: Product
    unit: float
    base: Tensor
    moves: Mapping[str, Tensor]


@dataclass(frozen=True, eq=False)
class BakedMaterial:
    """A material as tables.

    Attributes:
        spans: of every parameter, by name.
        terms: of the model.
        reciprocal: whether light and viewer may be exchanged in all of them: the tables then begin at ψ = 0.
    """

    spans: Mapping[str, Span]
    terms: tuple[TermTable, ...]
    reciprocal: bool


def span(declared: Parameter, value: Tensor, *, amplitude: bool) -> Span:
    """How far a parameter may be moved about its `value` [1 or C]: an amplitude to 0, and nothing out of its domain."""
    domain = declared.domain
    log = declared.log and not amplitude and bool((value > 0).all())
    reach = _SHARE * value.abs()
    if math.isfinite(domain.upper):
        reach = reach.clamp(min=_DOMAIN_SHARE * domain.width)
    lower, upper = (value / _FACTOR, value * _FACTOR) if log else (value - reach, value + reach)
    if amplitude:
        lower, upper = torch.zeros_like(value), torch.maximum(_FACTOR * value, upper)
    # Under lights of unknown strength an albedo may exceed its domain.
    floor, ceiling = value.clamp(max=domain.lower), value.clamp(min=domain.upper)
    return Span(value, torch.maximum(lower, floor), torch.minimum(upper, ceiling), log)


def bake(material: Brdf, ranges: Mapping[str, tuple[Tensor, Tensor]] | None = None) -> BakedMaterial:
    """Tables of an isotropic material.

    Args:
        material: at the values, [] or [1 or C], about which its parameters may be moved.
        ranges: by name of a parameter, lower and upper end [1 or C] that it has to reach beside those of `span`.

    Raises:
        ValueError: a model that depends on how the surface is turned about its normal.
    """
    structure = material.structure
    if structure.anisotropic:
        raise ValueError(f"'{material.expression}' is anisotropic; its tables would need a fourth angle.")
    values = {name: torch.atleast_1d(value.detach().double()) for name, value in material.parameters.items()}
    material = material.replace(values)
    spans = {
        name: span(material.declared[name], value, amplitude=name in structure.amplitudes)
        for name, value in values.items()
    }
    spans |= {name: spans[name].widened(*ends) for name, ends in (ranges or {}).items()}
    shapes = _shapes(material, _directions(reciprocal=False))
    reciprocal = all(bool(((f - f.flip(1)).abs() <= _SAME * f.abs()).all()) for f in shapes)
    directions = _directions(reciprocal=reciprocal)
    if reciprocal:
        shapes = [f[:, ALONG_NODES - 1 :] for f in shapes]
    # At grazing angles some shapes are unbounded, but not times both cosines.
    cosines = directions.cos_i * directions.cos_o
    units = [_FOOT * float((f.abs() * cosines).max()) or 1.0 for f in shapes]
    bases = [(f / unit).asinh() - TOP for f, unit in zip(shapes, units, strict=True)]
    moves: list[dict[str, Tensor]] = [{} for _ in bases]
    for name, of_name in spans.items():
        carriers = [k for k, term in enumerate(structure.terms) if name in term.shape_parameters]
        if carriers:
            nodes = [_shapes(material.replace({name: of_name.at(k)}), directions) for k in range(2 * SIDE_NODES + 1)]
            for k in carriers:
                moves[k][name] = torch.stack([(f[k] / units[k]).asinh() - TOP - bases[k] for f in nodes])
    parts = zip(structure.products, units, bases, moves, strict=True)
    return BakedMaterial(spans, tuple(TermTable(*part) for part in parts), reciprocal)


def coordinates(half: Tensor, along: Tensor, across: Tensor, *, reciprocal: bool) -> tuple[Tensor, Tensor, Tensor]:
    """Places among the nodes over θh, ψ and ω, from 0, of these angles in radians [...]."""
    half = half.clamp(0, math.pi / 2)
    place = 0.5 - ((1 - (4 / math.pi) * half).asin() / 3).sin()
    below = ((HALF_NODES - 1) * place).floor().clamp(max=HALF_NODES - 2)
    start, end = (_half_angle(node / (HALF_NODES - 1)).sin().square() for node in (below, below + 1))
    # Between nodes by sin²θh: along it the logarithm of a lobe is nearly straight.
    part = ((half.sin().square() - start) / (end - start)).clamp(0, 1)
    share = (along / (math.pi / 2 - half).clamp(min=_SHORT)).clamp(-1, 1)
    if reciprocal:
        share = share.abs()
    side = share.sign() * (1 - (1 - share.abs()).sqrt())
    return (
        below + part,
        (ALONG_NODES - 1) * (side if reciprocal else 1 + side),
        (ACROSS_NODES - 1) * (across / (math.pi / 2)).clamp(0, 1),
    )


def _half_angle(place: Tensor) -> Tensor:
    """θh at places from 0 to 1, dense at both ends, the last just short of π/2."""
    return (place.square() * (3 - 2 * place)).clamp(max=1 - _SHORT) * (math.pi / 2)


def _directions(*, reciprocal: bool) -> Directions:
    """Those of the nodes [W, P, H]."""
    half = _half_angle(torch.linspace(0, 1, HALF_NODES, dtype=torch.float64))
    side = torch.linspace(0, 1, ALONG_NODES, dtype=torch.float64)
    share = (side * (2 - side)).clamp(max=1 - _SHORT)
    if not reciprocal:
        share = torch.cat([-share[1:].flip(0), share])
    along = share[:, None] * (math.pi / 2 - half)
    across = (math.pi / 2) * torch.linspace(0, 1, ACROSS_NODES, dtype=torch.float64).clamp(max=1 - _SHORT)
    across = across[:, None, None]
    return Directions(*(_toward(half + sign * along, sign * across) for sign in (1, -1)))


def _toward(in_plane: Tensor, across: Tensor) -> Tensor:
    """Unit vectors [..., 3] at an angle from the normal within a plane, and at one from that plane."""
    x, y, z = across.cos() * in_plane.sin(), across.sin(), across.cos() * in_plane.cos()
    return torch.stack(torch.broadcast_tensors(x, y, z), dim=-1)


def _shapes(material: Brdf, directions: Directions) -> list[Tensor]:
    """The shape of every term at some directions [W, P, H, 1 or C]."""
    like = directions.cos_i * directions.cos_o
    shapes = [term.shape for term in material.terms(directions)]
    return [shape.expand(*like.shape[:-1], shape.shape[-1]) for shape in shapes]
