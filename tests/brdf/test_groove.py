"""One V-cavity: Oren & Nayar 1994, eq. 4-11."""

from __future__ import annotations

import math

import pytest
import torch
from mpmath import mpf
from torch import Tensor

from matest.brdf import groove
from tests import tolerances
from tests.brdf import cavity
from tests.exact import Geometry, angles_and_directions, relative_deviation

# Flat, where eq. 11 as printed cancels in floating point, to steeper than any roof.
SLOPES = [1e-4, 0.01, 0.3, 0.8, 1.2, 1.5]
# A facet turned away, edge-on, level, upright, shadowed in part, and almost entirely.
HARD = [-1e6, -1.0, 0.0, 1e-12, 0.5, 1 - 1e-12, 1.0, 1 + 1e-12, 2.0, 1e6]


def bounces(t: Tensor, psi: Tensor, wi: Tensor, wo: Tensor) -> tuple[Tensor, Tensor]:
    """Mean over both facets of a groove across ψ, once and twice reflected."""
    across = torch.stack([psi.cos(), psi.sin()], dim=-1)
    p, q = (0.5 * (1 + t.tan() * (across * w[..., :2]).sum(-1) / w[..., 2]) for w in (wi, wo))
    return groove.direct(t.cos(), p, q), groove.interreflection(t.sin().square(), t.cos(), p, q)


def random_grooves(t: float, seed: int, n: int = 40) -> tuple[list[tuple[Geometry, mpf, mpf]], tuple[Tensor, Tensor]]:
    geometries, wi, wo = angles_and_directions(n, seed)
    psi = 2 * math.pi * torch.rand(n, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    grooves = [(g, mpf(t), mpf(azimuth)) for g, azimuth in zip(geometries, psi.tolist(), strict=True)]
    return grooves, bounces(torch.full_like(psi, t), psi, wi, wo)


def at_hard_places(dtype: torch.dtype) -> list[Tensor]:
    """sin² t, cos t, P and Q in every combination, recording derivatives by t, P and Q."""
    t = torch.tensor([0.0, 1e-6, 0.3, math.radians(89)], dtype=dtype)
    hard = torch.tensor(HARD, dtype=dtype)
    return [x.clone().requires_grad_() for x in torch.meshgrid(t, hard, hard, indexing="ij")]


@pytest.mark.parametrize("t", SLOPES)
def test_printed_direct_light_in_fifty_digits(t: float) -> None:
    grooves, (once, _) = random_grooves(t, seed=1)
    printed = [
        (cavity.printed_direct(*at) + cavity.printed_direct(*at[:2], at[2] + mpf(math.pi))) / 2 for at in grooves
    ]
    assert relative_deviation(once, printed) < tolerances.INDEPENDENT


@pytest.mark.parametrize("t", SLOPES)
def test_printed_closed_form_of_the_second_bounce_in_fifty_digits(t: float) -> None:
    grooves, (_, twice) = random_grooves(t, seed=2)
    printed = [
        (cavity.printed_second(*at) + cavity.printed_second(*at[:2], at[2] + mpf(math.pi))) / 2 for at in grooves
    ]
    assert relative_deviation(twice, printed) < tolerances.INDEPENDENT


def test_random_grooves_meet_every_case_of_shadow_and_mask() -> None:
    grooves, _ = random_grooves(0.8, seed=2)
    limits = [cavity.widths(*at) for at in grooves]
    cases = {None if pair is None else (pair[0] > 0, pair[1] > 0) for pair in limits}
    assert cases == {None, (False, False), (False, True), (True, False), (True, True)}


@pytest.mark.parametrize("t", [0.3, 1.0])
def test_second_bounce_is_the_printed_double_integral(t: float) -> None:
    grooves, (_, twice) = random_grooves(t, seed=3, n=8)
    printed = [
        sum(cavity.printed_second(g, t, psi + side, cavity.interreflection_integral) for side in (0, mpf(math.pi))) / 2
        for g, t, psi in grooves
    ]
    assert relative_deviation(twice, printed) < tolerances.NORMALISATION


@pytest.mark.parametrize("t", [1e-4, 0.3, 1.0, 1.5])
def test_facing_facets_exchange_the_form_factor_of_a_v(t: float) -> None:
    """1 − cos t of what one facet sends reaches the other; both are lit and seen at cos t."""
    slope, half = torch.tensor(t, dtype=torch.float64), torch.tensor(0.5, dtype=torch.float64)
    twice = groove.interreflection(slope.sin().square(), slope.cos(), half, half).item()
    assert twice == pytest.approx(2 * math.sin(t / 2) ** 2 * math.cos(t), rel=tolerances.INDEPENDENT)


@pytest.mark.parametrize(("p", "q"), [(1.5, -0.5), (1.0, 0.0), (-0.5, 1.5)])
def test_light_from_one_side_is_seen_from_the_other_by_reflection_twice_only(p: float, q: float) -> None:
    cos_t, p_q = torch.tensor(0.8, dtype=torch.float64), torch.tensor([p, q], dtype=torch.float64)
    assert groove.direct(cos_t, *p_q).item() == 0
    assert groove.interreflection(1 - cos_t.square(), cos_t, *p_q).item() > 0.05


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32], ids=["float64", "float32"])
def test_derivatives_are_finite_at_every_kink(dtype: torch.dtype) -> None:
    t, p, q = at_hard_places(dtype)
    for bounce in (groove.direct(t.cos(), p, q), groove.interreflection(t.sin().square(), t.cos(), p, q)):
        assert (bounce >= 0).all()
        for gradient in torch.autograd.grad(bounce.sum(), (t, p, q)):
            assert gradient.isfinite().all()


@pytest.mark.parametrize("kink", [0.0, 0.5, 1.0])
def test_no_bounce_jumps_where_its_case_changes(kink: float) -> None:
    slope = torch.tensor(0.8, dtype=torch.float64)
    q = torch.tensor([-0.4, 0.3, 0.5, 0.9, 1.6], dtype=torch.float64)
    below, above = torch.full_like(q, kink - 1e-9), torch.full_like(q, kink + 1e-9)
    for bounce in (
        lambda p: groove.direct(slope.cos(), p, q),
        lambda p: groove.interreflection(slope.sin().square(), slope.cos(), p, q),
    ):
        torch.testing.assert_close(bounce(below), bounce(above), rtol=0, atol=1e-8)  # slope of a few times 2e-9
