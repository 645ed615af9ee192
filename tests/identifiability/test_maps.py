"""What is predicted of maps before any fit, against the maps of the fit."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
import torch
from torch import Tensor

import matest
from matest import InputError
from matest.benchmark.instruments.photographs import NOISE, Sensor, ring, sphere, subject
from matest.brdf import Brdf, CookTorrance, Lambert, OrenNayar
from matest.capture import Capture
from matest.estimation.parameter_map import TexelStatus
from matest.identifiability import MapsForecast, check
from matest.identifiability.maps import _counts

SIZE = 48
ROUGH = OrenNayar([0.5, 0.35, 0.2], 0.4)
GLOSSY = CookTorrance([0.5, 0.4, 0.2], 0.9, 0.2, f0=0.04)
FIXED: dict[str, dict[str, float]] = {"oren-nayar": {}, "cook-torrance": {"f0": 0.04}}

pytestmark = pytest.mark.usefixtures("without_advice")


def photographed(material: Brdf, lights: np.ndarray) -> Capture:
    return subject(sphere(SIZE), lights, material, Sensor()).photograph()


def waves(seed: int, around: float) -> Tensor:
    """A value at every pixel of the sphere that varies smoothly by ten per cent [N, 1]."""
    surface, generator = sphere(SIZE), np.random.default_rng(seed)
    places = np.stack(np.divmod(surface.pixels, SIZE), axis=1) / SIZE
    wave = np.cos(places @ (2 * np.pi * generator.uniform(0.5, 1.5, (2, 1)))).sum(1)
    return torch.from_numpy(around * (1 + 0.1 * wave))[:, None]


@cache
def varied(material: Brdf, count: int) -> Capture:
    """A sphere of a material whose albedo, and shape, vary from pixel to pixel."""
    (body, albedo), *_ = material.parameters.items()
    shape = "sigma" if "sigma" in material.parameters else "slope"
    values = {body: waves(1, 1.0) * albedo, shape: waves(2, float(material.parameters[shape]))}
    return photographed(material.replace(values), ring(count))


def predicted(capture: Capture, material: Brdf, maps: str) -> MapsForecast:
    """At the values of a material."""
    held = {"f0", "interreflection"}
    at = {name: value.tolist() for name, value in material.parameters.items() if name not in held}
    forecast = check(capture, material.expression, fix=FIXED[material.name], at=at, maps=maps).maps
    assert forecast is not None
    return forecast


@cache
def of_varied(material: Brdf, maps: str) -> MapsForecast:
    return predicted(varied(material, 12), material, maps)


@pytest.mark.parametrize(
    ("material", "maps", "counts"),
    [(ROUGH, "albedo", (12, 4, 2)), (ROUGH, "albedo,sigma", (12, 6)), (GLOSSY, "diffuse,slope", (12,))],
    ids=["albedo", "albedo and sigma", "diffuse and slope"],
)
def test_what_is_predicted_of_maps_is_what_the_fit_finds(material: Brdf, maps: str, counts: tuple[int, ...]) -> None:
    """Shares of pixels to 0.04, errors to 8 %: the fit's are at noisy values, on an object that varies.

    Slopes that most pixels do not tell err by what those of the object scatter by, which is foreseen to 20 %.
    """
    capture = varied(material, 12)
    forecast = of_varied(material, maps)
    for count in counts:
        row = next(row for row in forecast.photographs if len(row.images) == count)
        rest = [image for image in range(12) if image not in row.images]
        expression, fix = material.expression, FIXED[material.name]
        estimate = matest.estimate(capture, expression, fix=fix, maps=maps, holdout=rest)
        for name, each in estimate.maps.items():
            seen = each.status != TexelStatus.UNSEEN
            relative = (each.std / each.value.abs()).amax(1)[seen]
            assert row.lit == pytest.approx(float(seen.double().mean()), abs=0.01)
            assert row.maps[name].known == pytest.approx(each.determined, abs=0.04)
            assert row.maps[name].relative is not None
            assert row.maps[name].relative[1] == pytest.approx(
                float(relative.median()), rel=0.2 if name == "slope" else 0.08
            )
        for name, error in row.common.items():
            parameter = estimate.parameters[name]
            worst = np.max(np.ravel(parameter.std) / np.ravel(parameter.value))
            assert error == pytest.approx(worst, rel=0.1), name


def test_errors_of_an_albedo_are_those_of_its_photographs() -> None:
    """By hand: of a matte pixel, value y = albedo·irradiance·cosine/π, variance read² + gain·y in full scale."""
    lights = ring(3)
    capture = photographed(Lambert(0.5), lights)
    forecast = check(capture, "lambert", at={"albedo": 0.5}, maps="albedo").maps
    assert forecast is not None
    surface, scale = capture.scene.surface, capture.photographs.encoding.scale
    values = np.clip(surface.normals.numpy() @ lights.T, 0, None) * 3.0 * 0.5 / math.pi / scale
    values[surface.rim] = 0
    for row in forecast.photographs:
        some = values[:, row.images]
        told = (some**2 / (NOISE.read**2 + NOISE.gain * some)).sum(1)
        errors = 1 / np.sqrt(told[told > 0])
        assert row.lit == pytest.approx(float((told > 0).mean()), abs=0.02)
        assert row.maps["albedo"].known == pytest.approx(float((errors < 0.5).sum() / len(told)), abs=0.02)
        np.testing.assert_allclose(row.maps["albedo"].relative, np.quantile(errors, (0.25, 0.5, 0.75)), rtol=0.03)


def test_one_photograph_tells_albedos_for_a_given_shape_and_nothing_of_the_shape() -> None:
    forecast = of_varied(ROUGH, "albedo,sigma")
    first, second = forecast.photographs[:2]
    assert first.maps["albedo"].known > 0.95 * first.lit
    assert first.maps["sigma"].known == 0
    assert first.as_one["sigma"] is None
    assert second.as_one["sigma"] is not None
    alone = of_varied(ROUGH, "albedo")
    assert alone.photographs[0].common == {"sigma": None}


def test_more_photographs_tell_more() -> None:
    forecast = of_varied(ROUGH, "albedo,sigma")
    rows = forecast.photographs
    assert [len(row.images) for row in rows] == [1, 2, 3, 4, 6, 8, 12]
    known = [row.maps["sigma"].known for row in rows]
    assert known == sorted(known)
    errors = [row.as_one["sigma"] or math.inf for row in rows]
    assert errors == sorted(errors, reverse=True)


def test_errors_of_pixels_are_their_own_though_they_take_what_the_object_has() -> None:
    forecast = of_varied(GLOSSY, "specular")
    assert len(forecast.photographs) == 7
    for row in forecast.photographs:
        each = row.maps["specular"]
        assert each.relative is not None
        assert (each.known < 0.5 * row.lit) == (each.relative[1] > 0.5)


def test_a_photograph_like_another_comes_after_those_that_differ() -> None:
    ahead, aside, across = ring(12)[[0, 6, 10]]
    capture = photographed(ROUGH, np.stack([ahead, ahead, aside, across, ahead]))
    forecast = predicted(capture, ROUGH, "albedo,sigma")
    assert len({0, 1, 4} & {*forecast.photographs[-1].images[:3]}) == 1


def test_shapes_that_nobody_gave_are_halved_and_doubled() -> None:
    forecast = check(varied(ROUGH, 4), "oren-nayar", maps="albedo,sigma").maps
    assert forecast is not None
    for row in forecast.photographs:
        each = row.maps["sigma"]
        assert each.known_range is not None
        assert each.known_range[0] <= each.known <= each.known_range[1]
        assert each.relative_range is not None
        assert each.relative_range[0] < each.relative_range[1]


def test_what_has_no_map_is_refused_with_the_mend() -> None:
    with pytest.raises(InputError, match="--maps gloss: oren-nayar estimates no such parameter; name one of albedo"):
        check(varied(ROUGH, 4), "oren-nayar", maps="gloss")
    assert check(varied(ROUGH, 4), "oren-nayar").maps is None


def test_numbers_of_photographs_end_with_all() -> None:
    assert _counts(1) == [1]
    assert _counts(5) == [1, 2, 3, 4, 5]
    assert _counts(40) == [1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 40]
