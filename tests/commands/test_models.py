"""`matest models` as people and scripts use it."""

from __future__ import annotations

import json

from tests.commands.conftest import Run


def test_models_lists_the_catalogue(run: Run) -> None:
    from matest.brdf import MODELS

    code, out, _ = run("models")
    assert code == 0
    assert all(name in out for name in MODELS)
    assert "What --model auto tries" in out
    listed = json.loads(run("models", "--json")[1])
    assert listed["oren-nayar"]["parameters"]["sigma"]["unit"] == "rad"


def test_models_takes_the_name_of_one(run: Run) -> None:
    code, out, _ = run("models", "oren-nayar")
    assert code == 0
    assert "std. deviation of the facet slope angle" in out
    assert "cook-torrance" not in out
    assert [*json.loads(run("models", "cook-torrance", "--json")[1])] == ["cook-torrance"]
    assert run("models", "auto")[1].startswith("What --model auto tries")
    assert [*json.loads(run("models", "auto", "--json")[1])] == ["auto"]


def test_a_model_that_nobody_knows_is_refused_with_the_nearest(run: Run) -> None:
    code, out, err = run("models", "orennayar")
    assert (code, out, err) == (2, "", "matest: unknown model 'orennayar'; did you mean 'oren-nayar'?\n")


def test_models_lists_what_auto_tries(run: Run) -> None:
    from matest.estimation.recipes import RECIPES

    candidates = json.loads(run("models", "--json")[1])["auto"]["candidates"]
    assert [candidate["model"] for candidate in candidates] == [recipe.expression for recipe in RECIPES]
    assert {"surface": "metal", "dielectric": "coloured gloss"}.items() <= candidates[2].items()
