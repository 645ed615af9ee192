"""What is estimated: a model, which of its parameters are free, and how a vector of unknowns fills them in."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import torch
from torch import Tensor

from matest.brdf import Brdf
from matest.brdf.terms import Factor
from matest.parameters import Derived, Domain, Parameter, Role


@dataclass(frozen=True)
class Problem:
    """A model of C channels with unknowns laid out in one vector u [P].

    Attributes:
        brdf: the model; its own values serve for nothing but their names.
        channels: C.
        free: names of the estimated parameters, in order.
        held: values of the parameters that are not estimated.
        ties: dependent name -> the name whose value it takes.
        relative: the light scale is unknown: albedo-like parameters have no upper bound.
        gauge_limit: largest value of gauge parameters, the reciprocal of the brightest albedo: a facet reflects at
            most all light.
        arbitrary: held parameters that only set a scale: only quantities derived from them and others have an effect.
        pinned: values that single unknowns are held at, by their position in u.
    """

    brdf: Brdf
    channels: int
    free: tuple[str, ...]
    held: Mapping[str, Tensor]
    ties: Mapping[str, str]
    relative: bool = False
    gauge_limit: float = math.inf
    arbitrary: tuple[str, ...] = ()
    pinned: Mapping[int, float] = field(default_factory=dict)

    @cached_property
    def amplitudes(self) -> tuple[str, ...]:
        """Free parameters that only multiply shapes."""
        return tuple(name for name in self.free if name in self.factors)

    @cached_property
    def shapes(self) -> tuple[str, ...]:
        """Free parameters that the shapes depend on."""
        return tuple(name for name in self.free if name not in self.factors)

    @cached_property
    def shaping(self) -> tuple[str, ...]:
        """Parameters, free or not, that the shapes depend on."""
        return tuple(name for name in self.brdf.declared if self.ties.get(name, name) not in self.factors)

    @cached_property
    def factors(self) -> set[str]:
        """Parameters, free or not, that only multiply shapes."""
        return {self.ties.get(name, name) for name in self.brdf.structure.amplitudes}

    def declared(self, name: str) -> Parameter:
        return self.brdf.declared[name]

    def domain(self, name: str) -> Domain:
        declared = self.declared(name)
        if declared.periodic:
            return Domain(-math.inf, math.inf)
        if declared.role is Role.GAUGE:
            return Domain(declared.domain.lower, self.gauge_limit)
        carries_scale = self.relative and name in self.brdf.structure.scales
        return declared.domain.lifted() if carries_scale else declared.domain

    def quantity(self, name: str) -> Derived | None:
        """The derived quantity that is all that can be known of a parameter, one beside it being arbitrary; or None."""
        for path, names in self.brdf.structure.derived.items():
            if name in names and name not in self.arbitrary and {*names} & {*self.arbitrary}:
                return self.brdf.derived[path]
        return None

    def limit_of_gauges(self, unknowns: Tensor) -> float:
        """The largest gauge with which no facet reflects more than all light: 1 / (brightest albedo beside it)."""
        values = self.values(unknowns)
        gauges = {*map(Factor, self.gauges)}
        beside = {factor for product in self.brdf.structure.products if {*product} & gauges for factor in product}
        brightest = max((float(factor.value(values).max()) for factor in beside - gauges), default=0.0)
        return 1 / max(brightest, 1e-9)

    @property
    def gauges(self) -> list[str]:
        """Free parameters that stand for the unknown light scale."""
        return [name for name in self.free if self.declared(name).role is Role.GAUGE]

    def count(self, name: str) -> int:
        """Number of unknowns of a parameter: one, or one per channel."""
        return self.channels if self.declared(name).per_channel else 1

    @cached_property
    def where(self) -> dict[str, slice]:
        """The place of every free parameter in u."""
        places, start = {}, 0
        for name in self.free:
            places[name] = slice(start, start + self.count(name))
            start += self.count(name)
        return places

    @property
    def size(self) -> int:
        return sum(self.count(name) for name in self.free)

    @cached_property
    def labels(self) -> list[str]:
        """A name for every unknown: `sigma`, `albedo[0]`."""
        return [
            name if self.count(name) == 1 else f"{name}[{channel}]"
            for name in self.free
            for channel in range(self.count(name))
        ]

    @cached_property
    def lower(self) -> Tensor:
        return self._ends([self.domain(name).lower for name in self.free])

    @cached_property
    def upper(self) -> Tensor:
        return self._ends([self.domain(name).upper for name in self.free])

    def _ends(self, ends: Sequence[float]) -> Tensor:
        repeated = [end for end, name in zip(ends, self.free, strict=True) for _ in range(self.count(name))]
        for position, value in self.pinned.items():
            repeated[position] = value
        return torch.tensor(repeated, dtype=torch.float64)

    @cached_property
    def selectors(self) -> Tensor:
        """0/1 matrices [C, Q, P]: the unknown that each of the Q free parameters is in each channel."""
        out = torch.zeros(self.channels, len(self.free), self.size, dtype=torch.float64)
        for row, name in enumerate(self.free):
            place = self.where[name]
            for channel in range(self.channels):
                out[channel, row, place.start + (channel if self.count(name) > 1 else 0)] = 1
        return out

    def values(self, unknowns: Tensor) -> dict[str, Tensor]:
        """Every parameter's value: a scalar, or [C]."""
        values = dict(self.held)
        for name, place in self.where.items():
            values[name] = unknowns[place] if self.count(name) > 1 else unknowns[place.start]
        values.update({name: values[source] for name, source in self.ties.items()})
        return values

    def wrapped(self, unknowns: Tensor) -> Tensor:
        """The same unknowns with periodic ones inside their domain."""
        out = unknowns.clone()
        for name, place in self.where.items():
            declared = self.declared(name)
            if declared.periodic:
                out[place] = declared.domain.lower + (out[place] - declared.domain.lower) % declared.domain.width
        return out

    def ordered(self, unknowns: Tensor) -> Tensor:
        """The same material with lobes in their order, where nothing that is held or tied tells them apart."""
        ordered = self.material(unknowns).ordered.parameters
        out = unknowns.clone()
        for name, place in self.where.items():
            out[place] = ordered[name]
        kept = all(torch.allclose(torch.as_tensor(value), ordered[name]) for name, value in self.values(out).items())
        return out if kept else unknowns

    def material(self, unknowns: Tensor) -> Brdf:
        return self.brdf.replace(self.values(unknowns))
