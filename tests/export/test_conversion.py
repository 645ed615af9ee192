"""The error of a conversion, and fits of a family of materials."""

from __future__ import annotations

import math

import pytest
import torch

from matest.brdf import CookTorrance, Lambert
from matest.directions import Directions
from matest.export.conversion import ConversionError, Family, Values, best_fit, even_colour, measured_error, pairs
from tests.export.materials import even_pairs

NARROW = CookTorrance(0.0, 1.0, 0.03, masking="smith")


def test_weights_make_sums_over_pairs_integrals() -> None:
    sample, (wi, wo) = pairs(20_000), even_pairs(400_000)
    material = CookTorrance(0.2, 1.0, 0.3)
    weighted = (material(sample.wi, sample.wo) * sample.weight).sum() / sample.weight.sum()
    assert float(weighted) == pytest.approx(float(material(wi, wo).mean()), rel=0.02)
    assert float(sample.wo[:, 2].min()) > math.cos(math.radians(80))


def test_narrow_lobes_have_pairs_in_their_peak() -> None:
    sample, (wi, wo) = pairs(20_000), even_pairs(20_000)
    peak = 0.1 * float(NARROW(torch.tensor([[0.0, 0, 1]]).double(), torch.tensor([[0.0, 0, 1]]).double()))
    assert int((NARROW(sample.wi, sample.wo) > peak).sum()) > 500
    assert int((NARROW(wi, wo) > peak).sum()) < 100


def test_a_material_a_tenth_too_bright_is_off_by_a_tenth() -> None:
    error = measured_error(NARROW, lambda wi, wo: 1.1 * NARROW(wi, wo))
    assert (error.relative_rmse, error.median) == pytest.approx((0.1, 0.1))
    assert str(error) == "10.00% of the rms brightness, median 10.00%"


def test_pairs_without_a_value_do_not_count() -> None:
    def half(wi: torch.Tensor, wo: torch.Tensor) -> torch.Tensor:
        return torch.where(wi[:, :1] > 0, Lambert(0.5)(wi, wo), torch.nan)

    assert measured_error(Lambert(0.5), half) == ConversionError(0.0, 0.0)


def test_a_black_material_is_converted_without_error() -> None:
    assert measured_error(Lambert(0.0), Lambert(0.0)) == ConversionError(0.0, 0.0)


def of_model(values: Values, directions: Directions) -> torch.Tensor:
    model = CookTorrance(values["diffuse"], values["specular"], values["slope"], masking="smith")
    return model.evaluate(directions)


def start(slope: float) -> Values:
    one = torch.ones((), dtype=torch.float64)
    return {"diffuse": 0.5 * one.expand(3), "specular": 0.5 * one, "slope": slope * one}


def test_a_fit_finds_the_member_of_the_family_from_afar() -> None:
    bounds = {"diffuse": (0.0, 1.0), "specular": (0.0, 2.0), "slope": (1e-3, 1.0)}
    rough = {name: value for name, value in start(0.9).items() if name != "diffuse"}
    wrong = Family("rough", of_model, [start(0.9)], {"diffuse": (0.0, 1.0)}, rough)
    family = Family("glossy", of_model, [start(0.08), start(0.4)], bounds)
    truth = CookTorrance([0.4, 0.3, 0.2], 0.8, 0.15, masking="smith")
    chosen, values, error = best_fit([wrong, family], truth)
    assert chosen is family
    assert values["diffuse"].tolist() == pytest.approx([0.4, 0.3, 0.2], rel=1e-4)
    assert [float(values["specular"]), float(values["slope"])] == pytest.approx([0.8, 0.15], rel=1e-4)
    assert error.relative_rmse < 1e-4


def test_the_colour_away_from_highlights_is_that_of_the_body() -> None:
    assert even_colour(CookTorrance([0.4, 0.3, 0.2], 1.0, 0.1)).tolist() == pytest.approx([0.4, 0.3, 0.2], rel=0.01)
