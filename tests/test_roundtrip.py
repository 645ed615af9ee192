"""Render, estimate, predict: what goes in comes out, for every model."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest
import torch

import matest
from matest.estimation.result import Estimate
from matest.simulate import simulate
from tests import scenes
from tests.captures import changed

CASES: dict[str, dict[str, object]] = {
    "lambert": {"albedo": [0.6, 0.5, 0.3]},
    "oren-nayar": {"albedo": [0.7, 0.5, 0.3], "sigma": 0.5},
    "oren-nayar-qualitative": {"albedo": [0.7, 0.5, 0.3], "sigma": 0.5},
    "torrance-sparrow": {"specular": [0.05, 0.04, 0.03], "sigma": 0.3},
    "cook-torrance": {"diffuse": [0.4, 0.2, 0.1], "specular": [0.8, 0.8, 0.8], "slope": 0.2, "f0": 0.04},
    "cook-torrance(masking=smith)": {"diffuse": [0.4, 0.2, 0.1], "specular": [0.8, 0.8, 0.8], "slope": 0.2, "f0": 0.04},
    "oren-nayar+torrance-sparrow": {
        "oren_nayar__albedo": [0.7, 0.5, 0.3],
        "oren_nayar__sigma": 0.5,
        "torrance_sparrow__specular": [0.05, 0.04, 0.03],
        "torrance_sparrow__sigma": 0.5,
    },
    "lambert+cook-torrance": {
        "lambert__albedo": [0.4, 0.3, 0.2],
        "cook_torrance__diffuse": 0.0,
        "cook_torrance__specular": [0.8, 0.8, 0.8],
        "cook_torrance__slope": 0.15,
        "cook_torrance__f0": 0.04,
    },
}
TIES = {"oren-nayar+torrance-sparrow": {"torrance-sparrow.sigma": "oren-nayar.sigma"}}
PERSPECTIVE = """[camera]
kind = "perspective"
position = [1.2, 1.6, 4.2]
target = [0.0, 0.0, 0.2]
up = [0.0, 1.0, 0.0]
fov_y = 0.55
resolution = [150, 120]
"""
NEAR = ([2.0, 1.5, 3.0], [-2.2, 0.5, 2.5], [0.3, 2.8, 2.2], [0.5, -2.0, 2.5])


def capture_of(folder: Path, model: str, *parts: str) -> matest.Capture:
    scenes.write(folder / "scene", scenes.material(model, **CASES[model]), *parts)
    return matest.load_capture(simulate(folder / "scene", folder / "capture"))


def truth(model: str) -> dict[str, object]:
    brdf, _ = matest.brdf.model(model)
    return {scenes.path(key): value for key, value in CASES[model].items()} | {
        name: 1.0 for name in brdf.declared if name.endswith("interreflection")
    }


def channels(value: object) -> list[float]:
    return list(value) if isinstance(value, list) else [value]  # type: ignore[list-item]


def deviations(estimate: Estimate, model: str) -> dict[str, list[float]]:
    """(value − truth) / std of everything that is reported as determined."""
    out = {}
    for name, found in estimate.parameters.items():
        if found.status not in ("determined", "tied"):
            continue
        values, stds = channels(found.value), channels(found.std)
        expected = channels(truth(model)[name]) * (len(values) // len(channels(truth(model)[name])))
        out[name] = [(v - t) / s for v, t, s in zip(values, expected, stds, strict=True)]
    return out


@pytest.mark.parametrize("model", CASES)
def test_noisy_photographs_give_the_material_within_three_standard_errors(model: str, tmp_path: Path) -> None:
    capture = capture_of(tmp_path, model, scenes.sphere(), scenes.noise(), scenes.distant())
    estimate = matest.estimate(capture, model, tie=TIES.get(model))
    assert estimate.fit.status == "converged"
    assert estimate.fit.reduced_chi2 == pytest.approx(1, abs=0.03)
    found = deviations(estimate, model)
    assert {name.rpartition(".")[2] for name in found} >= {"sigma"} & {n.rpartition(".")[2] for n in truth(model)}
    assert max(abs(z) for values in found.values() for z in values) < 3


@pytest.mark.parametrize("model", CASES)
def test_noise_free_images_give_the_material_to_a_thousandth(model: str, tmp_path: Path) -> None:
    capture = capture_of(tmp_path, model, scenes.sphere(), scenes.distant())
    estimate = matest.estimate(capture, model, tie=TIES.get(model))
    expected = truth(model)
    for name, value in estimate.material.parameters.items():
        wanted = torch.as_tensor(expected[name], dtype=torch.float64).expand(value.shape)
        torch.testing.assert_close(value, wanted, rtol=1e-3, atol=1e-9, msg=f"{name}: {value.tolist()}")
    _, errors = matest.predict(estimate.material, capture)
    assert max(errors) < 1e-3


def test_prediction_of_images_left_out_is_as_good_as_their_noise(tmp_path: Path) -> None:
    capture = capture_of(tmp_path, "oren-nayar", scenes.sphere(), scenes.noise(), scenes.distant())
    estimate = matest.estimate(capture, "oren-nayar", holdout=[2, 4])
    assert estimate.holdout is not None
    assert estimate.holdout["images"] == [2, 4]
    assert estimate.holdout["relative_rmse"] == pytest.approx(estimate.fit.relative_rmse, rel=0.3)


def test_one_distant_light_cannot_tell_specular_from_f0(tmp_path: Path) -> None:
    lights = scenes.distant(scenes.LIGHTS[1:2])
    capture = capture_of(tmp_path, "cook-torrance", scenes.sphere(), scenes.noise(), lights)
    freed = matest.estimate(capture, "cook-torrance", free=["f0"])
    for name in ("specular", "f0"):
        assert freed.parameters[name].status == "not determined"
        assert channels(freed.parameters[name].value)[0] is None
    assert freed.parameters["slope"].status == "determined"
    assert any("f0" in warning and "specular" in warning for warning in freed.warnings)
    held = matest.estimate(capture, "cook-torrance")
    assert held.parameters["f0"].status == "fixed"
    assert held.parameters["specular"].status == "determined"
    assert max(abs(z) for values in deviations(held, "cook-torrance").values() for z in values) < 3


def test_a_held_parameter_is_freed_where_the_lights_determine_it(tmp_path: Path) -> None:
    capture = capture_of(tmp_path, "cook-torrance", scenes.sphere(), scenes.distant())
    assert matest.estimate(capture, "cook-torrance").parameters["f0"].status == "determined"
    fixed = matest.estimate(capture, "cook-torrance", fix={"f0": 0.05})
    assert fixed.parameters["f0"].status == "fixed"
    assert fixed.parameters["f0"].value == 0.05


@pytest.mark.parametrize("model", ["oren-nayar", "cook-torrance"])
def test_near_lights_perspective_and_cast_shadows_keep_the_accuracy(model: str, tmp_path: Path) -> None:
    geometry = scenes.notched_mesh(tmp_path / "scene")
    near = scenes.near(NEAR, intensity=40.0)
    capture = capture_of(tmp_path, model, geometry, PERSPECTIVE, scenes.noise(), near)
    assert capture.scene.shadows[0] is not None
    assert capture.samples().skipped["shadowed"] > 1000
    estimate = matest.estimate(capture, model)
    assert estimate.fit.reduced_chi2 < 1.03
    assert max(abs(z) for values in deviations(estimate, model).values() for z in values) < 3

    unshadowed = dataclasses.replace(capture.scene, shadows=(), shadow_edge=())
    blind = matest.estimate(changed(capture, scene=unshadowed), model)
    # Shadows that the geometry does not show are outliers, and few of them do any harm.
    assert blind.fit.outliers > 0.01 > 0.001 > estimate.fit.outliers
    assert any("were left out" in warning for warning in blind.warnings)


def test_ambient_light_and_several_lights_an_image_are_accounted_for(tmp_path: Path) -> None:
    image = (
        "[[image]]\nambient = [0.2, 0.25, 0.3]\nexposure = {e}\n"
        "lights = [ {{ direction = [0.1, 0.3, 0.9], irradiance = 2.0 }}, "
        "{{ direction = [{x}, 0.2, 0.6], irradiance = [1.0, 0.8, 0.6] }} ]"
    )
    images = [image.format(e=e, x=x) for e, x in ((1.0, 0.8), (0.5, -0.8), (0.8, 0.1))]
    for model in ("oren-nayar", "cook-torrance"):
        capture = capture_of(tmp_path / model, model, scenes.sphere(), *images)
        estimate = matest.estimate(capture, model)
        for name, value in estimate.material.parameters.items():
            wanted = torch.as_tensor(truth(model)[name], dtype=torch.float64).expand(value.shape)
            torch.testing.assert_close(value, wanted, rtol=1e-3, atol=1e-9, msg=f"{name}: {value.tolist()}")


def test_the_answer_does_not_depend_on_the_seed_of_the_search(tmp_path: Path) -> None:
    capture = capture_of(tmp_path, "cook-torrance", scenes.sphere(), scenes.noise(), scenes.distant())
    first, second = (matest.estimate(capture, "cook-torrance", seed=seed) for seed in (1, 2))
    for name, found in first.parameters.items():
        pairs = zip(channels(found.value), channels(second.parameters[name].value), channels(found.std), strict=True)
        for one, other, std in pairs:
            assert abs(one - other) < 0.1 * std


@pytest.mark.parametrize("anisotropy", [1.0, 12.0])
def test_leds_that_light_a_part_of_the_object_keep_the_accuracy(anisotropy: float, tmp_path: Path) -> None:
    geometry = scenes.notched_mesh(tmp_path / "scene")
    # The last one looks past the object, whose half lies behind it.
    axes = ([-2.0, -1.5, -3.0], [2.2, -0.5, -2.5], [-0.3, -2.8, -2.2], [1.0, 0.2, 0.0])
    places = (*NEAR[:3], [0.0, 0.1, 1.6])
    lamps = [f"position = {p}, axis = {a}, anisotropy = {anisotropy}" for p, a in zip(places, axes, strict=True)]
    lights = "\n".join(f"[[image]]\nlights = [ {{ {lamp}, intensity = 40.0 }} ]" for lamp in lamps)
    capture = capture_of(tmp_path, "oren-nayar", geometry, PERSPECTIVE, scenes.noise(), lights)
    estimate = matest.estimate(capture, "oren-nayar")
    assert estimate.fit.status == "converged"
    assert estimate.fit.reduced_chi2 == pytest.approx(1, abs=0.03)
    assert max(abs(z) for values in deviations(estimate, "oren-nayar").values() for z in values) < 3
