"""The layout of unknowns, ties, and domains."""

from __future__ import annotations

import math

import pytest
import torch

from tests.problems import ordinary, problem

TIE = {"torrance-sparrow.sigma": "oren-nayar.sigma"}


def test_albedo_has_one_unknown_per_channel_and_sigma_one() -> None:
    chosen = problem("oren-nayar", channels=3)
    assert chosen.free == ("albedo", "sigma")
    assert chosen.where == {"albedo": slice(0, 3), "sigma": slice(3, 4)}
    assert chosen.labels == ["albedo[0]", "albedo[1]", "albedo[2]", "sigma"]
    assert chosen.size == 4


def test_one_channel_is_labelled_without_a_number() -> None:
    assert problem("oren-nayar").labels == ["albedo", "sigma"]


def test_unknowns_of_a_sum_are_named_by_path() -> None:
    chosen = problem("lambert+torrance-sparrow")
    assert chosen.labels == ["lambert.albedo", "torrance-sparrow.specular", "torrance-sparrow.sigma"]


@pytest.mark.parametrize(
    ("expression", "amplitudes", "shapes"),
    [
        ("lambert", ("albedo",), ()),
        ("oren-nayar", ("albedo",), ("sigma",)),
        ("cook-torrance", ("diffuse", "specular"), ("slope",)),
        (
            "oren-nayar+torrance-sparrow",
            ("oren-nayar.albedo", "torrance-sparrow.specular"),
            ("oren-nayar.sigma", "torrance-sparrow.sigma"),
        ),
    ],
)
def test_parameters_divide_into_amplitudes_and_shapes(
    expression: str, amplitudes: tuple[str, ...], shapes: tuple[str, ...]
) -> None:
    chosen = problem(expression)
    assert chosen.amplitudes == amplitudes
    assert chosen.shapes == shapes


def test_a_tied_shape_is_one_unknown_with_two_places() -> None:
    chosen = problem("oren-nayar+torrance-sparrow", channels=3, tie=TIE)
    assert chosen.shapes == ("oren-nayar.sigma",)
    values = chosen.values(torch.arange(7.0, dtype=torch.float64))
    assert values["torrance-sparrow.sigma"] == values["oren-nayar.sigma"] == 3


def test_an_amplitude_that_others_are_tied_to_stays_an_amplitude() -> None:
    chosen = problem("lambert+torrance-sparrow", tie={"lambert.albedo": "torrance-sparrow.specular"})
    assert chosen.amplitudes == ("torrance-sparrow.specular",)
    assert chosen.shapes == ("torrance-sparrow.sigma",)


def test_material_carries_the_unknowns_and_the_held_values() -> None:
    chosen = problem("cook-torrance(masking=smith)", channels=3, fix={"specular": 0.25})
    unknowns = torch.tensor([0.1, 0.2, 0.3, 0.4], dtype=torch.float64)
    material = chosen.material(unknowns)
    assert material.expression == "cook-torrance(masking=smith)"
    assert {name: value.tolist() for name, value in material.parameters.items()} == {
        "diffuse": [0.1, 0.2, 0.3],
        "specular": 0.25,
        "slope": 0.4,
        "f0": 0.04,
    }


@pytest.mark.parametrize("tie", [{}, TIE])
def test_selectors_pick_each_channels_own_values(tie: dict[str, str]) -> None:
    chosen = problem("oren-nayar+torrance-sparrow", channels=3, tie=tie)
    unknowns = ordinary(chosen, seed=1)
    values = chosen.values(unknowns)
    for channel in range(3):
        picked = chosen.selectors[channel] @ unknowns
        expected = [values[name].expand(3)[channel] for name in chosen.free]
        assert torch.equal(picked, torch.stack(expected))


def test_every_unknown_is_selected_somewhere() -> None:
    chosen = problem("lambert+cook-torrance", channels=3, free=("f0",))
    assert bool((chosen.selectors.sum((0, 1)) >= 1).all())
    assert bool((chosen.selectors.sum(2) == 1).all())


def test_absolute_radiometry_bounds_albedo_by_one_and_holds_the_gauge_at_one() -> None:
    chosen = problem("oren-nayar", channels=3)
    assert chosen.gauges == []
    assert chosen.held["interreflection"] == 1
    assert chosen.lower.tolist() == [0, 0, 0, 0]
    assert chosen.upper.tolist() == [1, 1, 1, math.pi / 2]


def test_relative_radiometry_lifts_only_albedo_like_bounds() -> None:
    chosen = problem("cook-torrance", channels=3, relative=True, free=("f0",))
    assert chosen.lower.tolist() == [0] * 6 + [1e-3, 0]
    assert chosen.upper.tolist() == [math.inf] * 6 + [1, 1]


def test_relative_radiometry_frees_the_gauge_up_to_its_limit() -> None:
    chosen = problem("oren-nayar", relative=True).limited(1.6)
    assert chosen.gauges == ["interreflection"]
    assert chosen.upper.tolist() == [math.inf, math.pi / 2, 1.6]
    assert chosen.lower.tolist() == [0, 0, 0]


def test_a_gauge_that_is_fixed_is_not_free() -> None:
    chosen = problem("oren-nayar", relative=True, fix={"interreflection": 0.0})
    assert chosen.gauges == []
    assert chosen.free == ("albedo", "sigma")


def test_a_problem_without_unknowns_has_empty_vectors() -> None:
    chosen = problem("lambert", fix={"albedo": 0.3})
    assert chosen.size == 0
    assert chosen.lower.shape == chosen.upper.shape == (0,)
    assert chosen.selectors.shape == (1, 0, 0)
