"""The global search: no start is asked for, and none is needed."""

from __future__ import annotations

import itertools
import math

import pytest
import torch
from torch import Tensor

from matest.brdf import Brdf, CookTorrance, OrenNayar, TorranceSparrow
from matest.estimators import Problem, accumulate
from matest.estimators.basis import TangentBasis
from matest.estimators.levenberg_marquardt import Solution, minimise
from matest.estimators.search import Search, normal_equations, search
from matest.photographs.pilot import pilot
from matest.samples import Batch, Tile
from matest.samples.tiles import in_memory
from tests.problems import problem
from tests.simulated import Studio, coloured

# Where descents from the starts must end: photographs are float32, so are the samples.
ARRIVES = 1e-3


def batches(material: Brdf, *, brightness: float = 1.0, relative: bool = False) -> list[Batch]:
    studio = Studio(size=32, lights=coloured(), relative=relative)
    return pilot(studio.photograph(material, brightness=brightness).samples(), 4000, seed=0)


def uniform(lower: float, upper: float, seed: int) -> float:
    return lower + (upper - lower) * float(torch.rand((), generator=torch.Generator().manual_seed(seed)))


def descend(found: Search, start: Tensor, measured: list[Batch]) -> Solution:
    tiles = in_memory(measured)
    return minimise(
        found.problem, start, lambda u: accumulate(found.problem, u, tiles, None), passes=60, tolerance=1e-3
    )


def best_descent(found: Search, measured: list[Batch]) -> Solution:
    return min(
        (descend(found, start, measured) for start in found.starts()),
        key=lambda solution: solution.statistics.total("chi2"),
    )


def inside(chosen: Problem, unknowns: Tensor) -> bool:
    return bool(((unknowns >= chosen.lower) & (unknowns <= chosen.upper)).all())


@pytest.mark.parametrize("seed", range(8))
def test_a_start_lies_in_the_basin_of_the_true_sigma(seed: int) -> None:
    sigma = uniform(0.03, 1.2, seed)
    measured = batches(OrenNayar([0.7, 0.5, 0.2], sigma))
    found = search(problem("oren-nayar", channels=3), measured)
    solution = best_descent(found, measured)
    assert solution.converged
    assert float(solution.unknowns[3]) == pytest.approx(sigma, abs=ARRIVES)
    assert solution.unknowns[:3].tolist() == pytest.approx([0.7, 0.5, 0.2], abs=ARRIVES)


@pytest.mark.parametrize("seed", range(8))
def test_a_start_lies_in_the_basin_of_the_true_slope(seed: int) -> None:
    slope = 10 ** uniform(math.log10(0.05), math.log10(0.7), seed)
    measured = batches(CookTorrance([0.3, 0.2, 0.1], 0.8, slope))
    found = search(problem("cook-torrance", channels=3), measured)
    solution = best_descent(found, measured)
    values = found.problem.values(solution.unknowns)
    assert float(values["slope"]) == pytest.approx(slope, rel=ARRIVES)
    assert values["specular"].tolist() == pytest.approx([0.8] * 3, rel=ARRIVES)


@pytest.mark.parametrize("seed", range(3))
def test_a_start_lies_in_the_basin_of_two_shapes_at_once(seed: int) -> None:
    sigma, spread = uniform(0.2, 0.8, seed), uniform(0.05, 0.3, 100 + seed)
    measured = batches(OrenNayar([0.6, 0.5, 0.4], sigma) + TorranceSparrow(0.05, spread))
    found = search(problem("oren-nayar+torrance-sparrow", channels=3), measured)
    values = found.problem.values(best_descent(found, measured).unknowns)
    assert float(values["oren-nayar.sigma"]) == pytest.approx(sigma, abs=ARRIVES)
    assert float(values["torrance-sparrow.sigma"]) == pytest.approx(spread, abs=ARRIVES)


def test_the_best_start_is_the_best_node_of_the_grid() -> None:
    found = search(problem("oren-nayar", channels=3), batches(OrenNayar(0.6, 0.5)))
    best = int(found.cost.argmin())
    first = found.starts()[0]
    assert float(first[3]) == found.nodes[0][best]
    assert torch.equal(first[:3], found.solved[best, :, 0])
    assert abs(found.nodes[0][best] - 0.5) <= found.nodes[0][1] - found.nodes[0][0]


def test_starts_differ_and_lie_within_the_bounds() -> None:
    found = search(problem("oren-nayar+torrance-sparrow", channels=3), batches(OrenNayar(0.6, 0.5)))
    starts = found.starts()
    assert len(starts) == 3
    assert len({tuple(start[found.problem.where["oren-nayar.sigma"]].tolist()) for start in starts}) > 1
    assert all(inside(found.problem, start) for start in starts)


def test_a_model_without_shapes_starts_at_its_solution() -> None:
    material = CookTorrance([0.3, 0.2, 0.1], 0.6, 0.2)
    found = search(problem("cook-torrance", channels=3, fix={"slope": 0.2}), batches(material))
    (start,) = found.starts()
    assert start.tolist() == pytest.approx([0.3, 0.2, 0.1, 0.6, 0.6, 0.6], abs=1e-5)


def test_a_grid_over_decades_is_logarithmic() -> None:
    found = search(problem("cook-torrance", channels=3), batches(CookTorrance(0.3)))
    (slopes,) = found.nodes
    ratios = {round(b / a, 6) for a, b in itertools.pairwise(slopes)}
    assert len(ratios) == 1
    assert slopes[0] >= 1e-3
    assert slopes[-1] < 1


@pytest.mark.parametrize("brightness", [0.2, 1.0, 3.0])
def test_an_unknown_light_scale_is_told_from_albedo(brightness: float) -> None:
    measured = batches(OrenNayar([0.8, 0.5, 0.2], 0.7), brightness=brightness, relative=True)
    found = search(problem("oren-nayar", channels=3, relative=True), measured)
    values = found.problem.values(best_descent(found, measured).unknowns)
    assert float(values["sigma"]) == pytest.approx(0.7, rel=ARRIVES)
    assert values["albedo"].tolist() == pytest.approx([brightness * rho for rho in (0.8, 0.5, 0.2)], rel=ARRIVES)
    assert float(values["interreflection"]) == pytest.approx(1 / brightness, rel=10 * ARRIVES)


@pytest.mark.parametrize("brightness", [0.2, 3.0])
def test_the_light_scale_leaves_room_for_a_facet_that_reflects_all_light(brightness: float) -> None:
    measured = batches(OrenNayar([0.9, 0.5, 0.2], 0.4), brightness=brightness, relative=True)
    found = search(problem("oren-nayar", channels=3, relative=True), measured)
    limit = found.problem.light_scale_limit
    # The limit takes the brightest albedo for that of a surface without second bounce, which is a little brighter.
    assert 1 / (1.1 * 0.9 * brightness) < limit <= 1.05 / (0.9 * brightness)
    assert all(inside(found.problem, start) for start in found.starts())


@pytest.mark.parametrize(
    "expression",
    ["cook-torrance(fresnel=schlick)", "li-torrance", "lafortune", "oren-nayar-single-slope", "blinn-phong+ward"],
)
@pytest.mark.parametrize("together", [1 << 16, 1000])
def test_nodes_that_are_evaluated_together_give_what_each_gives_alone(
    expression: str, together: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A thousand: the last call has fewer nodes than the others.
    monkeypatch.setattr("matest.estimators.search._EVALUATED_TOGETHER", together)
    chosen = problem(expression, channels=3)
    measured = [batch[::20] for batch in batches(CookTorrance(0.3))]
    generator = torch.Generator().manual_seed(0)
    points = [
        torch.full((chosen.size,), 0.5).double() + 0.4 * torch.rand(chosen.size, generator=generator).double()
        for _ in range(5)
    ]
    _, gram, moment = normal_equations(chosen, measured, points)
    for number, unknowns in enumerate(points):
        alone = TangentBasis(chosen, unknowns, derivatives=False)
        expected_gram, expected_moment = torch.zeros_like(gram[0]), torch.zeros_like(moment[0])
        for batch in measured:
            columns, view = alone.columns(Tile(batch), cut=False), Tile(batch).first_guess()
            design = (columns.values * columns.tint[:, None, None]).double()
            weighted = design * view.weight.T[:, None].double()
            expected_gram += weighted @ design.mT
            expected_moment += (weighted @ view.response.T[..., None].double())[..., 0]
        torch.testing.assert_close(gram[number], expected_gram, rtol=1e-5, atol=1e-6 * float(expected_gram.max()))
        torch.testing.assert_close(moment[number], expected_moment, rtol=1e-5, atol=1e-6 * float(expected_moment.max()))
