"""Models as modules for a training loop of one's own."""

from __future__ import annotations

import math

import pytest
import torch

from matest.brdf import CookTorrance, Lambert, OrenNayar, TorranceSparrow, variants
from matest.errors import InputError
from matest.training.trainable import Trainable
from tests import tolerances
from tests.sampling import named, random_pairs


@pytest.mark.parametrize("expression", [*variants(), "oren-nayar+torrance-sparrow"])
def test_module_starts_at_the_model_it_was_given(expression: str) -> None:
    brdf = named(expression)
    start = Trainable(brdf, dtype=torch.float64)()
    assert start.expression == expression
    for name, value in brdf.parameters.items():
        at_ends = tolerances.END_OF_DOMAIN * min(brdf.declared[name].domain.width, 10)
        torch.testing.assert_close(start.parameters[name], value, rtol=tolerances.ROUND_TRIP, atol=at_ends)


def test_shapes_are_kept() -> None:
    material = Trainable(OrenNayar([0.2, 0.4, 0.6], torch.full((5, 1), 0.3)))
    assert material().parameters["albedo"].shape == (3,)
    assert material().parameters["sigma"].shape == (5, 1)
    assert material()(*random_pairs(5, seed=1)).shape == (5, 3)


def test_one_step_lowers_the_loss() -> None:
    wi, wo = random_pairs(500, seed=2, most=1.3)
    truth = OrenNayar(0.8, 0.6)(wi, wo)
    material = Trainable(OrenNayar(0.5, 0.3))
    optimiser = torch.optim.SGD(material.parameters(), lr=0.1)
    before = (material()(wi, wo) - truth).square().mean()
    before.backward()
    start = {name: value.item() for name, value in material().parameters.items()}
    optimiser.step()
    assert (material()(wi, wo) - truth).square().mean() < before
    moved = {name for name, value in material().parameters.items() if value.item() != start[name]}
    assert moved == {"albedo", "sigma"}


def test_a_loop_finds_the_truth() -> None:
    wi, wo = random_pairs(500, seed=3, most=1.3)
    truth = OrenNayar(0.8, 0.6)(wi, wo)
    material = Trainable(OrenNayar(0.5, 0.3), dtype=torch.float64)
    optimiser = torch.optim.Adam(material.parameters(), lr=0.05)
    for _ in range(300):
        optimiser.zero_grad()
        (material()(wi, wo) - truth).square().mean().backward()
        optimiser.step()
    assert material().parameters["albedo"].item() == pytest.approx(0.8, rel=1e-3)  # as far as 300 steps come
    assert material().parameters["sigma"].item() == pytest.approx(0.6, rel=1e-3)


@pytest.mark.parametrize("shove", [-1e6, -30.0, 30.0, 1e6])
@pytest.mark.parametrize("expression", [*variants(), "oren-nayar+torrance-sparrow"])
def test_values_stay_in_the_domain_wherever_the_optimiser_goes(expression: str, shove: float) -> None:
    material = Trainable(named(expression))
    with torch.no_grad():
        for raw in material.parameters():
            raw.add_(shove)
    brdf = material()
    for name, declared in brdf.declared.items():
        assert declared.domain.contains(brdf.parameters[name])
    wi, wo = (vector.float() for vector in random_pairs(50, seed=4))
    brdf(wi, wo).sum().backward()
    assert all(raw.grad is None or raw.grad.isfinite().all() for raw in material.parameters())


def test_fixed_parameters_are_left_out() -> None:
    material = Trainable(CookTorrance(), fixed=("f0", "diffuse"))
    assert len(list(material.parameters())) == 2
    assert material().parameters["f0"].item() == 0.04
    assert not material().parameters["f0"].requires_grad


def test_fixed_parameters_must_exist() -> None:
    with pytest.raises(InputError, match=r"did you mean 'sigma'\?"):
        Trainable(OrenNayar(), fixed=("sigmma",))


def test_fixed_parameters_of_a_sum_are_named_by_path() -> None:
    material = Trainable(Lambert(0.5) + TorranceSparrow(0.02, 0.3), fixed=("torrance-sparrow.sigma",))
    trains = {name: value.requires_grad for name, value in material().parameters.items()}
    assert trains == {"lambert.albedo": True, "torrance-sparrow.specular": True, "torrance-sparrow.sigma": False}


def test_light_scale_does_not_train() -> None:
    assert not Trainable(OrenNayar(0.5, 0.3))().parameters["interreflection"].requires_grad


def test_it_says_which_model_it_is_and_what_is_fixed() -> None:
    assert "cook-torrance(distribution=ggx), f0=0.04\n" in repr(
        Trainable(CookTorrance(distribution="ggx"), fixed=("f0",))
    )


def test_state_can_be_saved_and_restored() -> None:
    material, other = Trainable(OrenNayar(0.7, 0.6)), Trainable(OrenNayar(0.1, 0.1))
    other.load_state_dict(material.state_dict())
    for name, value in material().parameters.items():
        torch.testing.assert_close(other().parameters[name], value)


def test_ends_of_the_domain_can_be_left() -> None:
    material = Trainable(OrenNayar(1.0, math.pi / 2))
    material()(*(vector.float() for vector in random_pairs(50, seed=5, most=1.0))).sum().backward()
    for raw in material.parameters():
        assert raw.grad is not None
        assert raw.grad.abs() > 0


def test_albedos_may_be_above_1_beside_lights_of_unknown_strength() -> None:
    brdf = OrenNayar(0.9, 0.3) + TorranceSparrow(0.5, 0.2)
    plain, relative = Trainable(brdf), Trainable(brdf, relative=True)
    for material in (plain, relative):
        for raw in material.values:
            raw.data += 10.0
    kept, lifted = plain().parameters, relative().parameters
    assert max(float(kept[name]) for name in ("oren-nayar.albedo", "torrance-sparrow.specular")) <= 1
    assert min(float(lifted[name]) for name in ("oren-nayar.albedo", "torrance-sparrow.specular")) > 5
    assert float(lifted["oren-nayar.sigma"]) <= math.pi / 2
    assert float(kept["oren-nayar.interreflection"]) == 1
    assert float(lifted["oren-nayar.interreflection"]) > 5
