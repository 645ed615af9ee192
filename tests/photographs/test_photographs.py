"""Photographs: pixels as stored, radiance, and the samples that they give."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from matest.brdf import Lambert
from matest.photographs.photographs import Photographs
from matest.photographs.photometry import Encoding
from tests.captures import directional
from tests.simulated import DIRECTIONS, Studio


@pytest.fixture
def photographs() -> Photographs:
    lights = tuple((directional(d, 3.0),) for d in (*DIRECTIONS[:3], DIRECTIONS[2]))
    taken = Studio(size=24, lights=lights).photograph(Lambert(0.5), seed=1).photographs
    return replace(taken, stored=(*taken.stored[:3], taken.stored[2].copy()))


def test_radiance_is_the_signal_times_scale_over_exposure(photographs: Photographs) -> None:
    pixels = photographs.stored[1]
    changed = replace(photographs, encoding=Encoding(scale=3.0, black=0.1), exposures=(1.0, 2.0, 1.0, 1.0))
    np.testing.assert_allclose(changed.radiance(1), (pixels - 0.1) * 1.5, rtol=1e-6, atol=1e-7)
    index = np.array([3, 40, 7])
    np.testing.assert_array_equal(changed.radiance(1, index), changed.radiance(1)[index])


def test_plain_samples_are_of_every_image_asked_for(photographs: Photographs) -> None:
    assert (len(photographs), photographs.channels) == (4, 1)
    assert photographs.samples().images == (0, 1, 2, 3)
    assert photographs.samples([3, 1]).images == (3, 1)
    assert photographs.samples().redundancy.images == {}


def test_distinct_samples_are_without_what_is_there_already(photographs: Photographs) -> None:
    samples = photographs.samples(distinct=True)
    assert samples.images == (0, 1, 2)
    assert samples.redundancy.images == {3: "it is the photograph 02.exr once more"}
    # What is not asked for stands for nothing.
    assert photographs.samples([0, 3], distinct=True).images == (0, 3)
