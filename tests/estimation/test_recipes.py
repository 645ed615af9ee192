"""The models that `auto` tries."""

from __future__ import annotations

import pytest

from matest.estimation.options import Options
from matest.estimation.recipes import RECIPES, Recipe
from matest.estimation.specification import expression_of, specify_unknowns
from matest.estimators.dictionary import Dictionary
from matest.estimators.search import shape_nodes


@pytest.mark.parametrize("recipe", RECIPES, ids=lambda recipe: recipe.expression)
def test_every_recipe_is_a_model_whose_columns_a_dictionary_can_hold(recipe: Recipe) -> None:
    problem = specify_unknowns(recipe.expression, Options(), channels=3, relative=False).problem
    assert Dictionary([(problem, shape_nodes(problem, 2))]).coefficients.shape[1] > 0
    assert recipe.components
    assert expression_of(problem.brdf, recipe.expression) == recipe.expression


def test_no_recipe_is_listed_twice_and_levels_rise() -> None:
    assert len({recipe.expression for recipe in RECIPES}) == len(RECIPES)
    levels = [recipe.level for recipe in RECIPES]
    assert levels == sorted(levels)


def test_within_a_level_unknowns_do_not_become_fewer() -> None:
    for level in {recipe.level for recipe in RECIPES}:
        sizes = [
            specify_unknowns(recipe.expression, Options(), channels=3, relative=False).problem.size
            for recipe in RECIPES
            if recipe.level == level
        ]
        assert sizes == sorted(sizes), level
