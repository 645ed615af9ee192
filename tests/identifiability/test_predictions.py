"""Statuses of the predicted parameters."""

from __future__ import annotations

import pytest
import torch

from matest.brdf import CookTorrance, Lambert
from matest.estimation.options import Options
from matest.estimation.specification import specify
from matest.identifiability import check
from matest.identifiability.forecast import Forecast
from matest.identifiability.highlight import Nearness
from matest.identifiability.predictions import predictions
from matest.identifiability.reasons import Reasons
from tests.identifiability.subjects import studio
from tests.simulated import Studio


@pytest.mark.usefixtures("without_advice")
def test_specular_and_f0_are_a_product_under_one_frontal_light() -> None:
    where = studio([(0, 0, 1)])
    held = check(where.photograph(Lambert(0.5), 1), "cook-torrance").parameters["f0"]
    assert held.status == "held"
    assert held.reason == "f0 and specular appear only as a product here"
    freed = check(where.photograph(Lambert(0.5), 1), "cook-torrance", free=("f0",)).parameters
    assert freed["specular"].status == freed["f0"].status == "not determined"
    assert freed["specular"].reason == "specular and f0 appear only as a product here"
    assert freed["specular"].std is None


@pytest.mark.usefixtures("without_advice")
def test_parameters_along_a_bent_valley_are_never_called_determined() -> None:
    # To first order n is known to a quarter of itself; along a curve the images are the same up to n = 8.
    metal = CookTorrance(0.0, 1.0, 0.2, eta=1.0, k=2.483, fresnel="conductor")
    held = {"diffuse": 0.0, "specular": 1.0}
    at = {name: float(metal.parameters[name]) for name in ("slope", "eta", "k")}
    found = check(Studio().photograph(metal, 1), metal.expression, fix=held, at=at).parameters
    assert found["slope"].status == "determined"
    assert (found["eta"].status, found["k"].status) == ("weak", "weak")
    assert found["eta"].relative < 1
    assert "errors of eta and k hold only very near the values assumed" in found["eta"].reason


@pytest.mark.parametrize(
    ("information", "status", "span"),
    [
        ([2500.0, 625.0], "determined", (pytest.approx(0.2), pytest.approx(0.4))),
        ([2500.0, 0.0], "determined", (pytest.approx(0.2), None)),
        ([25.0, 2500.0], "weak", (pytest.approx(0.2), pytest.approx(2.0))),
        ([0.0, 2500.0], "not determined", (pytest.approx(0.2), None)),
        ([2500.0], "determined", None),
        ([0.0, 0.0], "not determined", None),
    ],
)
def test_the_first_level_gives_the_status_and_all_levels_the_range(
    information: list[float], status: str, span: tuple[float, float | None] | None
) -> None:
    problem = specify("lambert", Options(), channels=1, relative=False).problem
    unknowns = torch.tensor([0.1], dtype=torch.float64)
    forecasts = [Forecast(problem, unknowns, torch.tensor([[each]]).double(), 1) for each in information]
    reasons = Reasons(forecasts[0], Nearness(0.0, 0.0), relative=False)
    albedo = predictions(forecasts, reasons, reasons)["albedo"]
    assert (albedo.status, albedo.range) == (status, span)
    assert (albedo.reason == "") == (status == "determined")
