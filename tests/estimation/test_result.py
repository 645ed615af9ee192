"""The outcome of an estimate and its JSON form."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from matest.brdf import Brdf, CookTorrance, Lambert, OrenNayar, TorranceSparrow
from matest.capture import Capture
from matest.estimation.estimate import estimate
from matest.estimation.result import Estimate, load_material, read_result
from matest.photographs.noise import Noise
from matest.photographs.photometry import Encoding
from tests.captures import changed, directional, refusal
from tests.estimates import FIXED, LOST, SIGMA, clay
from tests.sampling import random_pairs
from tests.simulated import Studio, coloured

PARAMETER = {"value", "std", "interval95", "unit", "status"}
STATES = {"determined", "at bound", "tied", "fixed", "not determined"}
FIT = {"rmse", "relative_rmse", "reduced_chi2", "samples", "samples_used", "iterations", "status"}


def strict(content: object) -> object:
    """What a reader gets that knows no NaN and no infinity."""
    return json.loads(json.dumps(content, allow_nan=False))


def captured(material: Brdf, *, relative: bool = False) -> Capture:
    return Studio(size=32, lights=coloured()[:4], relative=relative).photograph(material, seed=1)


@pytest.fixture(scope="module")
def found() -> Estimate:
    return estimate(captured(OrenNayar([0.7, 0.6, 0.5], 0.5)), "oren-nayar", holdout=[3])


def test_the_schema_is_named() -> None:
    assert clay().to_dict()["schema"] == "matest.estimate/1"


def test_people_read_channels_by_name(found: Estimate) -> None:
    assert found.labels == ["albedo[0]", "albedo[1]", "albedo[2]", "sigma"]
    assert found.label_names == ["albedo R", "albedo G", "albedo B", "sigma"]
    lamps = replace(found, channel_labels=("610 nm", "550 nm", "460 nm"))
    assert lamps.label_names == ["albedo 610 nm", "albedo 550 nm", "albedo 460 nm", "sigma"]


def test_every_key_of_the_contract_is_there() -> None:
    content = clay().to_dict()
    assert set(content) >= {
        "schema",
        "capture",
        "model",
        "parameters",
        "correlation",
        "fit",
        "candidates",
        "skipped",
        "timing_s",
        "holdout",
        "provenance",
        "warnings",
    }
    assert set(content["correlation"]) == {"names", "matrix"}
    assert set(content["fit"]) >= FIT
    assert all(set(parameter) >= PARAMETER for parameter in content["parameters"].values())
    assert all(set(c) >= {"model", "score", "relative_rmse", "reason"} for c in content["candidates"])
    assert set(content["skipped"]) == {"components", "samples", "work"}
    assert set(content["holdout"]) >= {"images", "relative_rmse"}


def test_without_images_left_out_there_is_no_holdout() -> None:
    assert "holdout" not in clay(holdout=None).to_dict()


@pytest.mark.parametrize(("relative", "word"), [(False, "absolute"), (True, "relative")])
def test_radiometry_is_stated(relative: bool, word: str) -> None:
    assert clay(relative=relative).to_dict()["radiometry"] == word


def test_what_is_not_determined_is_null() -> None:
    content = strict(clay(parameters={"specular": LOST, "f0": FIXED, "sigma": SIGMA}).to_dict())
    assert content["parameters"]["specular"]["value"] is None
    assert content["parameters"]["specular"]["std"] is None
    assert content["parameters"]["f0"]["std"] is None
    assert content["parameters"]["sigma"]["value"] == 0.5236


def test_an_estimate_writes_strict_json(found: Estimate) -> None:
    content = strict(found.to_dict())
    assert content["model"] == "oren-nayar"
    named = {"background", "shadowed", "saturated", "rim", "redundant", "unread", "idle", "held_out"}
    assert set(content["skipped"]["samples"]) == named
    assert set(content["timing_s"]) >= {"fit"}
    assert content["holdout"]["images"] == [3]
    assert content["fit"]["status"] == "converged"
    assert content["fit"]["samples_used"] <= content["fit"]["samples"]
    assert all(parameter["status"] in STATES for parameter in content["parameters"].values())


def test_an_estimate_has_a_value_std_and_interval_per_channel(found: Estimate) -> None:
    albedo = found.parameters["albedo"]
    assert len(albedo.value) == len(albedo.std) == len(albedo.interval95) == 3
    for value, std, (low, high) in zip(albedo.value, albedo.std, albedo.interval95, strict=True):
        assert (low, high) == pytest.approx((value - 1.96 * std, value + 1.96 * std), rel=1e-4)
    sigma = found.parameters["sigma"]
    assert isinstance(sigma.value, float)
    assert isinstance(sigma.std, float)


def test_correlation_of_an_estimate_is_named_and_square(found: Estimate) -> None:
    assert found.labels == ["albedo[0]", "albedo[1]", "albedo[2]", "sigma"]
    matrix = torch.tensor(found.correlation)
    assert matrix.shape == (4, 4)
    torch.testing.assert_close(matrix, matrix.T)
    torch.testing.assert_close(matrix.diagonal(), torch.ones(4, dtype=matrix.dtype))


def test_the_gauge_of_relative_radiometry_is_no_parameter_of_an_absolute_estimate(found: Estimate) -> None:
    assert list(found.parameters) == ["albedo", "sigma"]


def test_ties_and_fixed_values_say_so() -> None:
    result = estimate(
        captured(OrenNayar(0.6, 0.4) + TorranceSparrow(0.04, 0.4)),
        "oren-nayar+torrance-sparrow",
        fix={"specular": 0.04},
        tie={"torrance-sparrow.sigma": "oren-nayar.sigma"},
    )
    states = {name: parameter.status for name, parameter in result.parameters.items()}
    assert states == {
        "oren-nayar.albedo": "determined",
        "oren-nayar.sigma": "determined",
        "torrance-sparrow.specular": "fixed",
        "torrance-sparrow.sigma": "tied",
    }
    both = [result.parameters[f"{name}.sigma"] for name in ("oren-nayar", "torrance-sparrow")]
    assert both[0].value == both[1].value
    assert both[0].std == both[1].std


def test_a_parameter_at_its_bound_has_an_interval_and_no_std() -> None:
    result = estimate(captured(Lambert([0.6, 0.5, 0.4])), "lambert", fix={})
    assert result.parameters["albedo"].status == "determined"
    bright = Studio(size=32, lights=coloured()[:4]).photograph(Lambert([0.9, 0.5, 0.4]), seed=2, brightness=1.3)
    albedo = estimate(bright, "lambert").parameters["albedo"]
    assert albedo.status == "at bound"
    assert albedo.value[0] == 1.0
    assert albedo.std[0] is None
    assert albedo.std[1] > 0
    assert albedo.interval95[0][1] == 1.0
    strict(clay(parameters={"albedo": albedo}).to_dict())


def test_a_lobe_that_is_not_there_has_no_width() -> None:
    result = estimate(captured(Lambert(0.6)), "cook-torrance")
    slope = result.parameters["slope"]
    assert slope.status == "not determined"
    assert slope.value is None
    assert slope.std is None
    assert any("slope" in warning for warning in result.warnings)


def test_two_bodies_that_cannot_be_told_apart_are_not_determined() -> None:
    result = estimate(
        captured(Lambert(0.6)), "lambert+cook-torrance", free=["diffuse"], fix={"specular": 0.0, "slope": 0.3}
    )
    for name in ("lambert.albedo", "cook-torrance.diffuse"):
        assert result.parameters[name].status == "not determined"
        assert result.parameters[name].value == [None] * 3
    assert any("lambert.albedo and cook-torrance.diffuse" in warning for warning in result.warnings)
    strict(result.to_dict())
    # Shading needs numbers all the same.
    stored = result.material_dict()
    assert stored["not_determined"] == ["lambert.albedo", "cook-torrance.diffuse"]
    assert set(stored["not_determined"]) <= set(stored["parameters"])


def test_what_is_locked_with_an_unknown_without_effect_is_not_determined() -> None:
    # At k = 0 a conductor's k has no effect to first order; n and k of one reflectance are locked all the same.
    metal = CookTorrance(0.0, 1.0, 0.2, fresnel="conductor", eta=1.5, k=3.0)
    lights = ((directional((0.0, 0.35, 0.94), 3.0),), (directional((0.3, 0.2, 0.93), 3.0),))
    capture = Studio(size=64, lights=lights).photograph(metal, seed=1)
    found = estimate(capture, "cook-torrance(fresnel=conductor)", fix={"diffuse": 0.0})
    assert found.parameters["slope"].status == "determined"
    assert found.parameters["eta"].status == "not determined"


def test_a_body_beside_another_moves_nothing_but_what_is_seen() -> None:
    # Along the valley between the two, χ² does not change: whoever follows it unseen ends far from the images.
    for seed in range(4):
        result = estimate(captured(Lambert(0.4) + OrenNayar(0.4, 0.3)), "lambert+oren-nayar", seed=seed)
        assert result.fit.reduced_chi2 < 1.05
        assert {parameter.status for parameter in result.parameters.values()} <= {"not determined", "determined"}


def test_images_without_a_value_inside_the_range_are_refused() -> None:
    white = captured(Lambert(0.6))
    white = changed(
        white,
        stored=tuple(np.full_like(image, 255, dtype=np.uint8) for image in white.photographs.stored),
        encoding=Encoding(saturation=1.0),
    )
    assert "another exposure" in refusal(lambda: estimate(white, "oren-nayar"))


def test_a_model_that_gives_nothing_finite_is_refused() -> None:
    broken = captured(Lambert(0.6))
    broken = changed(broken, noise=Noise(math.nan, math.nan))
    assert "not finite" in refusal(lambda: estimate(broken, "lambert"))


def test_a_fit_that_does_not_converge_says_so_once(monkeypatch: pytest.MonkeyPatch) -> None:
    # Not by name: matest.estimators has a function called as its module is.
    for module in ("fit", "pilot"):
        monkeypatch.setattr(sys.modules[f"matest.estimators.{module}"], "MAX_PASSES", 1)
    result = estimate(captured(CookTorrance(0.3, 0.4, 0.2)), "oren-nayar")
    assert result.fit.status == "not converged"
    assert "Not converged" in result.fit.message
    assert not any("onverged" in warning for warning in result.warnings)


@pytest.mark.parametrize(
    "material",
    [
        Lambert(0.3),
        OrenNayar([0.7, 0.6, 0.5], 0.5236),
        CookTorrance(0.3, [0.8, 0.7, 0.6], 0.2, 0.05, masking="smith", normalisation="ngan"),
        OrenNayar(0.6, 0.4) + TorranceSparrow([0.04, 0.03, 0.02], 0.2),
    ],
    ids=lambda material: material.expression,
)
def test_materials_survive_the_round_trip_through_json(tmp_path: Path, material: Brdf) -> None:
    written = clay(material=material, model=material.expression).material_dict()
    (tmp_path / "material.json").write_text(json.dumps(written, allow_nan=False), "utf-8")
    for path in (tmp_path, tmp_path / "material.json"):
        read = load_material(path)
        assert read.expression == material.expression
        assert all(torch.equal(read.parameters[name], value) for name, value in material.parameters.items())
    pairs = random_pairs(50, seed=1)
    assert torch.equal(read(*pairs), material(*pairs))


def test_an_albedo_above_one_of_relative_radiometry_survives(tmp_path: Path) -> None:
    capture = Studio(size=32, lights=coloured()[:4], relative=True).photograph(
        OrenNayar(0.8, 0.5), seed=1, brightness=3
    )
    result = estimate(capture, "oren-nayar")
    assert min(result.parameters["albedo"].value) > 2
    (tmp_path / "material.json").write_text(json.dumps(result.material_dict()), "utf-8")
    read = load_material(tmp_path)
    assert read.parameters["albedo"].tolist() == result.parameters["albedo"].value
    assert float(read.parameters["interreflection"]) == pytest.approx(1 / 3, rel=0.1)
    assert math.isfinite(float(read(*random_pairs(5, seed=2)).sum()))


def test_a_folder_without_a_material_is_refused(tmp_path: Path) -> None:
    assert "material.json" in refusal(lambda: load_material(tmp_path))


@pytest.mark.parametrize(
    "text", ["", "{", "[]", "{}", '{"model": "lambert"}', '{"model": "lambert", "parameters": [1]}', '"text"']
)
def test_a_damaged_material_is_refused_by_name(tmp_path: Path, text: str) -> None:
    (tmp_path / "material.json").write_text(text, "utf-8")
    assert "material.json" in refusal(lambda: load_material(tmp_path))


@pytest.mark.parametrize(
    "content",
    [
        {"model": "lambrt", "parameters": {"albedo": 0.5}},
        {"model": "lambert", "parameters": {"albdo": 0.5}},
        {"model": "lambert", "parameters": {"albedo": "white"}},
        {"model": "lambert", "parameters": {"albedo": None}},
        {"model": "lambert", "parameters": {"albedo": math.nan}},
        {"model": "lambert", "parameters": {"albedo": [0.5, 1e39, 0.5]}},
    ],
)
def test_a_material_of_another_kind_is_refused_by_name(tmp_path: Path, content: dict) -> None:
    (tmp_path / "material.json").write_text(json.dumps(content), "utf-8")
    assert "material.json" in refusal(lambda: load_material(tmp_path))


@pytest.mark.parametrize(
    "albedo",
    ["NaN", "Infinity", "[[0.5]]", "[[[0.5]]]", "[]", "null", "true", "-1", "1e300", "9" * 5000, "[" * 100_000],
)
def test_a_material_that_is_no_number_is_refused(tmp_path: Path, albedo: str) -> None:
    file = tmp_path / "material.json"
    file.write_text(f'{{"model": "lambert", "parameters": {{"albedo": {albedo}}}}}', "utf-8")
    assert refusal(lambda: load_material(file)).startswith(f"{file}: expected a material of 'matest estimate'; ")


@pytest.mark.parametrize("std", ["NaN", "[0.1, Infinity]", '"0.1"', "[[0.1]]", "{}", "1" + "0" * 400])
def test_a_stored_result_has_errors_that_are_numbers(tmp_path: Path, std: str) -> None:
    provenance = '"provenance": {"capture": ".."}'
    (tmp_path / "result.json").write_text(f'{{"parameters": {{"albedo": {{"std": {std}}}}}, {provenance}}}')
    assert str(tmp_path / "result.json") in refusal(lambda: read_result(tmp_path))


def test_a_stored_result_may_know_the_errors_of_some_channels_alone(tmp_path: Path) -> None:
    text = '{"parameters": {"specular": {"std": [0.004, null, null]}}, "provenance": {"capture": ".."}}'
    (tmp_path / "result.json").write_text(text)
    assert read_result(tmp_path)["parameters"]["specular"]["std"] == [0.004, None, None]
