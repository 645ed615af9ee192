"""An albedo at every texel beside a shape in common: the elimination is exact, error bars are those of the errors."""

from __future__ import annotations

import pytest
import torch

from matest.benchmark.instruments import miscalibration as off
from matest.brdf import OrenNayar
from matest.estimators import fit
from matest.estimators.maps import TexelFit, fit_maps
from tests.estimation.test_diagnosis import capture_of
from tests.problems import problem

MATERIAL = OrenNayar([0.7, 0.5, 0.3], 0.4)


def mapped(seed: int, error: off.Error | None = None) -> TexelFit:
    samples = capture_of(error or off.smooth_albedo(0.1), seed).photographs.samples()
    chosen = problem("oren-nayar", channels=3)
    unknowns = fit(chosen, samples, 0).unknowns
    few, _ = samples.of_pixels(1_000, 0)
    return fit_maps(chosen, unknowns, ["albedo"], few, samples.single_pixels(), samples.texels)


def test_the_shape_in_common_is_right_though_the_albedo_varies() -> None:
    found = mapped(1)
    sigma = found.problem.where["sigma"]
    assert found.converged
    assert found.chi2 == pytest.approx(1, abs=0.03)
    error = float(found.unknowns[sigma] - 0.4) / float(found.covariance.std[sigma])
    assert abs(error) < 4


def test_albedos_scatter_about_the_truth_as_their_error_bars_say() -> None:
    found = mapped(2, off.together())
    values = found.factors.double() * found.unknowns[found.problem.where["albedo"]]
    stds = found.factor_std.double() * found.unknowns[found.problem.where["albedo"]]
    errors = ((values - torch.tensor([0.7, 0.5, 0.3])) / stds)[values.isfinite()]
    assert float(errors.square().mean().sqrt()) == pytest.approx(1, abs=0.05)
    assert float((errors.abs() < 1.96).double().mean()) == pytest.approx(0.95, abs=0.01)


def test_texels_that_no_photograph_shows_have_no_value() -> None:
    found = mapped(3)
    assert bool((found.factors.isnan() == ~found.sums.seen).all())
    assert bool((found.factor_std.isnan() == ~found.sums.seen).all())
    assert 0.5 < float(found.sums.seen.double().mean()) < 1


def test_eliminating_texels_is_the_dense_solution() -> None:
    """Information and scores of the shape, of all unknowns together and with the factors eliminated."""
    found = mapped(4)
    sums, sigma = found.sums, found.problem.where["sigma"].start
    column = found.problem.free.index("sigma")
    cross, own = sums.cross[..., column].double(), sums.information.double()
    seen = own > 0
    expected = float(sums.common[sigma, sigma]) - float((cross[seen] ** 2 / own[seen]).sum())
    information, scores = found.sums_in_common
    assert float(information[sigma, sigma]) == pytest.approx(expected, rel=1e-4)
    size = float(information[sigma, sigma]) ** 0.5
    assert abs(float(scores[sigma])) < size
