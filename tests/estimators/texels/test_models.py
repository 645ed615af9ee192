"""Texels are shaded as `shade` does, and their sums are those of the dense Jacobian."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from matest.benchmark.instruments import miscalibration as off
from matest.estimators.basis import mixture
from matest.estimators.texels.elimination import Elimination
from matest.estimators.texels.fit import TexelFitter
from matest.estimators.texels.models import radiance, texel_model
from matest.estimators.texels.problem import TexelPrior, TexelProblem
from matest.estimators.texels.unknowns import TexelUnknowns
from matest.estimators.texels.weights import WeightTable, unit_weights
from matest.estimators.unknowns import Problem
from matest.samples.residual_scale import NOISE_ALONE
from matest.samples.texels import TexelTile
from matest.shading import shade
from tests.estimation.test_diagnosis import capture_of
from tests.problems import ordinary, problem

MODELS = {
    "oren-nayar": ("albedo", "sigma"),
    "cook-torrance": ("diffuse", "slope"),
    "oren-nayar+torrance-sparrow": ("oren-nayar.albedo", "oren-nayar.sigma"),
}


def setting(expression: str) -> tuple[Problem, TexelUnknowns, Tensor, TexelTile, Tensor]:
    """A problem, its texels' unknowns, u, samples of some texels, and θ of these."""
    chosen = problem(expression, channels=3, fix={"f0": 0.04} if "cook" in expression else {})
    texels = TexelUnknowns(chosen, MODELS[expression])
    unknowns = ordinary(chosen, 1)
    tile = capture_of(off.together(), 1).photographs.samples().some_texels(40, 0)
    generator = torch.Generator().manual_seed(2)
    factor = 0.8 + 0.4 * torch.rand(len(texels.rows), len(tile), generator=generator)
    return chosen, texels, unknowns, tile, texels.spread(unknowns, len(tile)).float() * factor


def shaded(texels: TexelUnknowns, unknowns: Tensor, tile: TexelTile, theta: Tensor) -> Tensor:
    """The radiance by the shader, each sample with the values of its texel [I·n, C]."""
    values = texels.values(unknowns, theta)
    own = {
        name: value.T.repeat(tile.images, 1) if value.shape[1] > 1 else value[:, 0].to(theta)
        for name, value in values.items()
    }
    material = texels.problem.material(unknowns).to(torch.float32, "cpu").replace(own)
    return shade(material, tile.in_a_row.points).expand(-1, 3)


@pytest.mark.parametrize("expression", MODELS)
def test_texels_have_the_radiance_of_the_shader(expression: str) -> None:
    _, texels, unknowns, tile, theta = setting(expression)
    model = texel_model(texels, unknowns)
    found = radiance(model.columns(tile, theta), model.coefficients(theta), tile.images)
    lit = tile.usable
    torch.testing.assert_close(found[lit], shaded(texels, unknowns, tile, theta)[lit], rtol=2e-4, atol=1e-5)


@pytest.mark.parametrize("expression", MODELS)
def test_gradients_and_information_are_those_of_finite_differences(expression: str) -> None:
    _, texels, unknowns, tile, theta = setting(expression)
    model = texel_model(texels, unknowns)
    columns = model.columns(tile, theta) if model.separates else None
    here = TexelProblem(tile, model, tile.about(tile.radiance, NOISE_ALONE), columns)
    least = TexelProblem.of(here, here.squares, theta)
    normal = least.normal(theta, texels.rows)
    step, jacobian = 1e-2, []
    for row in range(len(theta)):
        ends = []
        for sign in (1, -1):
            moved = theta.clone()
            moved[row] *= 1 + sign * step
            ends.append(shaded(texels, unknowns, tile, moved))
        jacobian.append((ends[0] - ends[1]) / (2 * step * theta[row]).repeat(tile.images)[:, None])
    weight = here.squares.weight
    residual = here.squares.response - shaded(texels, unknowns, tile, theta)
    for row, slope in enumerate(jacobian):
        by_texel = (weight * slope * residual).sum(1).unflatten(0, (tile.images, -1)).sum(0)
        squares = (weight * slope.square()).sum(1).unflatten(0, (tile.images, -1)).sum(0)
        scale = squares.max().sqrt()
        torch.testing.assert_close(normal.gradient[row] / scale, by_texel / scale, rtol=0.01, atol=0.5)
        torch.testing.assert_close(normal.information[row, row], squares, rtol=0.02, atol=float(squares.max()) * 2e-3)


def test_weights_of_a_table_are_those_of_the_model() -> None:
    _, texels, unknowns, _, theta = setting("oren-nayar")
    table = WeightTable.of(texels, unknowns)
    found = table.at(theta[texels.at("sigma")][0].double())
    expected = unit_weights(texels, texels.values(unknowns, theta.double()))
    for one, other in zip(found.plain, expected.plain, strict=True):
        torch.testing.assert_close(one, other.expand_as(one), rtol=0, atol=1e-6)
    for one, other in zip(found.slopes["sigma"], expected.slopes["sigma"], strict=True):
        torch.testing.assert_close(one, other.expand_as(one), rtol=0, atol=1e-4)


def test_weights_are_those_of_the_mixture() -> None:
    chosen, texels, unknowns, _, theta = setting("oren-nayar")
    points = [unknowns.clone() for _ in range(3)]
    for point, sigma in zip(points, theta[texels.at("sigma")][0], strict=False):
        point[chosen.where["sigma"]] = sigma
    _, weights = mixture(chosen, points)
    found = unit_weights(texels, texels.values(unknowns, theta[:, :3].double()))
    for one, other in zip(found.plain, weights, strict=True):
        torch.testing.assert_close(one[0].T, other[:, 0])


def test_eliminating_texels_is_the_dense_solution() -> None:
    chosen, _, unknowns, tile, _ = setting("oren-nayar")
    texels = TexelUnknowns(chosen, ("albedo",))
    fitter = TexelFitter(texels, unknowns, NOISE_ALONE)
    width = torch.full((3, len(tile)), 1e-12)
    fit = fitter.fit(tile, TexelPrior(torch.zeros_like(width), width))
    normal = fit.normal([*texels.rows, *texels.common])
    found = Elimination.of(fitter, fit)
    seen = tile.usable.unflatten(0, (tile.images, -1)).any(0)
    for number in seen.nonzero()[:5, 0].tolist():
        dense = normal.information[..., number].double()
        inverse = torch.linalg.inv(dense)
        # The block of the inverse is the inverse of the Schur complement.
        assert float(1 / inverse[3, 3]) == pytest.approx(float(found.information[0, 0, number]), rel=0.02)
        own = torch.linalg.inv(dense[:3, :3])
        torch.testing.assert_close(found.covariance[..., number].double(), own, rtol=0.01, atol=float(own.max()) * 1e-3)
