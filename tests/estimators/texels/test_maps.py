"""Values of every texel beside those in common: the elimination is exact, and error bars are those of the errors."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from matest.benchmark.instruments import miscalibration as off
from matest.benchmark.instruments.photographs import Sensor, ring, sphere, subject
from matest.brdf import Brdf, CookTorrance, OrenNayar
from matest.estimators import fit
from matest.estimators.texels.maps import MapFit, fit_maps
from tests.estimation.test_diagnosis import capture_of
from tests.problems import problem

MATERIAL = OrenNayar([0.7, 0.5, 0.3], 0.4)
SIZE = 96


def mapped(seed: int, error: off.Error | None = None) -> MapFit:
    samples = capture_of(error or off.smooth_albedo(0.1), seed).photographs.samples()
    chosen = problem("oren-nayar", channels=3)
    unknowns = fit(chosen, samples, 0).unknowns
    return fit_maps(chosen, unknowns, ["albedo"], samples.some_texels(1_000, 0), samples.texel_tiles(), samples.texels)


def waves(seed: int, low: float, high: float) -> Tensor:
    """A value at every pixel of the sphere that varies smoothly between two ends [N, 1]."""
    surface, generator = sphere(SIZE), np.random.default_rng(seed)
    places = np.stack(np.divmod(surface.pixels, SIZE), axis=1) / SIZE
    turns = 2 * np.pi * generator.uniform(0.5, 1.5, (4, 2))
    wave = np.cos(places @ turns.T + 6 * generator.random(4)).sum(1)
    return torch.from_numpy(low + (high - low) * (1 + np.tanh(wave)) / 2)[:, None]


def of_material(
    material: Brdf, names: list[str], *, regions: int | None = 1, fix: dict[str, float] | None = None
) -> MapFit:
    """The maps of a sphere of a material with values at every pixel, under twelve lights."""
    capture = subject(sphere(SIZE), ring(12), material, Sensor()).photograph()
    samples = capture.photographs.samples()
    chosen = problem(material.expression, channels=3, fix=fix or {})
    unknowns = fit(chosen, samples, 0).unknowns
    few, tiles = samples.some_texels(1_500, 0), samples.texel_tiles()
    return fit_maps(chosen, unknowns, names, few, tiles, samples.texels, regions=regions)


def test_the_shape_in_common_is_right_though_the_albedo_varies() -> None:
    found = mapped(1)
    assert found.converged
    assert found.chi2 == pytest.approx(1, abs=0.03)
    (sigma,) = found.unknowns[found.texels.common_places]
    assert abs(float(sigma - 0.4) / float(found.covariance.std[0])) < 4


def test_albedos_scatter_about_the_truth_as_their_error_bars_say() -> None:
    found = mapped(2, off.together())
    errors = (found.theta - torch.tensor([[0.7], [0.5], [0.3]])) / found.std
    errors = errors[errors.isfinite()]
    assert float(errors.square().mean().sqrt()) == pytest.approx(1, abs=0.05)
    assert float((errors.abs() < 1.96).double().mean()) == pytest.approx(0.95, abs=0.01)


def test_texels_that_no_photograph_shows_have_no_value() -> None:
    found = mapped(3)
    unseen = found.theta.isnan()
    assert bool((found.std.isnan() == unseen).all())
    assert not bool((found.own & unseen).any())
    assert 0.5 < float((~unseen).double().mean()) < 1


@pytest.fixture(scope="module")
def rough() -> tuple[Brdf, MapFit]:
    material = MATERIAL.replace(
        {"albedo": waves(1, 0.3, 0.9) * torch.tensor([[1.0, 0.7, 0.4]]), "sigma": waves(2, 0.2, 0.7)}
    )
    return material, of_material(material, ["albedo", "sigma"])


@pytest.mark.parametrize("name", ["albedo", "sigma"])
def test_intervals_of_two_maps_hold_the_truth(rough: tuple[Brdf, MapFit], name: str) -> None:
    material, found = rough
    truth = material.parameters[name].T.float()
    errors = ((found.theta[found.texels.at(name)] - truth) / found.std[found.texels.at(name)]).flatten()
    assert 0.93 < float((errors[errors.isfinite()].abs() < 1.96).double().mean()) < 0.97


def test_a_shape_has_a_map_though_nothing_else_has() -> None:
    material = MATERIAL.replace({"sigma": waves(2, 0.3, 0.5)})
    found = of_material(material, ["sigma"])
    errors = (found.theta - material.parameters["sigma"].T.float()) / found.std
    assert 0.93 < float((errors[errors.isfinite()].abs() < 1.96).double().mean()) < 0.97
    albedo = found.unknowns[found.texels.common_places]
    assert float(((albedo - torch.tensor([0.7, 0.5, 0.3])) / found.covariance.std).abs().max()) < 4


def test_no_texel_is_stuck_at_a_wrong_slope() -> None:
    material = CookTorrance([0.5, 0.4, 0.2], 0.9, 0.2, f0=0.04).replace(
        {"diffuse": waves(3, 0.1, 0.7) * torch.tensor([[1.0, 0.7, 0.4]]), "slope": waves(4, 0.1, 0.35)}
    )
    found = of_material(material, ["diffuse", "slope"], fix={"f0": 0.04})
    row = found.texels.at("slope")
    value, truth, std = found.theta[row][0], material.parameters["slope"][:, 0].float(), found.std[row][0]
    errors = (value - truth) / std
    assert 0.92 < float((errors[errors.isfinite()].abs() < 1.96).double().mean()) < 0.98
    known = found.own[row][0] & (std < 0.015 * value)
    assert int(known.sum()) > 20
    relative = ((value - truth) / truth)[known].abs()
    assert float(relative.median()) < 0.015
    specular = found.unknowns[found.texels.common_places]
    assert float(((specular - 0.9) / found.covariance.std).abs().max()) < 4


def test_regions_lend_their_own_values_to_texels_that_tell_none() -> None:
    """Two materials that differ in albedo and σ: where σ is not told it is that of the material, not of the object."""
    left = (torch.from_numpy(sphere(SIZE).pixels % SIZE) < SIZE / 2)[:, None]
    material = MATERIAL.replace(
        {
            "albedo": torch.where(left, 0.25, 0.85).double() * torch.tensor([[1.0, 0.7, 0.4]]),
            "sigma": torch.where(left, 0.6, 0.3).double(),
        }
    )
    object_wide, found = (of_material(material, ["albedo", "sigma"], regions=count) for count in (1, None))
    row = found.texels.at("sigma")
    assert len(found.regions.features) == 2
    assert sorted(found.regions.values[row][0].tolist()) == pytest.approx([0.3, 0.6], rel=0.05)

    def error(fit: MapFit) -> float:
        errors = (fit.theta - material.parameters["sigma"].T.float())[row][0]
        return float(errors[~object_wide.own[row][0] & errors.isfinite()].abs().median())

    assert error(found) < 0.7 * error(object_wide)


def test_the_maps_are_those_of_the_seed() -> None:
    first, again = (mapped(4) for _ in range(2))
    assert torch.equal(first.theta.nan_to_num(), again.theta.nan_to_num())
