"""A prediction with a value at every pixel, against errors by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

import matest
from matest import InputError
from matest.brdf import OrenNayar
from matest.estimation.parameter_map import with_maps
from matest.estimation.prediction import mapped_radiance, prediction_errors
from matest.samples import Tile
from tests.captures import changed
from tests.mapped import SIGMA, STUDIO, albedo, mapped, photographs

TRUTH = OrenNayar(albedo(), SIGMA)
LAST = len(STUDIO.lights) - 1


def by_hand(material: OrenNayar, image: int) -> tuple[float, float]:
    """Relative rms error, and median relative error of a pixel."""
    capture = photographs()
    surface, usable = capture.scene.surface, capture.samples().usable(image)
    rendered = matest.render(capture.scene, material, dtype=torch.float64)[image].numpy()
    model, measured = rendered.reshape(-1, 1)[surface.pixels][usable], capture.radiance(image)[usable]
    difference = np.abs(model - measured)
    rms = np.sqrt((difference**2).sum() / (measured**2).sum())
    return float(rms), float(np.median(difference / np.abs(measured)))


def test_the_errors_are_those_of_the_mapped_material() -> None:
    errors = prediction_errors(photographs(), TRUTH)
    for image, (rms, median) in enumerate(zip(errors.images, errors.medians, strict=True)):
        assert (rms, median) == pytest.approx(by_hand(TRUTH, image), rel=1e-3)
    # The mean of the map is off by a half.
    mean = prediction_errors(photographs(), OrenNayar(albedo().mean(), SIGMA))
    assert errors.pooled is not None
    assert mean.pooled is not None
    assert errors.pooled < 0.1 < mean.pooled
    assert mean.pooled_median > 0.2


def test_a_uniform_map_predicts_as_one_value_does() -> None:
    one, every = OrenNayar(0.5, SIGMA), OrenNayar(torch.full_like(albedo(), 0.5), SIGMA)
    plain, by_pixel = prediction_errors(photographs(), one), prediction_errors(photographs(), every)
    assert by_pixel.images == pytest.approx(plain.images, rel=1e-5)
    assert by_pixel.medians == pytest.approx(plain.medians, rel=1e-4)


def test_images_and_errors_of_a_mapped_estimate_are_those_of_its_material() -> None:
    material = mapped().material
    images, errors = matest.predict(material, photographs())
    np.testing.assert_array_equal(images, matest.render(photographs().scene, material).numpy())
    assert errors[LAST] == pytest.approx(by_hand(material, LAST)[0], rel=1e-3)


def test_rendering_is_differentiable_in_a_map() -> None:
    values = albedo().requires_grad_()
    matest.render(photographs().scene, OrenNayar(values, SIGMA)).sum().backward()
    assert values.grad is not None
    assert bool((values.grad > 0).float().mean() > 0.9)


def test_photographs_left_out_have_the_errors_of_a_prediction() -> None:
    estimate = mapped()
    rms, median = by_hand(estimate.material, LAST)
    assert estimate.holdout == {
        "images": [LAST],
        "relative_rmse": pytest.approx(rms, rel=1e-3),
        "median_error": pytest.approx(median, rel=1e-3),
    }


def test_every_fitted_photograph_has_its_error_and_residuals_have_their_angles() -> None:
    estimate = mapped()
    assert [image.file for image in estimate.images] == photographs().names[:LAST]
    for number, image in enumerate(estimate.images):
        assert image.relative_rmse == pytest.approx(by_hand(estimate.material, number)[0], rel=1e-3)
        assert image.reduced_chi2 < 1.1
        assert image.level is None
    assert {*estimate.residuals} == {"half angle", "angle of incidence"}
    assert float(estimate.residuals["angle of incidence"].mean.abs().max()) < 0.05


def test_samples_of_a_tile_take_the_values_of_their_own_pixels() -> None:
    samples = photographs().samples([2])
    some = samples.indices(0)[::7]
    tile = Tile(samples.at(0, some))
    rendered = matest.render(photographs().scene, TRUTH)[2].reshape(-1, 1)
    expected = rendered[photographs().scene.surface.pixels[some].astype(np.int64)]
    torch.testing.assert_close(mapped_radiance(TRUTH, samples.texels)(tile), expected, rtol=1e-5, atol=1e-7)


def test_a_capture_in_the_place_of_the_material_is_told() -> None:
    with pytest.raises(TypeError, match="predict takes a material, then a capture; got Capture as the material"):
        matest.predict(photographs(), mapped().material)  # type: ignore[arg-type]


def test_values_of_other_pixels_or_channels_are_refused() -> None:
    few = OrenNayar(albedo()[:100], SIGMA)
    with pytest.raises(InputError, match="albedo has values of 100: a map belongs to the view it was estimated in"):
        prediction_errors(photographs(), few)
    coloured = OrenNayar(albedo().expand(-1, 3), SIGMA)
    with pytest.raises(InputError, match=r"1 channel\(s\), but the material was estimated for 3"):
        prediction_errors(photographs(), coloured)


def test_a_shape_of_every_pixel_reflects_the_sky_too() -> None:
    sky = torch.full((len(STUDIO.lights), 1), 0.1, dtype=torch.float64)
    scene = replace(photographs().scene, ambient=sky)
    rough = OrenNayar(0.5, 0.5 * albedo())
    assert prediction_errors(changed(photographs(), scene=scene), rough).pooled > 0.1
    # An albedo only multiplies.
    assert prediction_errors(changed(photographs(), scene=scene), TRUTH).pooled > 0.1


def test_maps_of_an_estimate_make_its_material() -> None:
    estimate = mapped()
    again = with_maps(OrenNayar(0.5, estimate.material.parameters["sigma"]), estimate.maps)
    assert torch.equal(again.parameters["albedo"], estimate.material.parameters["albedo"])
