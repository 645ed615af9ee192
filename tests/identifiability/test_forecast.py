"""The information of photographs that are not taken."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from matest.brdf import Lambert
from matest.estimation.options import Options
from matest.estimation.specification import specify
from matest.identifiability import check
from matest.identifiability.forecast import Forecast
from matest.photographs.photometry import Encoding
from tests.captures import changed
from tests.identifiability.subjects import studio
from tests.simulated import DIRECTIONS


@pytest.mark.usefixtures("without_advice")
def test_pixels_predicted_to_be_clipped_say_little() -> None:
    capture = studio([(0.3, 0.2, 0.93)]).photograph(Lambert(0.5), 1)
    values = {"slope": 0.05, "diffuse": 0.3}
    clipped = check(changed(capture, encoding=Encoding(saturation=0.25)), "cook-torrance", at=values)
    whole = check(capture, "cook-torrance", at=values)
    assert clipped.skipped["saturated"] > whole.skipped["saturated"] == 0
    assert clipped.parameters["slope"].std > 1.5 * whole.parameters["slope"].std


@pytest.mark.usefixtures("without_advice")
def test_errors_grow_with_the_noise() -> None:
    capture = studio(DIRECTIONS).photograph(Lambert(0.5), 1)
    # Read noise alone: all standard errors are in proportion to it.
    once, twice = (check(capture, "oren-nayar", noise=(read, 0.0)).parameters for read in (0.01, 0.02))
    for name in ("albedo", "sigma"):
        assert np.ravel(twice[name].std) == pytest.approx(2 * np.ravel(once[name].std), rel=1e-4)


def forecast_of(information: list[float], relative: bool = False) -> Forecast:
    """A forecast of Lambert's model in as many channels."""
    problem = specify("lambert", Options(), channels=len(information), relative=relative).problem
    unknowns = torch.full((problem.size,), 0.5, dtype=torch.float64)
    return Forecast(problem, unknowns, torch.diag(torch.tensor(information, dtype=torch.float64)), 1)


def test_two_sets_of_photographs_together_halve_the_variance() -> None:
    once = forecast_of([100.0, 25.0])
    assert once.std.tolist() == pytest.approx([0.1, 0.2])
    assert (once + once).std.tolist() == pytest.approx([0.1 / math.sqrt(2), 0.2 / math.sqrt(2)])
    assert (once + once).values == 2


def test_forecasts_compare_by_what_is_not_determined_and_then_by_the_largest_relative_error() -> None:
    assert forecast_of([100.0, 0.0]).worst == (1, pytest.approx(0.2))
    assert forecast_of([100.0, 25.0]).worst == (0, pytest.approx(0.4))
    assert forecast_of([0.0]).worst == (1, 0.0)
