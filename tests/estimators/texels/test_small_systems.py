"""Small systems, many at once: LAPACK's answers."""

from __future__ import annotations

import pytest
import torch

from matest.estimators.texels.small_systems import Factored


@pytest.mark.parametrize("size", [1, 2, 5])
def test_solutions_and_inverses_are_those_of_lapack(size: int) -> None:
    generator = torch.Generator().manual_seed(size)
    jacobian = torch.randn(40, 12, size, generator=generator, dtype=torch.float64)
    matrices = jacobian.mT @ jacobian
    right = torch.randn(40, size, 3, generator=generator, dtype=torch.float64)
    factored = Factored.of(matrices.permute(1, 2, 0))
    torch.testing.assert_close(
        factored.solve(right.permute(1, 2, 0)).permute(2, 0, 1), torch.linalg.solve(matrices, right)
    )
    torch.testing.assert_close(factored.inverse().permute(2, 0, 1), torch.linalg.inv(matrices))


def test_a_singular_system_has_a_finite_answer() -> None:
    matrices = torch.ones(2, 2, 3, dtype=torch.float64)
    assert bool(Factored.of(matrices).solve(torch.ones(2, 3, dtype=torch.float64)).isfinite().all())
