"""What depends on what in a model."""

from __future__ import annotations

import inspect
import math
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import pytest
import torch
from torch import Tensor

from matest.brdf import Brdf, Term, TorranceSparrow, variants
from matest.brdf.terms import Factor, complement_of, mixture
from matest.directions import Directions
from matest.parameters import option, parameter, unit_interval
from tests.brdf.test_base import WITHOUT_EFFECT
from tests.sampling import named, random_pairs

TURN = 0.7


@dataclass(frozen=True, eq=False)
class Hidden(Brdf):
    """A lobe that vanishes at every pair of directions but those exactly forward, clamped to a floor."""

    strength: Tensor = parameter(unit_interval, unit="1", doc="", default=0.5, per_channel=True)
    width: Tensor = parameter(unit_interval, unit="1", doc="", default=0.0)
    spare: Tensor = parameter(unit_interval, unit="1", doc="", default=0.5)
    tint: Tensor = parameter(unit_interval, unit="1", doc="", default=0.5, per_channel=True)
    spared: str = option("false", choices=("false", "true"), doc="")

    name: ClassVar[str] = "hidden"
    source: ClassVar[str] = ""

    def terms(self, directions: Directions) -> tuple[Term, ...]:
        ahead = (-0.999 - directions.tangential).clamp(min=0) * self.width.clamp(min=0.3)
        columns = torch.cat([directions.cos_i, directions.cos_o * self.spare, directions.sin_i], dim=-1)
        weights = torch.stack([self.width, self.width * 0, self.width], dim=-1)
        return (
            Term(("strength",), ahead if self.spared == "false" else ahead * self.spare),
            mixture(("strength", complement_of("tint")), columns, weights),
        )


def test_a_parameter_is_connected_where_its_lobe_vanishes_and_where_it_is_clamped() -> None:
    structure = Hidden().structure
    assert structure.carriers("width") == [(Factor("strength"),), (Factor("strength"), complement_of("tint"))]
    assert [term.shape_parameters for term in structure.terms] == [{"width"}, {"width", "spare"}]


def test_what_an_option_leaves_unused_is_not_connected() -> None:
    assert len(Hidden().structure.carriers("spare")) == 1
    assert len(Hidden(spared="true").structure.carriers("spare")) == 2


def test_columns_of_a_mixture_are_told_from_their_weights() -> None:
    lobe, mixed = Hidden().structure.terms
    assert lobe.column_parameters == lobe.shape_parameters == {"width"}
    assert mixed.column_parameters == {"spare"}
    assert Hidden().structure.columns == [1, 3]


def test_amplitudes_are_the_factors_and_scales_those_used_as_they_are() -> None:
    structure = Hidden().structure
    assert structure.amplitudes == {"strength", "tint"}
    assert structure.scales == {"strength"}


def test_structure_is_worked_out_once_per_class_and_options() -> None:
    assert Hidden(0.3).structure is Hidden(0.4).structure
    assert Hidden().structure is not Hidden(spared="true").structure


def test_structure_of_a_sum_is_that_of_its_parts_by_path() -> None:
    summed = Hidden() + TorranceSparrow()
    assert summed.structure.products[-1] == (Factor("torrance-sparrow.specular"),)
    assert summed.structure.terms[0].shape_parameters == {"hidden.width"}
    assert summed.structure.scales == {"hidden.strength", "torrance-sparrow.specular"}
    assert summed.structure.products == [term.factors for term in summed.terms(Directions(*random_pairs(2, seed=1)))]


@pytest.mark.parametrize("expression", variants())
def test_no_parameter_both_multiplies_and_shapes(expression: str) -> None:
    structure = named(expression).structure
    assert not structure.amplitudes & {name for term in structure.terms for name in term.shape_parameters}


@pytest.mark.parametrize("expression", variants())
def test_parameters_without_effect_are_those_that_nothing_is_connected_to(expression: str) -> None:
    brdf, structure = named(expression), named(expression).structure
    idle = {name for name in brdf.declared if name not in structure.amplitudes and not structure.carriers(name)}
    assert idle == {*WITHOUT_EFFECT.get(expression, ())}


def quantities() -> list[str]:
    """Everything that models can ask of directions."""
    public = {name: member for name, member in vars(Directions).items() if not name.startswith("_")}
    assert all(isinstance(m, property | cached_property) or inspect.isfunction(m) for m in public.values())
    return list(public)


def asked(directions: Directions, quantity: str) -> Tensor:
    found = getattr(directions, quantity)
    found = found(torch.tensor(0.2, dtype=torch.float64)) if callable(found) else found
    parts = found if isinstance(found, tuple) else (found,)
    return torch.cat([part + k * part.square() for k, part in enumerate(parts)], dim=-1)


@pytest.mark.parametrize("quantity", quantities())
def test_what_hangs_on_the_azimuth_itself_is_anisotropic_and_nothing_else(quantity: str) -> None:
    @dataclass(frozen=True, eq=False)
    class Probe(Brdf):
        name: ClassVar[str] = "probe"
        source: ClassVar[str] = ""

        def terms(self, directions: Directions) -> tuple[Term, ...]:
            return (Term((), asked(directions, quantity).sum(-1, keepdim=True)),)

    wi, wo = random_pairs(20, seed=3)
    cos, sin = math.cos(TURN), math.sin(TURN)
    turn = torch.tensor([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]], dtype=torch.float64)
    here, there = asked(Directions(wi, wo), quantity), asked(Directions(wi @ turn, wo @ turn), quantity)
    assert Probe().structure.anisotropic != torch.allclose(here, there, rtol=1e-9, atol=1e-12)
