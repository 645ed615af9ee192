"""Terms: factors times a shape."""

from __future__ import annotations

import math

import pytest
import torch

from matest.brdf.terms import Factor, Term, complement_of, lambertian, mixture


def test_a_term_takes_names_for_factors_and_complements() -> None:
    values = {"k": torch.tensor(0.2), "f0": torch.tensor(0.3)}
    term = Term(("k", complement_of("f0")), torch.ones(1))
    assert term.factors == (Factor("k"), Factor("f0", complement=True))
    assert math.prod(float(factor.value(values)) for factor in term.factors) == pytest.approx(0.2 * 0.7)
    assert [factor.slope for factor in term.factors] == [1.0, -1.0]
    assert [factor.name for factor in term.within("lobe").factors] == ["lobe.k", "lobe.f0"]
    assert term.within("lobe").factors[1].complement


@pytest.mark.parametrize("shape", [(5,), (1, 5), (3, 5), (7, 1, 5), (7, 3, 5)])
def test_mixture_is_the_sum_of_its_columns_with_their_weights(shape: tuple[int, ...]) -> None:
    generator = torch.Generator().manual_seed(4)
    columns = torch.rand(7, 5, generator=generator, dtype=torch.float64)
    weights = torch.rand(shape, generator=generator, dtype=torch.float64)
    term = mixture(("albedo",), columns, weights)
    expected = (columns[:, None] * weights).sum(-1)
    torch.testing.assert_close(term.shape, expected)
    assert term.columns is columns
    assert term.weights is weights


def test_a_lambertian_term_is_one_over_pi_in_every_direction() -> None:
    term = lambertian(("albedo", complement_of("specular")), torch.ones(4, 1, dtype=torch.float32))
    assert term.factors == (Factor("albedo"), Factor("specular", complement=True))
    torch.testing.assert_close(term.shape, torch.full((4, 1), 1 / math.pi), rtol=0, atol=0)
