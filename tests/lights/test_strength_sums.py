from __future__ import annotations

import numpy as np
import pytest

from matest.lights.strength_sums import Sums


def problem(slope: bool = False) -> Sums:
    generator = np.random.default_rng(0)
    share, radiance = generator.uniform(0.1, 1, (3, 40)), generator.uniform(0, 1, (3, 40, 2))
    weights = generator.uniform(0, 1, (3, 40, 2))
    slopes = generator.standard_normal((3, 40)) if slope else None
    return Sums(share, radiance, weights, np.arange(40) % 4, slopes)


def dense(sums: Sums, channel: int, keep: np.ndarray) -> np.ndarray:
    """Powers and the common light of a channel, by one least squares of everything."""
    rows, values = [], []
    for image in range(3):
        root = np.sqrt(sums.weights[image, keep, channel])
        own = np.zeros((keep.sum(), 4))
        own[:, image], own[:, 3] = sums.share[image, keep], 1
        rows.append(root[:, None] * own)
        values.append(root * sums.radiance[image, keep, channel])
    solution: np.ndarray = np.linalg.lstsq(np.concatenate(rows), np.concatenate(values), rcond=None)[0]
    return solution


@pytest.mark.parametrize("channel", [0, 1])
def test_powers_are_those_of_one_least_squares(channel: int) -> None:
    sums = problem()
    expected = dense(sums, channel, np.ones(40, dtype=bool))
    np.testing.assert_allclose(sums.solve()[:, channel], expected[:3], rtol=1e-9)
    model, residual = sums.residuals(sums.solve())
    np.testing.assert_allclose(model + residual, sums.radiance)
    np.testing.assert_allclose(model[0, :, channel], expected[0] * sums.share[0] + expected[3], rtol=1e-9)
    assert sums.cost() == pytest.approx((sums.weights * residual**2).sum())


def test_a_cell_is_left_out_by_subtraction() -> None:
    sums = problem()
    without = sums.without_cells()
    for cell in range(4):
        np.testing.assert_allclose(without[cell, :, 0], dense(sums, 0, sums.cell != cell)[:3], rtol=1e-9)


def test_a_free_parameter_is_common_to_channels() -> None:
    """Radiance with an error of the parameter is explained by it, so that powers are right without every cell."""
    sums = problem(slope=True)
    assert sums.slope is not None
    power = np.array([[1.0, 2.0], [3.0, 1.5], [0.5, 1.0]])
    shifted = sums.share + 0.01 * sums.slope
    exact = Sums(sums.share, power[:, None] * shifted[..., None] + 0.2, sums.weights, sums.cell, sums.slope)
    for found in exact.without_cells():
        assert np.abs(found / power - 1).max() < 0.01
