"""What every model does with its parameters, and sums of models."""

from __future__ import annotations

from typing import Any

import pytest
import torch

from matest.brdf import CookTorrance, Lambert, OrenNayar, Sum, TorranceSparrow
from matest.errors import InputError
from tests.sampling import random_pairs

BODY_AND_LOBE = Lambert(0.4) + TorranceSparrow(0.05, 0.2)


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
    with pytest.raises(InputError, match=r"lambert: albedo must lie in \[0, 1\] 1; got"):
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
