"""Tables for the terminal."""

from __future__ import annotations

import math
from dataclasses import replace
from io import StringIO
from typing import Any

import pytest
from rich.console import Console, RenderableType

from matest.brdf import MODELS, PRESETS
from matest.estimation.calibration import NuisanceEstimate
from matest.estimation.prediction import PredictionErrors
from matest.estimation.recipes import RECIPES
from matest.report.tables import (
    add_parameters,
    estimate_table,
    models_table,
    plain_table,
    prediction_table,
    presets_table,
    recipes_table,
)
from tests.estimates import FIXED, LOST, SIGMA, clay
from tests.mapped import mapped


def printed(table: RenderableType, colour: bool = False) -> str:
    """A table as a wide terminal shows it."""
    console = Console(file=StringIO(), width=200, force_terminal=colour, highlight=False)
    console.print(table)
    return console.file.getvalue()  # type: ignore[attr-defined]


def errors(value: list[float] | None, std: list[float] | None, **changes: Any) -> NuisanceEstimate:
    """Errors of a family, of small size as the estimate has it."""
    size = None if value is None else math.sqrt(sum(number**2 for number in value) / len(value))
    known = {"size": size, "prior_std": 0.05, "origin": "assumed", "refined": value is not None, "unit": "1"}
    return NuisanceEstimate(value=value, std=std, doc="errors", **(known | changes))


def words(table: RenderableType) -> str:
    return " ".join(printed(table).split())


def test_parameters_of_a_sum_stand_under_the_name_of_their_model() -> None:
    table = plain_table("parameter", "status")
    statuses = {"oren-nayar.albedo": "fixed", "oren-nayar.sigma": "tied", "ward.slope": "fixed"}
    add_parameters(table, statuses, lambda label, status: [(label, status)])
    lines = [line[2:].rstrip() for line in printed(table).splitlines() if line.strip()]
    names = ["oren-nayar", "  albedo", "  sigma", "ward", "  slope"]
    assert [line.removesuffix("fixed").removesuffix("tied").rstrip() for line in lines[2:]] == names


@pytest.mark.parametrize(("parameter", "code"), [(SIGMA, "\x1b[32m"), (LOST, "\x1b[31m"), (FIXED, None)])
def test_the_colour_of_a_status_says_how_good_it_is(parameter: object, code: str | None) -> None:
    text = printed(estimate_table(clay(parameters={"sigma": parameter}, warnings=[])), colour=True)
    status = parameter.status  # type: ignore[attr-defined]
    assert (f"{code}{status}" if code else f" {status}") in text


def test_only_the_row_of_the_chosen_model_is_bold() -> None:
    rows = printed(estimate_table(clay()), colour=True).split("Models tried")[1].split("Left out in turn")[0]
    assert ["\x1b[1m" in line for line in rows.splitlines() if "the simplest" in line or "chosen: " in line] == [
        False,
        True,
    ]


def test_what_auto_tries_is_readable_in_80_columns() -> None:
    console = Console(file=StringIO(), width=80, highlight=False)
    console.print(recipes_table(RECIPES))
    lines = console.file.getvalue().splitlines()  # type: ignore[attr-defined]
    # Lines break between options, and no column is cut short.
    models = " ".join(line[lines[2].index("model") :].strip() for line in lines[2:])
    for recipe in RECIPES:
        assert recipe.expression.replace(",", ", ") in models
    assert "…" not in "".join(lines)
    assert "metal, or coloured gloss" in " ".join(lines)


def test_an_estimate_shows_errors_what_was_left_out_and_warnings() -> None:
    text = words(estimate_table(clay(skipped={"samples": {"saturated": 5}})))
    for part in (
        "Models tried",
        "chosen: predicts images left out better than lambert",
        "of one or two images four horizontal bands of each; of a measured table incidences",
        "0.5236 ± 0.0021 rad",
        "relative rms error 1.13%, 120,000 of 123,456 samples and 5 with a saturated channel, "
        "2.00% on the images left out (median error of a pixel 1.30%).",
        "Note: Noise was estimated from the images.",
        "fit 0.30 s",
    ):
        assert part in text


def test_means_of_maps_are_called_so() -> None:
    sentence = "Values of albedo in the table are means over the pixels."
    assert sentence in words(estimate_table(mapped()))
    assert "are means" not in words(estimate_table(clay()))
    lost = {"albedo": LOST}
    assert "are means" not in words(estimate_table(replace(mapped(), parameters=lost)))


def test_errors_of_the_calibration_are_readable_in_80_columns() -> None:
    limits = ["oren-nayar.albedo", "torrance-sparrow.specular"]
    nuisance = {
        "albedo_field": errors([-0.03, 0.04], [0.003, 0.004], prior_std=1e-17, origin="estimated"),
        "normals": errors(None, None, unit="rad", prior_std=math.radians(1), origin="stated", limits=limits),
        "vignetting": errors([-0.00012345], [0.00053]),
        "direction": errors([1e-17, 0.0], [1e-17, 1e-17], unit="rad"),
    }
    console = Console(file=StringIO(), width=80, highlight=False)
    console.print(estimate_table(clay(nuisance=nuisance)))
    _, _, table = console.file.getvalue().partition("Errors of the calibration")  # type: ignore[attr-defined]
    rows = [line.split() for line in table.partition("Size:")[0].splitlines()]
    assert ["albedo_field", "2", "0.0354", "±", "0.0035", "0", "(estimated)"] in rows
    assert ["(albedo)"] in rows
    assert ["normals", "not", "refined", "1°", "(stated)", "oren-nayar."] in rows
    assert ["torrance-sparrow."] in rows
    assert ["vignetting", "1", "-0.00012", "±", "0.00053", "0.05", "(assumed)"] in rows
    assert ["direction", "2", "0°", "2.86°", "(assumed)"] in rows
    assert "…" not in table


def test_an_image_without_a_usable_pixel_has_no_error() -> None:
    text = words(prediction_table(PredictionErrors([0.1, None], 0.1, [0.05, None], 0.05), ["00.png", "01.png"]))
    assert "00.png 10.00% 5.00% 01.png no usable pixel no usable pixel all together 10.00% 5.00%" in text


def test_the_catalogue_names_every_model_and_every_preset() -> None:
    catalogue, presets = words(models_table(MODELS)), words(presets_table(PRESETS))
    assert [name for name in MODELS if name not in catalogue] == []
    assert [name for name in PRESETS if name not in presets] == []
    assert "[material]" in presets
