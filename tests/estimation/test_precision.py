"""`precision`: no more pixels than an error of so much takes."""

from __future__ import annotations

import numpy as np
import pytest

import matest
from matest.brdf import CookTorrance, Lambert, OrenNayar
from tests.captures import directional
from tests.simulated import DIRECTIONS, Studio

STUDIO = Studio(size=280, lights=tuple((directional(towards, 3.0),) for towards in DIRECTIONS))


def test_an_estimate_stops_at_the_precision_asked_for() -> None:
    capture = STUDIO.photograph(OrenNayar(0.7, 0.5), seed=1)
    rough = matest.estimate(capture, "oren-nayar", precision=0.01)
    whole = matest.estimate(capture, "oren-nayar")
    assert rough.fit.samples_used < 0.2 * rough.fit.samples == 0.2 * whole.fit.samples
    assert whole.fit.samples_used == whole.fit.samples
    assert "on a subsample" in rough.fit.message
    assert "subsample" not in whole.fit.message
    for name, truth in (("albedo", 0.7), ("sigma", 0.5)):
        found = rough.parameters[name]
        assert whole.parameters[name].std < found.std < 0.01 * found.value
        assert abs(found.value - truth) < 4 * found.std


def test_a_subsample_holds_no_parameter_that_all_pixels_determine() -> None:
    capture = STUDIO.photograph(CookTorrance(0.3, 0.3, 0.3), seed=1)
    # Held at its default, f0 would make the strength of the highlight look known five times as well as it is.
    rough = matest.estimate(capture, "cook-torrance", precision=0.1)
    whole = matest.estimate(capture, "cook-torrance")
    assert whole.parameters["f0"].status == rough.parameters["f0"].status == "determined"
    assert rough.parameters["specular"].std > 0.9 * whole.parameters["specular"].std


def test_a_precision_out_of_reach_reads_everything() -> None:
    capture = STUDIO.photograph(Lambert(0.5), seed=2)
    found = matest.estimate(capture, "lambert", precision=1e-9)
    assert found.fit.samples_used == found.fit.samples


@pytest.mark.parametrize("precision", [0.0, -1.0, 1.0, np.nan])
def test_a_precision_lies_between_0_and_1(precision: float) -> None:
    capture = Studio(size=20).photograph(Lambert(0.5), seed=2)
    with pytest.raises(matest.InputError, match="precision is a relative standard error"):
        matest.estimate(capture, "lambert", precision=precision)


def test_a_precision_that_all_pixels_do_not_give_is_told() -> None:
    capture = Studio(size=48).photograph(OrenNayar(0.6, 0.5), seed=3)
    found = matest.estimate(capture, "oren-nayar", precision=1e-5)
    assert found.fit.samples_used == found.fit.samples
    (warning,) = found.warnings
    assert warning.startswith("All pixels together do not give the precision of 1e-05 that was asked for: albedo (")
    assert "sigma (" in warning
    assert matest.estimate(capture, "oren-nayar").warnings == []


def test_a_model_that_misses_reads_everything_and_finds_the_same() -> None:
    capture = STUDIO.photograph(OrenNayar(0.7, 0.5), seed=4)
    plain, precise = (matest.estimate(capture, "lambert", precision=precision) for precision in (None, 0.01))
    assert plain.fit.errors != "fisher"
    assert precise.fit.samples_used == precise.fit.samples
    assert precise.parameters == plain.parameters


def test_samples_that_were_not_read_are_accounted_for() -> None:
    capture = Studio(size=256).photograph(OrenNayar(0.6, 0.5), seed=3)
    found = matest.estimate(capture, "oren-nayar", precision=0.05)
    unread = found.fit.samples - found.fit.samples_used
    assert unread > 0.9 * found.fit.samples
    assert f"reading {unread:,} samples: the others give the precision asked for" in found.skipped["work"]
