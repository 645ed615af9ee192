"""What is said of an estimate: how the fit went, and what was not computed."""

from __future__ import annotations

import pytest

import matest
from matest.brdf import Brdf, CookTorrance, Lambert, OrenNayar
from matest.estimation.result import Estimate
from matest.photographs.photometry import Encoding
from tests.captures import changed
from tests.simulated import Studio, coloured

STUDIO = Studio(size=24)


def photographed(material: Brdf, expression: str, **options: object) -> Estimate:
    return matest.estimate(STUDIO.photograph(material, 0), expression, **options)  # type: ignore[arg-type]


def test_a_model_that_holds_is_said_to_and_needs_no_warning() -> None:
    found = photographed(OrenNayar(0.6, 0.4), "oren-nayar")
    assert found.fit.message.startswith("Converged; the model describes the images to their noise (reduced χ² ")
    assert found.warnings == []


def test_a_model_that_does_not_hold_is_said_to_with_the_kind_of_error_bars() -> None:
    found = photographed(CookTorrance(0.4, 0.8, 0.2), "lambert")
    assert found.fit.message.startswith("Converged; the model does not hold to the noise (residuals are ")
    assert found.fit.message.endswith("so error bars come from the jackknife over images.")


@pytest.mark.parametrize(
    ("note", "ambient"),
    [("ambient light: there is none", 0.0), ("shadow rays: a sphere cannot shadow itself", 0.1)],
)
def test_what_was_not_computed_is_told(note: str, ambient: float) -> None:
    capture = Studio(size=24, ambient=ambient).photograph(Lambert(0.6), 0)
    assert note in matest.estimate(capture, "lambert").skipped["work"]


def test_shapes_are_evaluated_once_for_all_channels_of_one_light() -> None:
    capture = Studio(size=24, lights=coloured()).photograph(Lambert(0.6), 0)
    note = "colour: each image has one light, shapes are evaluated once for all channels"
    assert note in matest.estimate(capture, "lambert").skipped["work"]


def test_a_second_body_that_is_left_out_is_told() -> None:
    found = photographed(OrenNayar(0.5, 0.3) + CookTorrance(0.0, 0.4, 0.2), "oren-nayar+cook-torrance")
    assert "cook-torrance.diffuse: another component is the diffuse one" in found.skipped["work"]


def test_saturated_pixels_are_counted_among_what_was_skipped() -> None:
    capture = changed(STUDIO.photograph(Lambert(0.6), 0), encoding=Encoding(saturation=0.5))
    counts = matest.estimate(capture, "lambert", holdout=[5]).skipped["samples"]
    assert counts["saturated"] > 0
    assert counts["held_out"] == 24 * 24
