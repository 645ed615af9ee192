"""Bounded Gauss-Newton steps, and where iterating them ends."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.optimize import lsq_linear
from torch import Tensor

from matest.brdf import CookTorrance, Lambert, OrenNayar
from matest.capture import Capture
from matest.estimators import Problem, accumulate, at_bound, bounded_step
from matest.estimators.levenberg_marquardt import Evaluate, minimise
from matest.estimators.moments import SCORES
from matest.estimators.search import search
from matest.estimators.statistics import Statistics
from matest.photographs.noise import Noise
from tests.problems import information, problem, quadratic
from tests.simulated import Studio, coloured

# Of a step in standard errors: the condition number of the matrices below times rounding, with room.
STEP = 1e-7

BOUNDED = problem("cook-torrance", channels=2, free=("f0",))  # six unknowns, all bounded on both sides
OPEN = problem("cook-torrance", channels=2, relative=True)  # five, four of them open above


def reference(chosen: Problem, unknowns: Tensor, matrix: Tensor, gradient: Tensor) -> np.ndarray:
    """The minimiser of ½ d'Md − g'd inside the bounds, by trying every face of the box."""
    lower, upper = (chosen.lower - unknowns).numpy(), (chosen.upper - unknowns).numpy()
    m, g = matrix.numpy(), gradient.numpy()
    best, least = np.zeros(len(g)), np.inf
    for face in itertools.product((-1, 0, 1), repeat=len(g)):
        state = np.array(face)
        step = np.where(state < 0, lower, np.where(state > 0, upper, 0.0))
        if not np.isfinite(step).all():
            continue
        free = np.flatnonzero(state == 0)
        if len(free):
            step[free] = np.linalg.solve(m[np.ix_(free, free)], g[free] - m[free] @ step)
        slack = 1e-9 / np.sqrt(np.diag(m))
        if ((step < lower - slack) | (step > upper + slack)).any():
            continue
        cost = 0.5 * step @ m @ step - g @ step
        if cost < least:
            best, least = step, cost
    return best


def place(chosen: Problem, seed: int) -> Tensor:
    """Unknowns inside the domain, every third at one of its ends."""
    generator = torch.Generator().manual_seed(seed)
    upper = chosen.upper.clamp(max=3.0)
    share = torch.rand(chosen.size, generator=generator, dtype=torch.float64)
    choice = torch.randint(0, 6, (chosen.size,), generator=generator)
    share = torch.where(choice == 0, 0.0, torch.where((choice == 1) & torch.isfinite(chosen.upper), 1.0, share))
    return chosen.lower + share * (upper - chosen.lower)


def pull(matrix: Tensor, seed: int, strength: float) -> Tensor:
    """A gradient whose unbounded step is of the order of `strength`."""
    generator = torch.Generator().manual_seed(1000 + seed)
    return matrix @ (strength * torch.randn(len(matrix), generator=generator, dtype=torch.float64))


@pytest.mark.parametrize("strength", [0.01, 1.0, 10.0])
@pytest.mark.parametrize("chosen", [BOUNDED, OPEN], ids=["bounded", "open above"])
@pytest.mark.parametrize("seed", range(10))
def test_step_solves_the_quadratic_programme_in_the_box(seed: int, chosen: Problem, strength: float) -> None:
    matrix = information(chosen.size, seed)
    unknowns, gradient = place(chosen, seed), pull(matrix, seed, strength)
    step = bounded_step(chosen, unknowns, matrix, gradient)
    standard_error = matrix.diagonal().rsqrt().numpy()
    expected = reference(chosen, unknowns, matrix, gradient)
    largest = np.abs(expected / standard_error).max() + 1
    np.testing.assert_allclose(step.numpy() / standard_error, expected / standard_error, atol=STEP * largest, rtol=0)


@pytest.mark.parametrize("seed", range(10))
def test_step_agrees_with_scipy_in_twelve_dimensions(seed: int) -> None:
    chosen = problem("lambert+cook-torrance+torrance-sparrow", channels=3, free=("f0",))
    assert chosen.size == 12
    matrix = information(chosen.size, seed, condition=30.0)
    unknowns, gradient = place(chosen, seed), pull(matrix, seed, 1.0)
    scale = matrix.diagonal().sqrt()
    root = torch.linalg.cholesky(matrix / scale[:, None] / scale[None, :])
    target = torch.linalg.solve_triangular(root, (gradient / scale)[:, None], upper=False)[:, 0]
    # scipy asks for ends that differ; those that coincide with the unknowns are the point of half of them.
    bounds = ((chosen.lower - unknowns) * scale - 1e-12, (chosen.upper - unknowns) * scale + 1e-12)
    expected = lsq_linear(root.T.numpy(), target.numpy(), bounds, method="bvls", tol=1e-14).x
    step = bounded_step(chosen, unknowns, matrix, gradient) * scale
    np.testing.assert_allclose(step, expected, atol=STEP * (np.abs(expected).max() + 1), rtol=0)


def test_step_ends_inside_the_domain_to_the_last_bit() -> None:
    for seed in range(50):
        matrix = information(BOUNDED.size, seed)
        unknowns = place(BOUNDED, seed)
        target = unknowns + bounded_step(BOUNDED, unknowns, matrix, pull(matrix, seed, 3.0))
        assert bool(((target >= BOUNDED.lower - 1e-15) & (target <= BOUNDED.upper + 1e-15)).all())


def test_damping_adds_to_the_diagonal_in_units_of_itself() -> None:
    matrix = information(BOUNDED.size, 1)
    unknowns, gradient = 0.5 * (BOUNDED.lower + BOUNDED.upper), pull(matrix, 1, 1e-4)
    for damping in (0.1, 10.0):
        step = bounded_step(BOUNDED, unknowns, matrix, gradient, damping)
        damped = matrix + damping * torch.diag(matrix.diagonal())
        torch.testing.assert_close(step, torch.linalg.solve(damped, gradient), rtol=1e-8, atol=0)


def test_step_along_directions_without_information_is_finite() -> None:
    matrix = information(OPEN.size, 2)
    matrix[2] = matrix[:, 2] = 0
    matrix[4] = matrix[:, 4] = 0
    gradient = pull(matrix, 2, 0.1)
    step = bounded_step(OPEN, torch.full((OPEN.size,), 0.5, dtype=torch.float64), matrix, gradient)
    assert bool(torch.isfinite(step).all())
    assert step[2] == step[4] == 0


def test_two_unknowns_that_only_their_sum_is_known_of_share_the_step() -> None:
    chosen = problem("cook-torrance", fix={"slope": 0.2})
    matrix = torch.ones(2, 2, dtype=torch.float64)
    step = bounded_step(chosen, torch.tensor([0.2, 0.95], dtype=torch.float64), matrix, 0.4 * matrix[0])
    assert float(step.sum()) == pytest.approx(0.4, abs=1e-6)
    assert float(step[1]) <= 0.05 + 1e-12


def test_the_same_step_comes_out_to_the_last_bit_whatever_memory_held_before() -> None:
    matrix = information(OPEN.size, 3)
    unknowns, gradient = torch.full((OPEN.size,), 0.5, dtype=torch.float64), pull(matrix, 3, 0.1)

    def step_after_use_of_memory(number: int) -> bytes:
        used = [torch.full((count,), number, dtype=torch.int32) for count in range(1, 2 * OPEN.size)]
        del used
        return bounded_step(OPEN, unknowns, matrix, gradient).numpy().tobytes()

    assert len({step_after_use_of_memory(number % 3) for number in range(1000)}) == 1


def test_at_bound_needs_both_the_end_and_an_outward_pull() -> None:
    chosen = problem("cook-torrance")
    unknowns = torch.tensor([0.0, 1.0, 1.0], dtype=torch.float64)
    assert at_bound(chosen, unknowns, torch.tensor([-1.0, 1.0, -1.0]).double()).tolist() == [True, True, False]
    assert at_bound(chosen, unknowns, torch.tensor([1.0, -1.0, 1.0]).double()).tolist() == [False, False, True]
    middle = torch.full((3,), 0.5, dtype=torch.float64)
    assert not bool(at_bound(chosen, middle, torch.ones(3).double()).any())


def test_open_domains_have_no_upper_end_to_be_at() -> None:
    far = torch.full((OPEN.size,), 1e6, dtype=torch.float64)
    far[4] = 0.5
    assert not bool(at_bound(OPEN, far, torch.ones(OPEN.size).double()).any())


def test_a_linear_problem_is_solved_in_one_step() -> None:
    matrix = information(BOUNDED.size, 3)
    optimum = 0.4 * torch.ones(BOUNDED.size, dtype=torch.float64)
    start = 0.7 * torch.ones(BOUNDED.size, dtype=torch.float64)
    solution = minimise(BOUNDED, start, lambda u: quadratic(matrix, optimum, u), passes=10, tolerance=1e-3)
    assert solution.converged
    assert solution.iterations == 2
    left = optimum - solution.unknowns
    assert float((left @ matrix @ left).sqrt()) < 1e-3


def test_an_optimum_outside_the_domain_is_approached_to_its_bound() -> None:
    chosen = problem("cook-torrance")
    matrix = information(3, 4)
    optimum = torch.tensor([-0.3, 0.4, 0.5], dtype=torch.float64)
    start = torch.tensor([0.5, 0.5, 0.5], dtype=torch.float64)
    solution = minimise(chosen, start, lambda u: quadratic(matrix, optimum, u), passes=20, tolerance=1e-4)
    assert solution.converged
    expected = reference(chosen, start, matrix, matrix @ (optimum - start))
    np.testing.assert_allclose(solution.unknowns - start, expected, rtol=1e-5)
    assert at_bound(chosen, solution.unknowns, solution.statistics.gradient).tolist() == [True, False, False]


def test_statistics_of_a_solution_are_those_of_the_last_pass_a_short_step_away() -> None:
    matrix = information(3, 5)
    optimum = torch.tensor([0.3, 0.4, 0.5], dtype=torch.float64)
    seen: list[tuple[Tensor, Statistics]] = []

    def evaluate(unknowns: Tensor) -> Statistics:
        seen.append((unknowns, quadratic(matrix, optimum, unknowns)))
        return seen[-1][1]

    solution = minimise(problem("cook-torrance"), 0.9 * torch.ones(3).double(), evaluate, passes=9, tolerance=0.01)
    last, statistics = seen[-1]
    assert statistics is solution.statistics
    moved = solution.unknowns - last
    assert float((moved @ matrix @ moved).sqrt()) <= solution.last_step * (1 + 1e-9) < 0.01
    assert solution.iterations == len(seen)


def test_a_direction_without_information_is_not_followed_unseen() -> None:
    # A thousandth of a standard error, and over the whole domain.
    matrix = torch.diag(torch.tensor([1e6, 1e6, 1e-6], dtype=torch.float64))
    optimum = torch.tensor([0.5, 0.5, 1.0], dtype=torch.float64)
    start = torch.tensor([0.5, 0.5, 0.1], dtype=torch.float64)
    solution = minimise(
        problem("cook-torrance"), start, lambda u: quadratic(matrix, optimum, u), passes=9, tolerance=0.01
    )
    assert solution.converged
    assert solution.unknowns.tolist() == start.tolist()


def test_converged_means_that_the_next_step_is_short_however_many_samples_there_are() -> None:
    # Twelve colour photographs of a megapixel: half a standard error off, χ² falls by less than 1e-8 of itself.
    matrix = torch.eye(3, dtype=torch.float64) * 1e8
    optimum = torch.tensor([0.3, 0.4, 0.5], dtype=torch.float64)
    start = optimum + torch.tensor([0.5e-4, 0.0, 0.0], dtype=torch.float64)

    def evaluate(unknowns: Tensor) -> Statistics:
        statistics = quadratic(matrix, optimum, unknowns, floor=3.6e7)
        many = statistics.scores.clone()
        many[:, SCORES.index("values")] = 36_000_000
        return replace(statistics, scores=many)

    solution = minimise(problem("cook-torrance"), start, evaluate, passes=10, tolerance=0.03)
    assert solution.converged
    assert solution.last_step < 0.03
    assert float((solution.unknowns - optimum).abs().max()) < 0.03e-4


def test_passes_that_run_out_are_reported() -> None:
    evaluate, start = noisy_rough_sphere()
    solution = minimise(problem("oren-nayar", channels=3), start, evaluate, passes=1, tolerance=0.01)
    assert not solution.converged
    assert solution.iterations == 1
    assert solution.last_step > 1


def test_cost_never_rises_between_accepted_points() -> None:
    evaluate, start = noisy_rough_sphere()
    chosen = problem("oren-nayar", channels=3)
    costs = [
        minimise(chosen, start, evaluate, passes=passes, tolerance=1e-6).statistics.total("chi2")
        for passes in range(1, 7)
    ]
    # Where the descent has ended, two runs of it may differ in the last bit.
    assert all(after <= before * (1 + 1e-12) for before, after in itertools.pairwise(costs))
    assert costs[-1] < 0.5 * costs[0]


def noisy_rough_sphere() -> tuple[Evaluate, Tensor]:
    """Passes over photographs of an Oren-Nayar sphere, and unknowns far from the truth."""
    chosen = problem("oren-nayar", channels=3)
    capture = Studio(size=20, lights=coloured()[:3]).photograph(OrenNayar([0.7, 0.5, 0.3], 0.6), seed=1)
    tiles = capture.samples(dtype=torch.float64).tiles(merge=False)
    reference_point = torch.tensor([0.7, 0.5, 0.3, 0.6], dtype=torch.float64)
    start = torch.tensor([0.1, 0.9, 0.9, 0.05], dtype=torch.float64)
    return lambda unknowns: accumulate(chosen, unknowns, tiles, reference_point), start


def ends_of_descents(chosen: Problem, capture: Capture, least: float, most: float) -> tuple[list[Tensor], Tensor]:
    """Optima reached from starts whose shape lies between two values, and the standard errors there."""
    samples = capture.samples(dtype=torch.float64)
    tiles = samples.tiles(merge=False)
    found = search(chosen, list(samples.batches(10**5)))
    # Every other node of the grid, with its best amplitudes.
    (nodes,) = found.nodes
    starts = [found.unknowns_at(k, (value,)) for k, value in enumerate(nodes) if k % 2 == 0 and least < value < most]
    assert len(starts) >= 3
    ends = []
    for start in starts:
        solution = minimise(chosen, start, lambda u: accumulate(chosen, u, tiles, starts[0]), passes=60, tolerance=1e-4)
        assert solution.converged
        ends.append(solution.unknowns)
    best = accumulate(chosen, ends[0], tiles, starts[0])
    return ends, best.information.inverse().diagonal().sqrt()


def test_every_sigma_leads_to_the_same_optimum() -> None:
    truth = torch.tensor([0.7, 0.5, 0.3, 0.6], dtype=torch.float64)
    capture = Studio(size=24, lights=coloured()[:2]).photograph(OrenNayar([0.7, 0.5, 0.3], 0.6), seed=1)
    ends, standard_error = ends_of_descents(problem("oren-nayar", channels=3), capture, 0.0, 1.6)
    for end in ends:
        assert float(((end - ends[0]) / standard_error).abs().max()) < 1e-3
        assert float(((end - truth) / standard_error).abs().max()) < 5


def test_every_slope_of_the_right_magnitude_leads_to_the_same_optimum() -> None:
    truth = torch.tensor([0.3, 0.8, 0.2], dtype=torch.float64)
    capture = Studio(size=32).photograph(CookTorrance(0.3, 0.8, 0.2), seed=2)
    ends, standard_error = ends_of_descents(problem("cook-torrance"), capture, 0.05, 0.8)
    for end in ends:
        assert float(((end - ends[0]) / standard_error).abs().max()) < 1e-3
        assert float(((end - truth) / standard_error).abs().max()) < 5


def test_a_start_a_rounding_beside_a_bound_does_as_well_as_one_on_it() -> None:
    # Of a smooth surface the derivative for sigma is next to nothing beside 0, so that its step would cross the domain.
    chosen = problem("oren-nayar")
    tiles = Studio(size=24).photograph(OrenNayar(0.6, 0.0), seed=0).samples().tiles(merge=False)

    def end(sigma: float) -> Tensor:
        start = torch.tensor([0.55, sigma], dtype=torch.float64)
        solution = minimise(chosen, start, lambda u: accumulate(chosen, u, tiles, None), passes=30, tolerance=0.01)
        assert solution.converged
        return solution.unknowns

    assert torch.equal(end(5e-17), end(0.0))


def test_an_albedo_above_one_ends_at_its_bound() -> None:
    chosen = problem("lambert", channels=3)
    studio = Studio(size=24, lights=coloured(), noise=Noise(0.002, 0.0))
    tiles = studio.photograph(Lambert([0.9, 0.6, 0.5]), seed=4, brightness=1.3).samples().tiles(merge=False)
    start = torch.tensor([0.5, 0.5, 0.5], dtype=torch.float64)
    solution = minimise(chosen, start, lambda u: accumulate(chosen, u, tiles, None), passes=20, tolerance=0.01)
    assert solution.converged
    assert float(solution.unknowns[0]) == 1.0
    assert solution.unknowns[1:].tolist() == pytest.approx([0.78, 0.65], abs=0.002)
    assert at_bound(chosen, solution.unknowns, solution.statistics.gradient).tolist() == [True, False, False]


def test_where_every_unknown_is_held_there_is_no_step() -> None:
    gradient = torch.ones(BOUNDED.size, dtype=torch.float64)
    matrix = torch.eye(BOUNDED.size, dtype=torch.float64)
    assert not bool(bounded_step(BOUNDED, BOUNDED.upper, matrix, gradient).any())
    assert not bool(bounded_step(BOUNDED, BOUNDED.lower, 0 * matrix, gradient).any())
