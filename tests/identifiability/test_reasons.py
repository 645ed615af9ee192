"""Why a parameter is not determined, where the truth is clear."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from matest.brdf import Lambert
from matest.estimation.options import Options
from matest.estimation.specification import specify
from matest.identifiability import check
from matest.identifiability.forecast import forecast, predicted_samples
from matest.identifiability.highlight import Nearness
from matest.identifiability.reasons import Reasons
from matest.photographs.photometry import Encoding
from tests.captures import changed
from tests.identifiability.subjects import plate, studio
from tests.simulated import DIRECTIONS


@pytest.mark.usefixtures("without_advice")
def test_only_the_ratio_of_the_lengths_is_determined_without_coherent_reflection() -> None:
    capture = studio(DIRECTIONS).photograph(Lambert(0.5), 1)
    found = check(capture, "li-torrance", fix={"f0": 0.04}, free=("height_rms",)).parameters
    expected = "only height_rms/correlation_length is determined without coherent=on (mirror-like reflection)"
    assert found["height_rms"].reason == found["correlation_length"].reason == expected
    assert found["height_rms"].status == found["correlation_length"].status == "not determined"
    assert found["k_uds"].status == "determined"


@pytest.mark.usefixtures("without_advice")
def test_a_highlight_that_no_sample_comes_near_is_named_with_its_distance() -> None:
    capture = plate(70)
    found = check(capture, "cook-torrance", at={"slope": 0.05}).parameters
    assert found["slope"].status == "not determined"
    half = np.array([math.sin(math.radians(35)), 0, math.cos(math.radians(35))])
    nearest = np.degrees(np.arccos((capture.scene.surface.normals.numpy() @ half).max()))
    assert found["slope"].reason == f"no image samples within {nearest:.0f}° of the highlight"
    assert found["diffuse"].status == "determined"


def test_a_highlight_that_light_reaches_but_no_usable_sample_asks_for_a_shorter_exposure() -> None:
    problem = specify("cook-torrance", Options(), channels=1, relative=False).problem
    unknowns = problem.unknowns_at({**problem.brdf.parameters, "slope": torch.tensor(0.05)})
    unseen = forecast(predicted_samples(plate(70).photographs, problem, unknowns), problem, unknowns)
    assert "shorter exposure" in Reasons(unseen, Nearness(usable=0.5, lit=0.01), False).of("slope")
    assert "no image samples" in Reasons(unseen, Nearness(usable=0.5, lit=0.5), False).of("slope")


@pytest.mark.usefixtures("without_advice")
def test_a_product_is_named_as_such_although_the_middle_of_the_highlight_is_clipped() -> None:
    capture = changed(studio([(0, 0, 1)]).photograph(Lambert(0.5), 1), encoding=Encoding(saturation=0.25))
    found = check(capture, "cook-torrance", at={"slope": 0.1})
    assert found.skipped["saturated"] > 0
    assert found.parameters["f0"].reason == "f0 and specular appear only as a product here"


@pytest.mark.usefixtures("without_advice")
def test_what_shapes_an_absent_lobe_says_so() -> None:
    capture = studio(DIRECTIONS).photograph(Lambert(0.5), 1)
    assert "absent: specular is 0" in check(capture, "cook-torrance", at={"specular": 0.0}).parameters["slope"].reason


@pytest.mark.usefixtures("without_advice")
def test_an_azimuth_carries_no_light_scale() -> None:
    capture = studio(DIRECTIONS, relative=True).photograph(Lambert(0.5), 1)
    found = check(capture, "oren-nayar-single-slope").parameters
    assert "locked" in found["albedo"].reason
    assert "locked" not in found["azimuth"].reason
