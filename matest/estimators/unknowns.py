"""What is estimated: a model, its blocks of unknowns, and their places in one vector."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import torch
from torch import Tensor

from matest.brdf import Brdf
from matest.brdf.terms import Factor
from matest.estimators.blocks import Block, Kind, Multiplier, nuisance
from matest.estimators.statistics import PriorTerms
from matest.parameters import Derived, Domain, Parameter, Role
from matest.samples.calibration import Calibration, Family
from matest.samples.groups import Groups

# Standard deviation of the mean of a block that is centred, as a share of that of each of its unknowns.
_CENTRED = 1e-3


@dataclass(frozen=True)
class Problem:
    """A model of C channels with blocks of unknowns laid out in one vector u [P].

    Multipliers and nuisances come last: a sample touches all others, but of these only some, as its group says.

    Attributes:
        brdf: the model; its own values serve for nothing but their names.
        channels: C.
        blocks: what is estimated, in the order of u.
        held: values of the parameters that are not estimated.
        ties: dependent name -> the name whose value it takes.
        relative: the light scale is unknown: albedo-like parameters have no upper bound.
        arbitrary: held parameters that only set a scale: only quantities derived from them and others have an effect.
        pinned: values that single unknowns are held at, by their position in u.
        groups: of the samples; multipliers need them.
        calibration: what its errors do to samples; nuisances need it, each of which is a family of it.
        inflation: how many times as large as the noise variance squared residuals are. Priors count for as much more in
            a cost in units of the noise.
    """

    brdf: Brdf
    channels: int
    blocks: tuple[Block, ...]
    held: Mapping[str, Tensor]
    ties: Mapping[str, str]
    relative: bool = False
    arbitrary: tuple[str, ...] = ()
    pinned: Mapping[int, float] = field(default_factory=dict)
    groups: Groups = field(default_factory=Groups.single)
    calibration: Calibration | None = None
    inflation: float = 1.0

    @classmethod
    def of(
        cls,
        brdf: Brdf,
        channels: int,
        free: Sequence[str],
        held: Mapping[str, Tensor],
        ties: Mapping[str, str],
        *,
        relative: bool = False,
        arbitrary: tuple[str, ...] = (),
    ) -> Problem:
        """The problem in which the parameters `free` of a model are estimated.

        Several gauge parameters stand for one light scale: the first is the block, the others are tied to it.

        Raises:
            ValueError: a parameter of the model is neither free nor held nor tied.
        """
        if missing := [name for name in brdf.declared if name not in {*free, *held, *ties}]:
            raise ValueError(f"neither free nor held nor tied: {', '.join(missing)} of {brdf.expression}.")
        gauges = [name for name in free if brdf.declared[name].role is Role.GAUGE]
        ties = {**ties, **dict.fromkeys(gauges[1:], gauges[0])} if gauges else ties
        blocks = tuple(_parameter(brdf, name, relative) for name in free if name not in gauges[1:])
        return cls(brdf, channels, blocks, held, ties, relative, arbitrary)

    @cached_property
    def free(self) -> tuple[str, ...]:
        """Names of the estimated parameters of the model, in order."""
        return tuple(block.name for block in self._common)

    @cached_property
    def _common(self) -> tuple[Block, ...]:
        """The blocks that all samples touch."""
        return tuple(block for block in self.blocks if block.kind in ("parameter", "light_scale"))

    @cached_property
    def multipliers(self) -> tuple[Block, ...]:
        """The blocks that multiply the radiance."""
        return tuple(block for block in self.blocks if block.kind == "multiplier")

    @cached_property
    def spreads(self) -> dict[str, float]:
        """Standard deviation of each error of the calibration, by the name of its block."""
        return {block.name: block.prior for block in self.nuisances if block.prior is not None}

    @cached_property
    def nuisances(self) -> tuple[Block, ...]:
        """The blocks of errors of the calibration."""
        return tuple(block for block in self.blocks if block.kind == "nuisance")

    def calibrated(
        self, calibration: Calibration, priors: Mapping[str, float], groups: Groups, centred: Collection[str] = ()
    ) -> Problem:
        """The same problem with the errors of a calibration among the unknowns.

        Args:
            calibration: what its errors do to the samples.
            priors: standard deviation of the errors of each family, by name.
            groups: of the samples.
            centred: families whose errors are 0 on average, since something else stands for their mean.

        Raises:
            ValueError: there are multipliers too: errors of a calibration have families for what these stand for.
        """
        if self.multipliers:
            raise ValueError("multipliers and errors of a calibration cannot be estimated together.")
        blocks = (
            nuisance(family, priors[family.name], centred=family.name in centred) for family in calibration.families
        )
        return replace(self, blocks=(*self._common, *blocks), calibration=calibration, groups=groups)

    def with_priors(self, priors: Mapping[str, float]) -> Problem:
        """The same problem with other standard deviations of some blocks, by name."""
        blocks = (replace(block, prior=priors.get(block.name, block.prior)) for block in self.blocks)
        return replace(self, blocks=tuple(blocks))

    def freed(self, names: Sequence[str]) -> Problem:
        """The same problem with some of the held parameters estimated."""
        free = [name for name in self.brdf.declared if name in self.free or name in names]
        held = {name: value for name, value in self.held.items() if name not in names}
        problem = Problem.of(
            self.brdf, self.channels, free, held, self.ties, relative=self.relative, arbitrary=self.arbitrary
        )
        by_name = {block.name: block for block in self.blocks}
        blocks = tuple(by_name.get(block.name, block) for block in problem.blocks)
        rest = (*self.multipliers, *self.nuisances)
        return replace(problem, blocks=(*blocks, *rest), groups=self.groups, calibration=self.calibration)

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

    @cached_property
    def separates(self) -> bool:
        """Whether no column of the model depends on an unknown that is estimated."""
        if self.nuisances:
            return False
        terms = self.brdf.structure.terms
        sources = {self.ties.get(name, name) for term in terms for name in term.column_parameters}
        # A held one with a value per channel makes columns of one per channel.
        return all(name in self.held and self.held[name].numel() == 1 for name in sources)

    def declared(self, name: str) -> Parameter:
        """The declaration of a parameter of the model, or of a block of its calibration."""
        if name in self.brdf.declared:
            return self.brdf.declared[name]
        block = next(block for block in self.blocks if block.name == name)
        if block.kind == "nuisance":
            family = self.family(name)
            return Parameter(block.domain, unit=family.unit, doc=family.doc)
        return Parameter(block.domain, unit="1", doc=f"{name}, relative to what is stated")

    def family(self, name: str) -> Family:
        """The family of errors of the calibration of that name."""
        assert self.calibration is not None
        return next(family for family in self.calibration.families if family.name == name)

    def domain(self, name: str) -> Domain:
        """Of a free or a held parameter."""
        for block in self.blocks:
            if block.name == name:
                return block.domain
        return _parameter(self.brdf, name, self.relative).domain

    @property
    def gauges(self) -> list[str]:
        """Free parameters that stand for the unknown light scale: at most one."""
        return [block.name for block in self.blocks if block.kind == "light_scale"]

    def limited(self, limit: float) -> Problem:
        """The same problem with light scales no lower than the reciprocal of this: facets reflect at most all light."""
        blocks = tuple(
            replace(block, domain=Domain(block.domain.lower, limit)) if block.kind == "light_scale" else block
            for block in self.blocks
        )
        return replace(self, blocks=blocks)

    @property
    def light_scale_limit(self) -> float:
        """Largest value of the gauge: see `limited`."""
        return min((self.domain(name).upper for name in self.gauges), default=math.inf)

    def quantity(self, name: str) -> Derived | None:
        """The derived quantity that is all that can be known of a parameter, one beside it being arbitrary; or None."""
        for path, names in self.brdf.structure.derived.items():
            if name in names and name not in self.arbitrary and {*names} & {*self.arbitrary}:
                return self.brdf.derived[path]
        return None

    def limit_of_gauges(self, unknowns: Tensor) -> float:
        """The largest gauge with which no facet reflects more than all light: 1 / (brightest albedo beside it)."""
        values = self.values(unknowns)
        gauges = {Factor(name) for name in self.brdf.declared if self.ties.get(name, name) in self.gauges}
        beside = {factor for product in self.brdf.structure.products if {*product} & gauges for factor in product}
        brightest = max((float(factor.value(values).max()) for factor in beside - gauges), default=0.0)
        return 1 / max(brightest, 1e-9)

    def count(self, name: str) -> int:
        """Number of unknowns of a parameter: one, or one per channel."""
        return self.channels if self.declared(name).per_channel else 1

    def _length(self, block: Block) -> int:
        if block.axis == "one":
            return 1
        if block.axis == "family":
            return self.family(block.name).count
        return self.channels if block.axis == "channel" else self.groups.count(block.axis)

    @cached_property
    def where(self) -> dict[str, slice]:
        """The place of every block in u."""
        places, start = {}, 0
        for block in self.blocks:
            places[block.name] = slice(start, start + self._length(block))
            start += self._length(block)
        return places

    @cached_property
    def size(self) -> int:
        return sum(self._length(block) for block in self.blocks)

    @cached_property
    def labels(self) -> list[str]:
        """A name for every unknown: `sigma`, `albedo[0]`."""
        return [
            block.name if self._length(block) == 1 else f"{block.name}[{index}]"
            for block in self.blocks
            for index in range(self._length(block))
        ]

    @cached_property
    def lower(self) -> Tensor:
        return self._every([block.domain.lower for block in self.blocks], pinned=True)

    @cached_property
    def upper(self) -> Tensor:
        return self._every([block.domain.upper for block in self.blocks], pinned=True)

    @cached_property
    def anywhere(self) -> Tensor:
        """Some unknowns u [P] inside their domains."""
        return self._every([block.start for block in self.blocks])

    def _every(self, of_block: Sequence[float], *, pinned: bool = False) -> Tensor:
        """A number for every block, repeated for its unknowns [P]."""
        pairs = zip(of_block, self.blocks, strict=True)
        repeated = [number for number, block in pairs for _ in range(self._length(block))]
        for position, value in self.pinned.items() if pinned else ():
            repeated[position] = value
        return torch.tensor(repeated, dtype=torch.float64)

    @cached_property
    def selectors(self) -> Tensor:
        """0/1 matrices [C, Q, S]: which of the S unknowns common to all samples is each of the Q parameters."""
        shared = sum(self._length(block) for block in self._common)
        out = torch.zeros(self.channels, len(self.free), shared, dtype=torch.float64)
        for row, name in enumerate(self.free):
            place = self.where[name]
            for channel in range(self.channels):
                out[channel, row, place.start + (channel if place.stop - place.start > 1 else 0)] = 1
        return out

    @cached_property
    def places(self) -> Tensor:
        """Positions in u of the unknowns that samples of each group touch: common ones and their own [G, Q]."""
        shared = torch.arange(self.selectors.shape[-1]).expand(len(self.groups.image), -1)
        own = self.nuisance_places if self.nuisances else self._multiplier_places
        return torch.cat([shared, own], dim=1)

    @cached_property
    def nuisance_places(self) -> Tensor:
        """Positions in u of the errors of the calibration that samples of each group touch [G, Σq]."""
        places = [self.where[block.name].start + self.family(block.name).places for block in self.nuisances]
        return torch.cat(places, dim=1)

    @cached_property
    def _multiplier_places(self) -> Tensor:
        """Positions in u of the M multipliers of each group [G, M]."""
        places = [
            self.where[block.name].start + self.groups.along(block.axis)
            for block in self.multipliers
            if block.axis != "one" and block.axis != "channel" and block.axis != "family"
        ]
        return torch.stack(places, dim=1)

    def multiplied(self, unknowns: Tensor) -> Multiplier | None:
        """What multiplies the radiance of each group; None: 1 throughout."""
        if not self.multipliers:
            return None
        parts = unknowns[self._multiplier_places]
        others = ~torch.eye(parts.shape[1], dtype=torch.bool)
        return Multiplier(parts.prod(1), torch.stack([parts[:, row].prod(1) for row in others], dim=1))

    def prior_terms(self, unknowns: Tensor) -> PriorTerms | None:
        """The terms of the priors at u [P]; None where every block's is flat."""
        if all(block.prior is None for block in self.blocks):
            return None
        return PriorTerms(self.inflation * self.prior_precision, self.anywhere - unknowns)

    @cached_property
    def prior_precision(self) -> Tensor:
        """Inverse covariance of the priors [P, P]."""
        precision = self._every([0.0 if block.prior is None else block.prior**-2 for block in self.blocks]).diag()
        for block in self.blocks:
            if block.centred and block.prior is not None:
                place, count = self.where[block.name], self._length(block)
                precision[place, place] += (_CENTRED * block.prior * count) ** -2
        return precision

    def values(self, unknowns: Tensor) -> dict[str, Tensor]:
        """Every parameter's value: a scalar, or [C]."""
        values = dict(self.held)
        for name in self.free:
            place = self.where[name]
            values[name] = unknowns[place] if place.stop - place.start > 1 else unknowns[place.start]
        values.update({name: values[source] for name, source in self.ties.items()})
        return values

    def unknowns_at(self, values: Mapping[str, Tensor]) -> Tensor:
        """u [P] from the value (a scalar, or [C]) of every free parameter; other blocks at their start."""
        out = self.anywhere.clone()
        for name in self.free:
            out[self.where[name]] = torch.as_tensor(values[name], dtype=torch.float64)
        return out

    def wrapped(self, unknowns: Tensor) -> Tensor:
        """The same unknowns with periodic ones inside their domain."""
        out = unknowns.clone()
        for name in self.free:
            declared, place = self.declared(name), self.where[name]
            if declared.periodic:
                out[place] = declared.domain.lower + (out[place] - declared.domain.lower) % declared.domain.width
        return out

    def ordered(self, unknowns: Tensor) -> Tensor:
        """The same material with lobes in their order, where nothing that is held or tied tells them apart."""
        ordered = self.material(unknowns).ordered.parameters
        out = unknowns.clone()
        for name in self.free:
            out[self.where[name]] = ordered[name]
        is_same_material = all(
            torch.allclose(torch.as_tensor(value), ordered[name]) for name, value in self.values(out).items()
        )
        return out if is_same_material else unknowns

    def material(self, unknowns: Tensor) -> Brdf:
        return self.brdf.replace(self.values(unknowns))


def _parameter(brdf: Brdf, name: str, relative: bool) -> Block:
    """The block of a parameter of a model."""
    declared = brdf.declared[name]
    domain = declared.domain
    if declared.periodic:
        domain = Domain(-math.inf, math.inf)
    elif declared.role is Role.GAUGE:
        domain = Domain(domain.lower, math.inf)
    elif relative and name in brdf.structure.scales:
        domain = domain.lifted()
    kind: Kind = "light_scale" if declared.role is Role.GAUGE else "parameter"
    return Block(name, domain, "channel" if declared.per_channel else "one", kind)
