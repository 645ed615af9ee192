"""What every model does with its parameters, and sums of models."""

from __future__ import annotations

import math
from typing import Any

import pytest
import torch

from matest.brdf import (
    MODELS,
    CookTorrance,
    Lambert,
    OrenNayar,
    OrenNayarExact,
    OrenNayarSingleSlope,
    Sum,
    TorranceSparrow,
    variants,
)
from matest.brdf.terms import Factor
from matest.directions import Directions
from matest.errors import InputError
from matest.parameters import Parameter, options_of, parameters_of, unit_interval
from tests import tolerances
from tests.sampling import draw, named, random_pairs

BODY_AND_LOBE = Lambert(0.4) + TorranceSparrow(0.05, 0.2)

LAWS, PARTS = ("printed", "corrected"), ("", "-directional", "-forward", "-coherent")


def test_sum_is_the_sum_of_its_values() -> None:
    pairs = random_pairs(50, seed=1)
    torch.testing.assert_close(BODY_AND_LOBE(*pairs), Lambert(0.4)(*pairs) + TorranceSparrow(0.05, 0.2)(*pairs))


def test_sums_of_sums_are_flat() -> None:
    three = BODY_AND_LOBE + CookTorrance(diffuse=0.0)
    assert isinstance(three, Sum)
    assert three.expression == "lambert+torrance-sparrow+cook-torrance"
    assert (CookTorrance() + BODY_AND_LOBE).expression == "cook-torrance+lambert+torrance-sparrow"


def test_parameters_of_a_sum_are_named_by_path() -> None:
    assert list(BODY_AND_LOBE.parameters) == ["lambert.albedo", "torrance-sparrow.specular", "torrance-sparrow.sigma"]
    assert list(BODY_AND_LOBE.declared) == list(BODY_AND_LOBE.parameters)
    assert BODY_AND_LOBE.parameters["torrance-sparrow.sigma"].item() == 0.2


def test_replace_changes_what_it_names_and_nothing_else() -> None:
    changed = BODY_AND_LOBE.replace({"torrance-sparrow.sigma": 0.5})
    assert {name: value.item() for name, value in changed.parameters.items()} == {
        "lambert.albedo": 0.4,
        "torrance-sparrow.specular": 0.05,
        "torrance-sparrow.sigma": 0.5,
    }
    assert BODY_AND_LOBE.parameters["torrance-sparrow.sigma"].item() == 0.2


def test_replace_keeps_options() -> None:
    smith = CookTorrance(masking="smith")
    assert smith.replace({"slope": 0.3}).expression == "cook-torrance(masking=smith)"


def test_unknown_component_names_the_nearest() -> None:
    with pytest.raises(InputError, match=r"no component 'lambrt' .* did you mean 'lambert'\?"):
        BODY_AND_LOBE.replace({"lambrt.albedo": 0.5})


def test_a_model_enters_a_sum_once() -> None:
    with pytest.raises(InputError, match="repeats lambert"):
        _ = BODY_AND_LOBE + Lambert(0.1)


@pytest.mark.parametrize("albedo", [-0.1, 1.1, float("nan"), float("inf"), [0.2, 0.5, 1.2]])
def test_numbers_outside_the_domain_are_refused(albedo: Any) -> None:
    with pytest.raises(InputError, match=r"lambert: albedo must lie in \[0, 1\]; got"):
        Lambert(albedo)


def test_degrees_are_recognised_as_a_mistake() -> None:
    with pytest.raises(InputError, match="Angles are in radians"):
        OrenNayar(0.5, 30.0)


@pytest.mark.parametrize("albedo", ["bright", None, {"red": 0.5}, [[0.1], [0.2, 0.3]]])
def test_what_is_no_number_is_refused(albedo: Any) -> None:
    with pytest.raises(InputError, match="lambert: albedo must be a number"):
        Lambert(albedo)


@pytest.mark.parametrize("albedo", [0, 1, 0.5, [0.1, 0.2, 0.3]])
def test_numbers_become_float64_tensors(albedo: Any) -> None:
    assert Lambert(albedo).albedo.dtype == torch.float64
    assert Lambert(albedo).albedo.tolist() == albedo


def test_tensors_are_taken_as_they_are() -> None:
    albedo = torch.tensor([0.5, 1.5], requires_grad=True)
    assert Lambert(albedo).albedo is albedo


def test_derivatives_reach_tensors_of_another_precision() -> None:
    albedo = torch.tensor(0.5, dtype=torch.float64, requires_grad=True)
    wi, wo = (vector.float() for vector in random_pairs(10, seed=2))
    Lambert(albedo)(wi, wo).sum().backward()
    assert albedo.grad is not None
    assert albedo.grad.item() == pytest.approx(10 / torch.pi, rel=1e-6)


def test_models_are_immutable() -> None:
    with pytest.raises(AttributeError):
        Lambert(0.5).albedo = torch.tensor(0.6)  # type: ignore[misc]


def test_direction_batches_broadcast_against_each_other() -> None:
    wi, wo = random_pairs(12, seed=3)
    grid = BODY_AND_LOBE(wi[:4, None], wo[None, :5])
    assert grid.shape == (4, 5, 1)
    torch.testing.assert_close(grid[2, 3], BODY_AND_LOBE(wi[2], wo[3]))


@pytest.mark.parametrize("shape", [(), (3,), (20, 1), (20, 3)])
@pytest.mark.parametrize("expression", variants())
def test_columns_depend_on_directions_and_weights_on_parameters(expression: str, shape: tuple[int, ...]) -> None:
    directions, elsewhere = Directions(*random_pairs(20, seed=5)), Directions(*random_pairs(20, seed=6))
    one, other = draw(named(expression), shape, seed=7), draw(named(expression), shape, seed=8)
    for term, moved, changed in zip(one.terms(directions), one.terms(elsewhere), other.terms(directions), strict=True):
        assert (term.columns is None) == (term.weights is None)
        if term.columns is not None and term.weights is not None:
            torch.testing.assert_close(term.columns, changed.columns, rtol=0, atol=0)
            torch.testing.assert_close(term.weights, moved.weights, rtol=0, atol=0)
            whole = (term.columns[:, None, :] * term.weights).sum(-1)
            torch.testing.assert_close(term.shape.expand_as(whole), whole)


def test_models_whose_parameters_separate_say_so() -> None:
    nothing = Directions(*random_pairs(2, seed=9))
    separate = {name for name, kind in MODELS.items() if all(t.columns is not None for t in kind().terms(nothing))}
    assert {"oren-nayar", "oren-nayar-qualitative", "oren-nayar-exact", "fujii"} <= separate


def test_only_parallel_grooves_are_anisotropic() -> None:
    anisotropic = {expression for expression in variants() if named(expression).structure.anisotropic}
    assert anisotropic == {
        "oren-nayar-single-slope",
        "ward(anisotropy=axes)",
        *(
            f"li-torrance{part}(anisotropy={law})"
            for part in ("", "-directional", "-forward", "-coherent")
            for law in LAWS
        ),
    }
    assert (OrenNayarSingleSlope() + TorranceSparrow()).structure.anisotropic
    assert not (OrenNayarExact() + TorranceSparrow()).structure.anisotropic


# Inherited from the rough surface, which these combinations do not see.
WITHOUT_EFFECT = {
    "li-torrance(directional=off)": ("height_rms", "correlation_length"),
    "li-torrance-coherent(masking=off)": ("correlation_length",),
}


# At the roughness drawn, the S of mirror-like light is 1 to rounding whatever the azimuth.
@pytest.mark.parametrize("expression", [e for e in variants() if "coherent(anisotropy" not in e])
def test_isotropic_models_do_not_see_the_frame_turn(expression: str) -> None:
    brdf = draw(named(expression), (1,), seed=10)
    wi, wo = random_pairs(50, seed=13, most=1.3)
    cos, sin = math.cos(0.7), math.sin(0.7)
    turn = torch.tensor([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]], dtype=torch.float64)
    same = torch.allclose(brdf(wi, wo), brdf(wi @ turn.T, wo @ turn.T), rtol=1e-9, atol=tolerances.UNDERFLOW)
    assert same != brdf.structure.anisotropic


def test_conditional_parameters_follow_the_options() -> None:
    declared = Parameter(
        unit_interval,
        "1",
        "",
        when={"fresnel": ("schlick", "conductor")},
        variants=(({"fresnel": ("conductor",)}, {"per_channel": True}),),
    )
    assert declared.under({"fresnel": "dielectric", "lobes": "1"}) is None
    plain, coloured = (declared.under({"fresnel": chosen, "lobes": "1"}) for chosen in ("schlick", "conductor"))
    assert plain is not None
    assert coloured is not None
    assert not plain.per_channel
    assert coloured.per_channel


@pytest.mark.parametrize("expression", variants())
def test_every_declared_parameter_changes_the_model(expression: str) -> None:
    brdf = draw(named(expression), (1,), seed=11)
    pairs = random_pairs(200, seed=12)
    before = brdf(*pairs)
    for name, declared in brdf.declared.items():
        if name in WITHOUT_EFFECT.get(expression, ()):
            continue
        value = brdf.parameters[name] + 0.05 * min(declared.domain.width, 1.0)
        after = brdf.replace({name: value})(*pairs)
        assert not torch.allclose(before, after, rtol=1e-6, atol=0), name


def test_conditions_name_options_and_choices_that_exist() -> None:
    for kind in MODELS.values():
        choices = options_of(kind)
        conditions = [
            condition
            for declared in parameters_of(kind).values()
            for condition in (declared.when, *(conditions for conditions, _ in declared.variants))
        ]
        excluded = [{key: (value,) for key, value in combination.items()} for combination, _ in kind.excluded]
        for condition in [*conditions, *excluded]:
            for option, values in condition.items():
                assert {*values} <= {*choices[option]}


def test_excluded_choices_are_refused_with_their_reason_and_alone_are_not() -> None:
    combination, reason = CookTorrance.excluded[0]
    with pytest.raises(InputError) as refused:
        CookTorrance(**combination)
    assert str(refused.value) == f"cook-torrance: {reason}"
    for option, choice in combination.items():
        assert CookTorrance(**{option: choice}).expression == f"cook-torrance({option}={choice})"


def test_a_separated_model_in_a_sum_keeps_its_columns() -> None:
    directions = Directions(*random_pairs(4, seed=13))
    alone, summed = (brdf.terms(directions)[0] for brdf in (OrenNayar(), OrenNayar() + TorranceSparrow()))
    assert summed.factors == (Factor("oren-nayar.albedo"),)
    assert alone.columns is not None
    torch.testing.assert_close(summed.columns, alone.columns)
    torch.testing.assert_close(summed.weights, alone.weights)
