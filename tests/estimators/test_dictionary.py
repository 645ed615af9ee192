"""A dictionary of columns that several models share."""

from __future__ import annotations

import itertools

import pytest
import torch

from matest.estimation.options import Options
from matest.estimation.specification import specify_unknowns
from matest.estimators import Problem
from matest.estimators.dictionary import Dictionary
from matest.estimators.moments import moments
from matest.estimators.search import normal_equations, shape_nodes
from matest.samples import Batch, Tile
from matest.samples.batch import join
from tests.simulated import Studio

EXPRESSIONS = (
    "lambert",
    "oren-nayar",
    "cook-torrance",
    "cook-torrance(fresnel=schlick,diffuse=0)",
    "cook-torrance(lobes=2)",
    "oren-nayar+torrance-sparrow",
    "oren-nayar+cook-torrance",
    "li-torrance(forward=on)",
)
NODES = 3


@pytest.fixture(scope="module")
def batch() -> Batch:
    from matest.brdf import CookTorrance

    return join(Studio(size=32).photograph(CookTorrance(0.4, 0.8, 0.2)).samples().pilot(900, 0)).ungrouped


def problem(expression: str, options: Options | None = None) -> Problem:
    return specify_unknowns(expression, options or Options(), channels=1, relative=False).problem


def at_nodes(problems: list[Problem], batch: Batch, member: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Gram matrices and moments of one of the problems, through the dictionary."""
    grids = [shape_nodes(one, NODES) for one in problems]
    dictionary = Dictionary([*zip(problems, grids, strict=True)])
    tile = Tile(batch)
    squares = tile.first_guess()
    with torch.no_grad():
        sums = moments(dictionary.columns(tile), squares, squares.response, None)
        _, gram, moment = dictionary.normal_equations(member, sums.gram[0], sums.moment[0])
    return gram, moment


def one_by_one(single: Problem, batch: Batch) -> tuple[torch.Tensor, torch.Tensor]:
    """The same, every node evaluated by itself."""
    points = []
    for combination in itertools.product(*shape_nodes(single, NODES).values()):
        unknowns = single.anywhere.clone()
        for name, value in zip(single.shapes, combination, strict=True):
            unknowns[single.where[name]] = value
        points.append(unknowns)
    _, gram, moment = normal_equations(single, [batch], points)
    return gram, moment


@pytest.mark.parametrize("member", range(len(EXPRESSIONS)), ids=EXPRESSIONS)
def test_normal_equations_are_those_of_every_node_by_itself(member: int, batch: Batch) -> None:
    problems = [problem(expression) for expression in EXPRESSIONS]
    gram, moment = at_nodes(problems, batch, member)
    expected_gram, expected_moment = one_by_one(problems[member], batch)
    torch.testing.assert_close(gram, expected_gram, rtol=1e-5, atol=1e-6 * float(expected_gram.abs().max()))
    torch.testing.assert_close(moment, expected_moment, rtol=1e-5, atol=1e-6 * float(expected_moment.abs().max()))


def test_a_tied_parameter_runs_through_the_nodes_of_the_other(batch: Batch) -> None:
    tied = problem("oren-nayar+torrance-sparrow", Options(tie={"torrance-sparrow.sigma": "oren-nayar.sigma"}))
    gram, moment = at_nodes([tied], batch, 0)
    expected_gram, expected_moment = one_by_one(tied, batch)
    torch.testing.assert_close(gram, expected_gram, rtol=1e-5, atol=1e-6 * float(expected_gram.abs().max()))
    torch.testing.assert_close(moment, expected_moment, rtol=1e-5, atol=1e-6 * float(expected_moment.abs().max()))


def test_models_share_the_columns_of_their_components(batch: Batch) -> None:
    problems = [problem(expression) for expression in ("oren-nayar", "cook-torrance", "oren-nayar+cook-torrance")]
    grids = [shape_nodes(one, NODES) for one in problems]
    apart = sum(Dictionary([(one, grid)]).coefficients.shape[1] for one, grid in zip(problems[:2], grids, strict=False))
    assert Dictionary([*zip(problems, grids, strict=True)]).coefficients.shape[1] == apart
    del batch


def test_columns_of_narrow_lobes_hold_no_number_too_small_to_multiply(batch: Batch) -> None:
    single = problem("cook-torrance")
    columns = Dictionary([(single, {"slope": [0.005, 0.01, 0.02]})]).columns(Tile(batch)).values
    assert float(columns[columns > 0].min()) ** 2 > torch.finfo(torch.float32).tiny


def test_a_term_that_depends_on_several_shape_parameters_is_refused() -> None:
    single = problem("cook-torrance(fresnel=conductor)")
    with pytest.raises(ValueError, match=r"one term depends on eta and k"):
        Dictionary([(single, shape_nodes(single, NODES))])
