"""Reflectance of an interface."""

from __future__ import annotations

import mpmath
import pytest
import torch
from mpmath import mpf
from torch import Tensor

from matest.brdf.fresnel import dielectric
from tests import tolerances
from tests.exact import relative_deviation


def textbook(cos_i: float, f0: float) -> mpf:
    """½ [sin²(θi−θt)/sin²(θi+θt) + tan²(θi−θt)/tan²(θi+θt)], θt by Snell's law."""
    root = mpmath.sqrt(mpf(f0))
    theta_i = mpmath.acos(mpf(cos_i))
    theta_t = mpmath.asin(mpmath.sin(theta_i) * (1 - root) / (1 + root))
    minus, plus = theta_i - theta_t, theta_i + theta_t
    return ((mpmath.sin(minus) / mpmath.sin(plus)) ** 2 + (mpmath.tan(minus) / mpmath.tan(plus)) ** 2) / 2


def evaluate(cos_d: list[float], f0: float) -> Tensor:
    return dielectric(torch.tensor(cos_d, dtype=torch.float64), torch.tensor(f0, dtype=torch.float64))


@pytest.mark.parametrize("f0", [1e-5, 0.02, 0.04, 0.5, 0.99])
def test_textbook_formula_in_fifty_digits(f0: float) -> None:
    cosines = torch.linspace(0.001, 0.999, 41, dtype=torch.float64).tolist()
    deviation = relative_deviation(evaluate(cosines, f0), [textbook(c, f0) for c in cosines])
    assert deviation < tolerances.INDEPENDENT


@pytest.mark.parametrize("f0", [1e-5, 0.04, 0.99])
def test_normal_incidence_gives_f0(f0: float) -> None:
    assert evaluate([1.0], f0).item() == pytest.approx(f0, rel=tolerances.INDEPENDENT)


@pytest.mark.parametrize("f0", [0.0, 1e-5, 0.04, 0.99, 1.0])
def test_grazing_incidence_reflects_everything(f0: float) -> None:
    assert evaluate([0.0], f0).item() == pytest.approx(1, rel=tolerances.INDEPENDENT)


def test_brewster_angle_reflects_one_polarisation_only() -> None:
    index = 1.5
    cos_b = (1 / (1 + index**2)) ** 0.5
    senkrecht = ((index**2 - 1) / (index**2 + 1)) ** 2
    assert evaluate([cos_b], 0.04).item() == pytest.approx(senkrecht / 2, rel=tolerances.INDEPENDENT)


@pytest.mark.parametrize("f0", [0.0, 0.04, 1.0])
def test_reflectance_is_at_most_one(f0: float) -> None:
    values = evaluate(torch.linspace(0, 1, 1001).tolist(), f0)
    assert (values >= 0).all()
    assert (values <= 1 + tolerances.INDEPENDENT).all()


def test_ends_of_f0_have_finite_derivatives() -> None:
    f0 = torch.tensor([0.0, 1e-6, 1 - 1e-4, 1.0], requires_grad=True)
    dielectric(torch.linspace(0, 1, 11)[:, None], f0).sum().backward()
    assert f0.grad is not None
    assert f0.grad.isfinite().all()
