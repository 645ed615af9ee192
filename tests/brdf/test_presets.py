"""Named materials of the papers."""

from __future__ import annotations

import importlib.util
import math

import pytest
import torch

from matest.brdf import PRESETS, Brdf, Sum, preset
from matest.errors import InputError
from tests.sampling import random_pairs

METALS = pytest.mark.skipif(importlib.util.find_spec("mitsuba") is None, reason="optical constants are not installed")


def built(name: str) -> Brdf:
    return preset(name, 0.05) if PRESETS[name].needs_f0 else preset(name)


@METALS
@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_reflects_some_light(name: str) -> None:
    values = built(name)(*random_pairs(50, seed=1))
    assert values.isfinite().all()
    assert (values[1::2] > 0).all()


@pytest.mark.parametrize(("name", "sigma", "albedo", "sheen"), [("foam", 20, 0.80, 0.019), ("towel", 42, 0.75, 0.085)])
def test_foam_and_towel_have_one_slope_for_body_and_surface(name: str, sigma: int, albedo: float, sheen: float) -> None:
    brdf = preset(name)
    assert isinstance(brdf, Sum)
    values = {path: value.item() for path, value in brdf.parameters.items()}
    assert values["oren-nayar.sigma"] == values["torrance-sparrow.sigma"] == math.radians(sigma)
    assert (values["oren-nayar.albedo"], values["torrance-sparrow.specular"]) == (albedo, sheen)


@METALS
def test_the_copper_vase_is_copper_at_normal_incidence_and_white_at_grazing() -> None:
    brdf = preset("copper-vase")
    assert brdf.parameters["f0"].tolist() == pytest.approx([0.955, 0.638, 0.538], abs=5e-4)
    assert brdf.parameters["weight_2"].item() == 0.6
    normal = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
    face = brdf(normal, normal)
    assert (face / face[0]).tolist() == pytest.approx([1, 0.6677, 0.5633], abs=1e-3)
    grazing = torch.tensor([math.cos(1e-3), 0.0, math.sin(1e-3)], dtype=torch.float64)
    away = grazing * torch.tensor([-1.0, 1.0, 1.0], dtype=torch.float64)
    mirrored = brdf(grazing, away)
    assert (mirrored / mirrored[0]).min().item() > 0.95


def test_nonmetals_are_as_bright_inside_as_their_surface_at_normal_incidence() -> None:
    brdf = preset("rubber", [0.05, 0.06, 0.07])
    assert brdf.parameters["diffuse"].tolist() == brdf.parameters["f0"].tolist() == [0.05, 0.06, 0.07]
    assert (brdf.parameters["specular"].item(), brdf.parameters["slope"].item()) == (0.4, 0.3)


def test_a_nonmetal_needs_its_reflectance() -> None:
    with pytest.raises(InputError, match="'rust' needs f0"):
        preset("rust")


def test_a_known_reflectance_cannot_be_given_again() -> None:
    with pytest.raises(InputError, match="leave out f0"):
        preset("plaster", 0.04)


def test_an_unknown_preset_names_the_nearest() -> None:
    with pytest.raises(InputError, match="foam"):
        preset("foan")
