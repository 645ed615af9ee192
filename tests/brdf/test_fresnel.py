"""Reflectance of an interface."""

from __future__ import annotations

import mpmath
import pytest
import torch
from mpmath import mpf
from torch import Tensor

from matest.brdf.fresnel import colour_shift_weight, conductor, dielectric, schlick_weight
from tests import tolerances
from tests.brdf import microsurface
from tests.exact import relative_deviation

# Reddish, white and grey metals, the ends of the domain, and glass.
INDICES = [(1.13, 2.56), (0.24, 3.63), (0.96, 6.69), (3.46, 2.72), (0.05, 0.3), (10.0, 12.0), (1.5, 0.0)]
COSINES = torch.linspace(0.001, 1.0, 37, dtype=torch.float64)


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


def metal(cos_d: Tensor, eta: float, k: float) -> Tensor:
    return conductor(cos_d, *torch.tensor([eta, k], dtype=cos_d.dtype))


@pytest.mark.parametrize(("eta", "k"), [*INDICES, (0.5, 1e-3), (0.5, 0.0)])
def test_conductor_is_snells_law_with_a_complex_index_in_fifty_digits(eta: float, k: float) -> None:
    expected = [microsurface.conductor(mpf(c), eta, k) for c in COSINES.tolist()]
    assert relative_deviation(metal(COSINES, eta, k), expected) < tolerances.INDEPENDENT


@pytest.mark.parametrize("eta", [1.2, 1.5, 3.0])
def test_conductor_without_extinction_is_the_dielectric(eta: float) -> None:
    f0 = torch.tensor(((eta - 1) / (eta + 1)) ** 2, dtype=torch.float64)
    torch.testing.assert_close(
        metal(COSINES, eta, 0.0), dielectric(COSINES, f0), rtol=tolerances.INDEPENDENT, atol=tolerances.INDEPENDENT
    )


@pytest.mark.parametrize(("eta", "k"), INDICES)
def test_conductor_at_normal_and_grazing_incidence(eta: float, k: float) -> None:
    normal = ((eta - 1) ** 2 + k**2) / ((eta + 1) ** 2 + k**2)
    ends = metal(torch.tensor([1.0, 0.0], dtype=torch.float64), eta, k).tolist()
    assert ends == pytest.approx([normal, 1.0], rel=tolerances.INDEPENDENT)


def test_index_below_one_reflects_totally_beyond_the_critical_angle() -> None:
    eta = 0.6
    critical = (1 - eta**2) ** 0.5
    inside, outside = metal(torch.tensor([0.95 * critical, 1.05 * critical], dtype=torch.float64), eta, 0.0).tolist()
    assert inside == pytest.approx(1, rel=tolerances.INDEPENDENT)
    assert outside < 0.7


def test_metal_reflects_little_less_away_from_the_normal_than_at_it() -> None:
    """Unlike the dielectric of the same normal reflectance, which dips by 0.2 at its Brewster angle."""
    values = metal(COSINES, 0.24, 3.63)
    effective = dielectric(COSINES, values[-1])
    assert values.min() > values[-1] - 0.02
    assert effective.min() < values[-1] - 0.2


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32], ids=["float64", "float32"])
def test_conductor_has_finite_derivatives_at_every_end(dtype: torch.dtype) -> None:
    """At k = 0, below, at and above the critical angle, grazing and normal."""
    eta = torch.tensor([0.05, 0.6, 0.8, 1.0, 1.5, 10.0], dtype=dtype)
    k = torch.tensor([0.0, 1e-20, 1e-6, 0.8, 12.0], dtype=dtype)
    # For n = 0.6 the critical angle has cosine 0.8, for n = 0.8 it has 0.6.
    c = torch.tensor([0.0, 1e-7, 0.6, 0.8, 1 - 1e-7, 1.0], dtype=dtype)
    leaves = [x.clone().requires_grad_() for x in torch.meshgrid(c, eta, k, indexing="ij")]
    values = conductor(*leaves)
    assert (values >= 0).all()
    assert (values <= 1 + 1e-6).all()
    for gradient in torch.autograd.grad(values.sum(), leaves):
        assert gradient.isfinite().all()


@pytest.mark.parametrize("c", [0.0, 0.3, 1.0])
def test_derivatives_of_the_conductor_agree_with_differences_of_fifty_digits(c: float) -> None:
    for eta, k in [(0.24, 3.63), (0.6, 1e-3), (1.5, 0.0), (0.6, 0.0)]:
        leaves = [torch.tensor(value, dtype=torch.float64, requires_grad=True) for value in (c, eta, k)]
        gradients = torch.autograd.grad(conductor(*leaves), leaves)
        step = mpf("1e-20")
        for i in (1, 2):
            at = [mpf(c), mpf(eta), mpf(k)]
            here = microsurface.conductor(*at)
            at[i] += step
            there = microsurface.conductor(*at)
            assert gradients[i].item() == pytest.approx(float((there - here) / step), rel=1e-9, abs=1e-9)


def test_schlick_in_fifty_digits() -> None:
    f0 = 0.3
    actual = f0 + (1 - f0) * schlick_weight(1 - COSINES)
    expected = [microsurface.schlick(mpf(c), f0) for c in COSINES.tolist()]
    assert relative_deviation(actual, expected) < tolerances.INDEPENDENT


def test_schlick_is_near_glass() -> None:
    f0 = torch.tensor(0.04, dtype=torch.float64)
    approximate = f0 + (1 - f0) * schlick_weight(1 - COSINES)
    assert (approximate - dielectric(COSINES, f0)).abs().max() < 0.05


@pytest.mark.parametrize("f0_mean", [0.02, 0.3, 0.6, 0.95])
def test_colour_shift_in_fifty_digits(f0_mean: float) -> None:
    weight = colour_shift_weight(COSINES, torch.tensor(f0_mean, dtype=torch.float64))
    expected = [microsurface.colour_shift(mpf(c), 0.0, f0_mean) for c in COSINES.tolist()]
    torch.testing.assert_close(
        weight,
        torch.tensor([float(e) for e in expected], dtype=torch.float64),
        rtol=tolerances.INDEPENDENT,
        atol=tolerances.INDEPENDENT,
    )


@pytest.mark.parametrize("f0_mean", [0.02, 0.3, 0.95])
def test_colour_shift_ends_at_the_colours_of_metal_and_light(f0_mean: float) -> None:
    ends = colour_shift_weight(torch.tensor([1.0, 0.0], dtype=torch.float64), torch.tensor(f0_mean).double())
    assert ends.tolist() == pytest.approx([0, 1], abs=tolerances.INDEPENDENT)


def test_brewster_dip_of_the_average_shifts_no_colour() -> None:
    f0_mean = torch.tensor(0.6, dtype=torch.float64)
    cos_d = torch.linspace(0.3, 0.8, 20, dtype=torch.float64)
    assert (dielectric(cos_d, f0_mean) < f0_mean).all()
    assert (colour_shift_weight(cos_d, f0_mean) == 0).all()
