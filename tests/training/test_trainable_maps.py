"""Modules with a value at every pixel: batches gather, optimisers train, priors of one's own improve them."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor, nn

import matest
from matest.brdf import Brdf, CookTorrance, OrenNayar
from matest.capture import Capture
from matest.errors import InputError
from matest.estimation.parameter_map import TexelStatus
from matest.losses import likelihood
from matest.photographs.noise import Noise
from matest.samples import Batch
from matest.shading import render, shade
from matest.training.gradient import TrainingStep, fit_gradient
from matest.training.trainable import Trainable
from tests.simulated import DIRECTIONS, Studio, coloured
from tests.training.materials import SAMPLES, STUDIO, same, train

TEXELS = len(STUDIO.scene.surface)


def textured(texels: int = TEXELS, **options) -> Trainable:
    return Trainable(OrenNayar(0.5, 0.3), maps="albedo", texels=texels, **options)


def first(size: int = 100) -> Batch:
    return next(SAMPLES.batches(size, shuffle=True, seed=1))


def test_a_map_starts_at_the_value_of_the_model_at_every_pixel() -> None:
    material = Trainable(OrenNayar([0.2, 0.4, 0.6], 0.3), maps=["albedo", "sigma"], texels=7)
    assert material.map("albedo").shape == (7, 3)
    assert material.map("sigma").shape == (7, 1)
    torch.testing.assert_close(material.map("albedo")[4], torch.tensor([0.2, 0.4, 0.6]))
    assert Trainable(OrenNayar(), maps="albedo, sigma", texels=7).maps == material.maps


def test_a_map_starts_from_values_at_every_pixel() -> None:
    values = torch.rand(7, 3, dtype=torch.float64)
    material = Trainable(OrenNayar(values, 0.3), maps="albedo", texels=7)
    torch.testing.assert_close(material.map("albedo"), values.float())


def test_a_batch_gets_the_values_of_its_pixels() -> None:
    values = torch.rand(TEXELS, 1)
    material, batch = Trainable(OrenNayar(values, 0.3), maps="albedo", texels=TEXELS), first()
    brdf = material(batch)
    torch.testing.assert_close(brdf.parameters["albedo"], values[batch.pixels])
    assert brdf.parameters["sigma"].ndim == 0
    torch.testing.assert_close(shade(brdf, batch.points), shade(OrenNayar(values[batch.pixels], 0.3), batch.points))


def test_without_a_batch_it_renders_the_whole_surface() -> None:
    values = torch.rand(TEXELS, 1)
    images = render(STUDIO.scene, Trainable(OrenNayar(values, 0.3), maps="albedo", texels=TEXELS)())
    torch.testing.assert_close(images, render(STUDIO.scene, OrenNayar(values, 0.3)))


def test_gradients_reach_only_the_pixels_of_a_batch() -> None:
    material, batch = textured(), first(50)
    likelihood(shade(material(batch), batch.points), batch).backward()
    texture, sigma = material.values
    touched = torch.zeros(TEXELS, dtype=torch.bool)
    touched[batch.pixels] = True
    assert 0 < int(touched.sum()) <= 50
    assert bool((texture.grad[:, 0] != 0).eq(touched).all())
    assert float(sigma.grad) != 0


@pytest.mark.parametrize("shove", [-1e6, -30.0, 30.0, 1e6])
def test_values_stay_in_their_domains_wherever_the_optimiser_goes(shove: float) -> None:
    material = Trainable(CookTorrance(), maps=("diffuse", "slope"), texels=TEXELS)
    with torch.no_grad():
        for raw in material.parameters():
            raw.add_(shove)
    brdf, batch = material(first()), first()
    for name, declared in brdf.declared.items():
        assert declared.domain.contains(brdf.parameters[name])
    shade(brdf, batch.points).sum().backward()
    assert all(raw.grad is None or bool(raw.grad.isfinite().all()) for raw in material.parameters())


def test_albedos_of_a_map_may_be_above_1_beside_lights_of_unknown_strength() -> None:
    material = textured(relative=True)
    material.values[0].data += 10.0
    assert material.map("albedo").min().item() > 5


def test_a_map_is_laid_out_as_an_image_that_gradients_pass_through() -> None:
    material, surface = textured(), STUDIO.scene.surface
    image = surface.image(material.map("albedo"))
    assert image.shape == (*surface.shape, 1)
    np.testing.assert_array_equal(image.detach().numpy(), surface.image(material.map("albedo").detach().numpy()))
    image.square().sum().backward()
    assert bool((material.values[0].grad != 0).all())


def test_a_resumed_run_over_texels_ends_where_an_uninterrupted_one_does(tmp_path: Path) -> None:
    whole, part = textured(), textured()
    uninterrupted = train(whole, 9)
    train(textured(), 4, checkpoint=tmp_path / "run")
    assert train(part, 9, checkpoint=tmp_path / "run") == uninterrupted
    assert same(part, whole)


def test_a_checkpoint_of_another_map_is_refused(tmp_path: Path) -> None:
    train(textured(), 1, checkpoint=tmp_path / "run")
    with pytest.raises(InputError, match="written with another material"):
        train(Trainable(OrenNayar(0.5, 0.3)), 1, checkpoint=tmp_path / "run")


def chequered(images: int, read: float) -> tuple[Capture, Tensor]:
    """Photographs of a sphere of two albedos in squares, and the albedo at its pixels."""
    studio = Studio(size=40, lights=coloured(DIRECTIONS[:images]), noise=Noise(read, 0.0005))
    rows, columns = np.divmod(studio.scene.surface.pixels, 40)
    tone = np.where((rows // 10 + columns // 10) % 2, 0.6, 0.3)
    albedo = torch.from_numpy(tone[:, None] * np.array([1.0, 0.8, 0.6]))
    return studio.photograph(OrenNayar(albedo, 0.4), seed=3), albedo


def cool(step: TrainingStep) -> None:
    for group in step.optimiser.param_groups:
        group["lr"] *= 0.97


def quick(parameters: list[nn.Parameter]) -> torch.optim.Optimizer:
    # A short memory of squared gradients: at first those of what all pixels share are thousands of times larger.
    return torch.optim.Adam(parameters, lr=0.2, betas=(0.9, 0.9))


def test_training_over_texels_recovers_two_albedos_to_the_noise() -> None:
    capture, truth = chequered(6, 0.01)
    material = Trainable(OrenNayar([0.5, 0.5, 0.5], 0.3), maps="albedo", texels=len(truth))
    samples = capture.samples()
    fit_gradient(samples, material, steps=100, batch_size=len(samples), callback=cool, optimiser=quick)
    closed = matest.estimate(capture, "oren-nayar", maps="albedo").maps["albedo"]
    known = closed.status == TexelStatus.DETERMINED
    errors = ((material.map("albedo").detach() - truth) / closed.std)[known]
    assert float(known.double().mean()) > 0.7  # the rim is left out
    assert float(errors.square().mean().sqrt()) == pytest.approx(1, abs=0.1)
    assert material().parameters["sigma"].item() == pytest.approx(0.4, abs=0.01)


def test_a_prior_of_total_variation_halves_the_error_of_few_noisy_photographs() -> None:
    capture, truth = chequered(3, 0.02)
    surface, samples = capture.scene.surface, capture.samples()
    estimate = matest.estimate(capture, "oren-nayar", maps="albedo")
    material = Trainable(estimate.material, fixed=("sigma",), maps="albedo", texels=len(surface))
    inside = torch.from_numpy(surface.mask)
    across, down = inside[:, 1:] & inside[:, :-1], inside[1:] & inside[:-1]

    def loss(rendered: Tensor, batch: Batch) -> Tensor:
        image = surface.image(material.map("albedo"))
        variation = image.diff(dim=1)[across].abs().sum() + image.diff(dim=0)[down].abs().sum()
        return likelihood(rendered, batch) + variation / 0.05 / (3 * len(samples))

    seen = estimate.maps["albedo"].status != TexelStatus.UNSEEN

    def error() -> float:
        return math.sqrt(float((material.map("albedo").detach() - truth)[seen].square().mean()))

    before = error()
    fit_gradient(samples, material, loss=loss, steps=60, batch_size=len(samples))
    assert error() < 0.5 * before


@pytest.mark.parametrize(
    ("brdf", "options", "sentence"),
    [
        (OrenNayar(), {"maps": "albdo", "texels": 5}, "no parameter 'albdo'; did you mean 'albedo'"),
        (OrenNayar(), {"maps": "albedo"}, "maps and texels go together"),
        (OrenNayar(), {"texels": 5}, "maps and texels go together"),
        (OrenNayar(), {"maps": "albedo", "texels": 0}, "positive whole number; got 0"),
        (OrenNayar(), {"maps": "albedo", "texels": 5, "fixed": ("albedo",)}, "'albedo' does not train"),
        (OrenNayar(), {"maps": "interreflection", "texels": 5}, "'interreflection' does not train"),
        (OrenNayar(torch.full((4, 3), 0.5)), {"maps": "albedo", "texels": 5}, r"shape \[4, 3\], while texels=5"),
        (OrenNayar(torch.full((5, 3), 0.5)), {"maps": "sigma", "texels": 5}, "'albedo' starts from a value at every"),
    ],
)  # fmt: skip
def test_maps_that_cannot_be_are_refused_with_the_mend(brdf: Brdf, options: dict, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        Trainable(brdf, **options)


def test_batches_without_pixels_and_of_another_surface_are_refused() -> None:
    with pytest.raises(InputError, match="needs samples that lie in pixels"):
        textured()(replace(first(), pixels=None))
    with pytest.raises(InputError, match="while texels=9: give"):
        textured(9)(first())


def test_a_whole_map_beside_a_batch_is_refused() -> None:
    with pytest.raises(InputError, match=f"'albedo' has values at {TEXELS:,} points and 100 are shaded"):
        shade(textured()(), first().points)


def test_a_parameter_without_a_map_is_refused() -> None:
    with pytest.raises(InputError, match="'sigma' has no map"):
        textured().map("sigma")
    with pytest.raises(InputError, match="'albedo' has no map; name it in maps"):
        Trainable(OrenNayar()).map("albedo")
