"""Residuals by the angles that a reflectance depends on."""

from __future__ import annotations

import pytest

import matest
from matest.brdf import OrenNayar
from matest.estimation.residual_angles import AngularResiduals
from tests.miscalibrated import STUDIO, normal_deviates, photographed, tilted

CLAY = OrenNayar([0.7, 0.6, 0.5], 0.4)


def residuals(model: str, **options: object) -> dict[str, AngularResiduals]:
    return dict(matest.estimate(STUDIO.photograph(CLAY, 0), model, **options).residuals)  # type: ignore[arg-type]


@pytest.mark.parametrize("angle", ["half angle", "angle of incidence"])
def test_of_a_model_that_holds_the_residuals_are_the_noise(angle: str) -> None:
    found = residuals("oren-nayar")[angle]
    assert len(found) > 15
    assert 0 < found.degrees.min() < found.degrees.max() < 90
    assert (found.rms / found.noise).mean() == pytest.approx(1, abs=0.03)
    assert found.mean.abs().max() < 0.01


def test_a_model_that_is_too_dark_at_grazing_light_shows_there() -> None:
    found = residuals("lambert")["angle of incidence"]
    grazing = (found.degrees > 70) & (found.degrees < 85)
    assert found.mean[grazing].min() > 0.02
    assert (found.rms / found.noise)[grazing].min() > 1.3


def test_refined_errors_of_the_calibration_are_allowed_for() -> None:
    capture = photographed(CLAY, tilted(0.03 * normal_deviates(8, 3, seed=0)), seed=0)
    as_stated, refined = (
        matest.estimate(capture, "oren-nayar", refine=families).residuals["angle of incidence"]
        for families in ((), ("direction",))
    )
    assert (as_stated.rms / as_stated.noise).mean() > 1.2
    assert (refined.rms / refined.noise).mean() == pytest.approx(1, abs=0.03)
