"""Maps as a result has them, and what they cannot be asked for."""

from __future__ import annotations

import json

import numpy as np
import pytest

import matest
from matest import InputError
from matest.benchmark.instruments import miscalibration as off
from matest.benchmark.instruments.photographs import sphere, vase
from matest.benchmark.instruments.varying import KINDS, estimated, photographed
from matest.brdf import OrenNayar
from matest.estimation.parameter_map import TexelStatus
from matest.photographs.images import read_image
from matest.photographs.noise import Noise
from matest.report.folder import write_result
from tests.estimation.test_diagnosis import GLOSS, capture_of
from tests.simulated import Studio

VARIED = off.two_regions(0.2)


def test_a_map_leaves_the_noise_where_one_albedo_does_not() -> None:
    capture = capture_of(VARIED, 1)
    plain, mapped = (matest.estimate(capture, "oren-nayar", holdout=[3], maps=maps) for maps in ((), "albedo"))
    assert plain.fit.reduced_chi2 > 20
    assert mapped.fit.reduced_chi2 < 1.1
    low, high = mapped.parameters["sigma"].interval95
    assert low < 0.4 < high
    assert mapped.holdout["relative_rmse"] < 0.3 * plain.holdout["relative_rmse"]
    assert "to their noise" in mapped.fit.message


def test_the_table_has_the_mean_of_the_map() -> None:
    estimate = matest.estimate(capture_of(VARIED, 1), "oren-nayar", maps="albedo")
    each, mean = estimate.maps["albedo"], estimate.parameters["albedo"]
    np.testing.assert_allclose(mean.value, np.nanmean(each.value.numpy(), axis=0), rtol=1e-5)
    assert mean.status == "determined"
    assert each.determined > 0.8
    assert estimate.to_dict()["maps"]["albedo"]["value"] == "maps/albedo.exr"


def test_albedo_is_that_of_the_body_whatever_it_is_called() -> None:
    capture = capture_of(VARIED, 1, vase(off.SIZE), GLOSS, "diffuse")
    estimate = matest.estimate(capture, "cook-torrance", fix={"f0": 0.04}, maps="albedo")
    assert [*estimate.maps] == ["diffuse"]
    low, high = estimate.parameters["slope"].interval95
    assert low < 0.2 < high


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"maps": "gloss"}, "--maps gloss: oren-nayar estimates no such parameter; name one of albedo, sigma"),
        ({"maps": "albedo", "fix": {"albedo": 0.5}}, "--maps albedo: albedo is held at a value; leave --fix away"),
        ({"maps": "interreflection"}, "--maps interreflection: oren-nayar estimates no such parameter"),
        ({"maps": "albedo", "regions": 0}, "--regions is a number of materials from 1 to 50"),
        ({"regions": 2}, "--regions 2 says where maps share values: name the parameters with --maps"),
        ({"maps": " , "}, "--maps names no parameter: name one, such as --maps albedo, or omit it"),
        ({"maps": "albedo", "refine": "ambient"}, "--maps and --refine do not go together"),
        ({"maps": "albedo", "precision": 0.01}, "--maps and --precision do not go together"),
    ],
)
def test_what_has_no_map_is_refused_with_the_mend(options: dict, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        matest.estimate(capture_of(VARIED, 1), "oren-nayar", **options)


def test_a_result_folder_has_the_maps(tmp_path) -> None:
    capture = capture_of(VARIED, 1)
    estimate = matest.estimate(capture, "oren-nayar", maps="albedo")
    write_result(estimate, capture, tmp_path / "out")
    value, std = (read_image(tmp_path / "out" / "maps" / f"albedo{kind}.exr") for kind in ("", "_std"))
    assert value.shape == std.shape == (off.SIZE, off.SIZE, 3)
    on_object = value[capture.scene.surface.pixels // off.SIZE, capture.scene.surface.pixels % off.SIZE]
    expected = np.nan_to_num(estimate.maps["albedo"].value.numpy())
    np.testing.assert_array_equal(on_object, expected)
    known = read_image(tmp_path / "out" / "maps" / "albedo_status.png")[..., 0]
    np.testing.assert_array_equal(known > 0, (value > 0).all(axis=2))
    assert (std[known > 0] > 0).all()
    assert json.loads((tmp_path / "out" / "result.json").read_text("utf-8"))["maps"]["albedo"]["determined"] > 0.8
    page = (tmp_path / "out" / "report.html").read_text("utf-8")
    assert 'alt="albedo as sRGB shows it, white at ' in page
    assert (tmp_path / "out" / "maps" / "albedo_std.png").is_file()
    # The material that is stored has one value: a folder can be read by other programs as before.
    assert matest.load_material(tmp_path / "out").parameters["albedo"].shape == (3,)


def test_one_photograph_tells_albedos_but_neither_the_fit_nor_a_shape() -> None:
    capture = capture_of(off.together(), 1)
    estimate = matest.estimate(capture, "oren-nayar", maps="albedo,sigma", holdout=range(1, len(capture)))
    assert estimate.fit.reduced_chi2 == pytest.approx(1)
    assert estimate.maps["albedo"].determined > 0.5
    assert estimate.maps["sigma"].determined < 0.01
    sigma = estimate.parameters["sigma"]
    assert sigma.status == "not determined"
    assert sigma.value is None


def test_a_shape_has_a_map_under_ambient_light_as_check_says() -> None:
    capture = Studio(size=32, ambient=0.1, noise=Noise(5e-4, 1e-5)).photograph(OrenNayar(0.5, 0.4), seed=1)
    forecast = matest.check(capture, "oren-nayar", maps="albedo,sigma", at={"albedo": 0.5, "sigma": 0.4}).maps
    sigma = matest.estimate(capture, "oren-nayar", maps="albedo,sigma").maps["sigma"]
    assert sigma.determined == pytest.approx(forecast.photographs[-1].maps["sigma"].known, abs=0.1)
    own = sigma.status == TexelStatus.DETERMINED
    assert float(((sigma.value - 0.4) / sigma.std)[own].square().mean().sqrt()) < 1.2


def test_intervals_of_means_hold_what_pixels_share() -> None:
    """Pixels that take the value of others are all off together: errors of means do not fall with their number."""
    kind, off_by = KINDS["oren-nayar"], []
    for seed in range(3):
        subject = photographed(kind, sphere(40), 12, seed)
        estimate = estimated(kind, subject.photograph())
        for name, each in estimate.maps.items():
            mean, seen = estimate.parameters[name], each.status != TexelStatus.UNSEEN
            truth = subject.material.parameters[name].expand(len(seen), -1)[seen].mean(0)
            off_by.extend(((np.atleast_1d(mean.value) - truth.numpy()) / np.atleast_1d(mean.std)).tolist())
    assert np.sqrt(np.mean(np.square(off_by))) < 1.7
