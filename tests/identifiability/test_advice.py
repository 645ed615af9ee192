"""The advice for one more photograph, against photographs taken as advised."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch

import matest
from matest.brdf import Lambert, model
from matest.estimation.options import Options
from matest.estimation.specification import specify
from matest.identifiability import Check, check
from matest.identifiability.advice import advise
from matest.identifiability.forecast import Forecast, as_estimated, predicted_samples
from matest.identifiability.nominal import Nominal
from matest.photographs.noise import Noise
from matest.scene import DirectionalLight
from tests.captures import directional
from tests.identifiability.subjects import FIXED, VALUES, checked, photograph, studio
from tests.simulated import Studio


@cache
def frontal(name: str) -> tuple[Studio, Check]:
    where = studio([(0, 0, 1)])
    return where, checked(photograph(where, name, 1), name, at=VALUES[name])


@pytest.mark.parametrize("name", ["oren-nayar", "cook-torrance"])
def test_adding_the_advised_light_to_a_frontal_one_brings_what_was_predicted(name: str) -> None:
    where, advice = frontal(name)
    light = advice.light
    assert light is not None
    assert light.worst[1] < 0.8 * light.worst[0]
    both = Studio(size=48, lights=(*where.lights, (directional(light.direction, *light.irradiance),)))
    before, after = (matest.estimate(photograph(s, name, 1), name, fix=FIXED[name]).parameters for s in (where, both))
    for parameter, gain in light.gain.items():
        brought = np.ravel(before[parameter].std) / np.ravel(after[parameter].std)
        assert gain == pytest.approx(float(brought[0]), rel=0.2)


def test_the_advice_tells_what_is_estimated_once_the_light_determines_it() -> None:
    where = Studio(size=80, lights=((directional((0.0, 0.0, 1.0), 3.0),),), noise=Noise(0.001, 0.0001))
    glossy = {"diffuse": 0.3, "specular": 0.8, "slope": 0.1}
    material = model("cook-torrance")[0].replace({name: torch.tensor(value) for name, value in glossy.items()})
    light = check(where.photograph(material, 1), "cook-torrance", at=glossy).light
    assert light is not None
    assert light.frees == ["f0"]
    assert set(light.freed) == {*glossy, "f0"}
    both = replace(where, lights=(*where.lights, (directional(light.direction, *light.irradiance),)))
    found = [matest.estimate(both.photograph(material, seed), "cook-torrance").parameters for seed in range(3)]
    for name, std in light.freed.items():
        # Errors go with the square of f0, which these images know to a tenth.
        brought = np.median([np.ravel(estimate[name].std)[0] for estimate in found])
        assert np.ravel(std)[0] == pytest.approx(brought, rel=0.4)
    # With f0 said there is nothing to free.
    held = check(where.photograph(material, 1), "cook-torrance", at=glossy, fix={"f0": 0.04}).light
    assert held is not None
    assert (held.frees, held.freed) == ([], {})


def test_no_other_direction_does_much_better_than_the_advised_one() -> None:
    where, advice = frontal("oren-nayar")
    assert advice.light is not None
    for direction in ((0.6, 0, 0.8), (0, 0.9, 0.44), (-0.5, -0.5, 0.7), (0, 0, 1)):
        both = Studio(size=48, lights=(*where.lights, (directional(direction, 1.2),)))
        found = matest.estimate(photograph(both, "oren-nayar", 1), "oren-nayar").parameters["sigma"]
        assert advice.light.std["sigma"] < 1.05 * found.std


def test_a_capture_in_the_dark_is_helped_by_any_light() -> None:
    found = check(studio([(0, 0, -1)], size=32).photograph(Lambert(0.5), 1), "oren-nayar")
    for name in ("albedo", "sigma"):
        assert found.parameters[name].reason == "no image has a usable sample"
        assert found.parameters[name].range is None
    assert found.light is not None
    assert found.light.resolves == ["albedo", "sigma"]
    json.dumps(found.to_dict(), allow_nan=False)
    assert any("no usable pixel" in warning for warning in found.warnings)


@pytest.mark.parametrize(("factor", "is_advised"), [(1.0, False), (2.0, True)])
def test_a_light_is_advised_only_if_it_lowers_the_largest_error(
    factor: float, is_advised: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    where = studio([(0, 0, 1)], size=32)
    photographs = where.photograph(Lambert(0.5), 1).photographs
    nominal = Nominal.of(specify("oren-nayar", Options(), channels=1, relative=False), {}, {})
    samples = predicted_samples(photographs, nominal.problem, nominal.unknowns)
    before, _ = as_estimated(samples, nominal)

    def suggest(*_: object) -> tuple[DirectionalLight, Forecast]:
        return where.lights[0][0], replace(before, information=factor * before.information)

    monkeypatch.setattr("matest.identifiability.advice.next_light", suggest)
    assert (advise(samples, nominal, before) is not None) == is_advised
