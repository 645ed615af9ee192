"""Photographs that are only planned."""

from __future__ import annotations

from pathlib import Path

import pytest

import matest
from matest.brdf import Lambert
from matest.identifiability import Plan, check
from matest.photographs.noise import Noise
from tests import scenes
from tests.captures import refusal
from tests.identifiability.subjects import studio
from tests.simulated import CAMERA, DIRECTIONS


@pytest.mark.usefixtures("without_advice")
def test_noise_that_nobody_states_is_a_typical_cameras(tmp_path: Path) -> None:
    file = scenes.write(tmp_path, scenes.material("lambert", albedo=0.5), scenes.sphere(48), scenes.distant())
    found = check(matest.load_plan(file))
    assert "typical" in found.noise["source"]
    assert found.noise["read"] == pytest.approx(1e-3, rel=1e-3)
    assert Plan.of(studio(DIRECTIONS).photograph(Lambert(0.5), 1)).photographs.noise == CAMERA


def test_noise_must_be_possible() -> None:
    plan = Plan.of(studio(DIRECTIONS).photograph(Lambert(0.5), 1))
    assert "both zero" in refusal(lambda: plan.with_noise(0.0, 0.0))
    assert "not negative" in refusal(lambda: plan.with_noise(-0.1, 0.0))
    assert plan.with_noise(0.01, 0.0).photographs.noise == Noise(0.01, 0.0)
