"""From photographs of a sphere under six lights, the parameters of every model come back within their error bars."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

import matest
from matest.brdf import model
from matest.photographs.noise import Noise
from tests.captures import directional
from tests.simulated import CAMERA, DIRECTIONS, Studio

# A quarter of the usual noise variance on a small sphere: as narrow error bars as a larger one has.
STUDIO = Studio(
    size=32,
    lights=tuple((directional(towards, 3.0, 3.0, 3.0),) for towards in DIRECTIONS),
    noise=Noise(CAMERA.read / 2, CAMERA.gain / 4),
)
BODY = {"albedo": [0.7, 0.5, 0.3]}
GLOSS = {"diffuse": [0.4, 0.2, 0.1], "specular": 0.8, "slope": 0.2, "f0": 0.04}
METAL = {"diffuse": 0.0, "specular": 1.0}
COPPER = [0.95, 0.64, 0.54]

CASES: dict[str, dict[str, object]] = {
    "oren-nayar-exact(nodes=16x16)": BODY | {"sigma": 0.5},
    "oren-nayar-single-slope": BODY | {"facet_angle": 0.5, "azimuth": 0.7},
    "oren-nayar-single-slope(isotropic=true)": BODY | {"facet_angle": 0.5},
    "fujii": BODY | {"sigma": 0.5},
    "eon": BODY | {"diffuse_roughness": 0.6},
    "cook-torrance(distribution=gaussian)": GLOSS,
    "cook-torrance(distribution=ggx,masking=smith)": GLOSS,
    "cook-torrance(weights=complementary)": GLOSS,
    "oren-nayar-single-slope(isotropic=false)": BODY | {"facet_angle": 0.5, "azimuth": 3.12},
    "cook-torrance(fresnel=schlick)": METAL | {"slope": 0.2, "f0": COPPER},
    "cook-torrance(fresnel=conductor)": METAL | {"slope": 0.2, "eta": [0.9, 1.2, 1.4], "k": [2.6, 2.2, 2.0]},
    "cook-torrance(lobes=2,fresnel=schlick)": METAL | {"slope": 0.1, "slope_2": 0.4, "weight_2": 0.4, "f0": COPPER},
}


@pytest.mark.parametrize("expression", CASES)
def test_parameters_come_back_within_four_standard_errors(expression: str) -> None:
    values = {name: torch.tensor(value, dtype=torch.float64) for name, value in CASES[expression].items()}
    capture = STUDIO.photograph(model(expression)[0].replace(values), seed=3)
    metal = {"diffuse": 0.0, "specular": 1.0} if METAL.items() <= CASES[expression].items() else {}
    free = ("f0",) if metal and "f0" in values else ()
    found = matest.estimate(capture, expression, fix=metal, free=free)
    assert found.fit.status == "converged"
    assert found.fit.reduced_chi2 == pytest.approx(1, abs=0.03)
    if "lobes=2" in expression and found.parameters["slope"].value > found.parameters["slope_2"].value:
        # The same material with its lobes the other way round.
        values |= {"slope": values["slope_2"], "slope_2": values["slope"], "weight_2": 1 - values["weight_2"]}
    determined = {name: p for name, p in found.parameters.items() if p.status == "determined"}
    assert {*values} - {*metal, "eta", "k"} <= {*determined}
    for name, parameter in determined.items():
        value, std = (torch.as_tensor(x, dtype=torch.float64) for x in (parameter.value, parameter.std))
        assert ((value - values[name]).abs() <= 4 * std).all(), name
        assert (std > 0).all()


def test_a_model_that_is_not_linear_in_its_albedo_needs_the_strength_of_the_lights() -> None:
    capture = replace(STUDIO, relative=True).photograph(model("lambert")[0], seed=1)
    with pytest.raises(matest.InputError, match="irradiance"):
        matest.estimate(capture, "eon")


def test_a_metal_is_found_under_lights_of_unknown_strength() -> None:
    values = {name: torch.tensor(x, dtype=torch.float64) for name, x in (METAL | {"slope": 0.2, "f0": COPPER}).items()}
    brdf = model("cook-torrance(fresnel=schlick)")[0].replace(values)
    capture = replace(STUDIO, relative=True).photograph(brdf, seed=3, brightness=1.3)
    found = matest.estimate(
        capture, "cook-torrance(fresnel=schlick)", fix={"diffuse": 0.0, "f0": COPPER}, free=("specular",)
    )
    slope = found.parameters["slope"]
    assert abs(slope.value - 0.2) < 4 * slope.std
    assert found.parameters["specular"].value == pytest.approx([1.3, 1.3, 1.3], rel=0.01)
