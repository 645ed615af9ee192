"""The best free mixture of the columns of several models."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.optimize import nnls

from matest.brdf import Brdf, CookTorrance, Lambert, OrenNayar
from matest.estimation.options import Options
from matest.estimation.specification import specify_unknowns
from matest.estimators.mixture import Field, Mixture, non_negative
from matest.samples import Batch, Tile
from matest.samples.batch import join
from tests.simulated import Studio

EXPRESSIONS = ("oren-nayar", "cook-torrance")


def samples_of(material: Brdf) -> Batch:
    return join(Studio(size=48).photograph(material, seed=1).samples().pilot(3000, 0)).ungrouped


def mixture_of(batch: Batch) -> tuple[Field, Mixture]:
    problems = [
        specify_unknowns(expression, Options(), channels=1, relative=False).problem for expression in EXPRESSIONS
    ]
    with torch.no_grad():
        field = Field(problems, Tile(batch))
        return field, field.mixture(Tile(batch))


def test_weights_are_those_of_non_negative_least_squares() -> None:
    generator = np.random.default_rng(0)
    columns, measured = generator.random((200, 8)), generator.standard_normal((200, 3))
    gram = torch.from_numpy(np.repeat((columns.T @ columns)[None], 3, axis=0))
    weights = non_negative(gram, torch.from_numpy(measured.T @ columns))
    expected = np.stack([nnls(columns, channel)[0] for channel in measured.T])
    np.testing.assert_allclose(weights.numpy(), expected, atol=1e-9)
    assert (weights == 0).any()


def test_columns_that_are_equal_up_to_rounding_get_finite_weights() -> None:
    gram = torch.ones(1, 2, 2, dtype=torch.float64) + 1e-9 * torch.eye(2, dtype=torch.float64)
    weights = non_negative(gram, torch.tensor([[0.5, 0.5]], dtype=torch.float64))
    assert float(weights.sum()) == pytest.approx(0.5, rel=1e-3)


def test_a_column_without_light_gets_no_weight() -> None:
    gram = torch.tensor([[[1.0, 1e-20], [1e-20, 1e-30]]], dtype=torch.float64)
    weights = non_negative(gram, torch.tensor([[0.5, 1e-16]], dtype=torch.float64))
    assert weights.tolist() == [[pytest.approx(0.5), 0.0]]


@pytest.mark.parametrize("material", [Lambert(0.6), OrenNayar(0.7, 0.5), CookTorrance(0.3, 0.8, 0.25)])
def test_a_mixture_meets_a_material_of_its_models_to_the_noise(material: Brdf) -> None:
    _, mixture = mixture_of(samples_of(material))
    # Widths between the nodes are mixed from those beside them.
    assert mixture.cost / mixture.values < 1.15
    assert float(mixture.residual_scale.values.max()) < 1.1


def test_outliers_do_not_mislead_a_mixture() -> None:
    batch = samples_of(OrenNayar(0.7, 0.5))
    spoilt = batch.radiance.clone()
    spoilt[::100] = 1.5
    _, mixture = mixture_of(replace(batch, radiance=spoilt))
    assert mixture.cost / mixture.values < 1.15
    assert bool((mixture.squares.weight[::100] == 0).double().mean() > 0.9)


def test_the_search_on_a_field_leads_beside_the_truth() -> None:
    field, _ = mixture_of(samples_of(OrenNayar(0.7, 0.5)))
    search = field.search(0)
    start = search.starts(1)[0]
    assert float(start[search.problem.where["sigma"]]) == pytest.approx(0.5, abs=0.06)
    assert float(start[search.problem.where["albedo"]]) == pytest.approx(0.7, abs=0.02)
    assert field.cost(search) < field.cost(field.search(1))


def test_a_part_unlike_the_others_is_missed_when_a_mixture_is_fitted_without_it() -> None:
    batch = samples_of(OrenNayar(0.7, 0.5))
    groups = torch.arange(len(batch)) * 3 // len(batch)
    radiance = torch.where((groups == 1)[:, None], 1.1, 1.0) * batch.radiance
    field, mixture = mixture_of(replace(batch, radiance=radiance, groups=groups))
    costs = field.costs_left_out(mixture)
    counts = groups.bincount()
    assert float(costs.sum()) > mixture.cost
    assert float(costs[1] / counts[1]) > 1.5 * float((costs[0] + costs[2]) / (counts[0] + counts[2]))


def test_parts_left_out_of_a_mixture_that_holds_are_met_to_the_noise() -> None:
    batch = samples_of(OrenNayar(0.7, 0.5))
    field, mixture = mixture_of(replace(batch, groups=torch.arange(len(batch)) * 3 // len(batch)))
    assert mixture.cost < float(field.costs_left_out(mixture).sum()) < 1.05 * mixture.cost
