"""Distances of samples to a highlight, against the half vector of known directions."""

from __future__ import annotations

import math

import pytest
import torch

from matest.brdf import Lambert
from matest.identifiability.highlight import Nearness
from tests.identifiability.subjects import plate, studio


def test_the_nearest_sample_has_the_normal_nearest_to_the_half_vector() -> None:
    samples = plate(70).samples()
    half = torch.tensor([math.sin(math.radians(35)), 0, math.cos(math.radians(35))], dtype=torch.float64)
    angles = torch.arccos(samples.photographs.scene.surface.normals @ half)
    assert Nearness.of(samples).usable == pytest.approx(float(angles[samples.indices(0)].min()), abs=1e-6)
    assert Nearness.of(samples).lit == pytest.approx(float(angles.min()), abs=1e-6)


def test_photographs_without_a_sample_are_infinitely_far_from_a_highlight() -> None:
    samples = studio([(0, 0, -1)], size=32).photograph(Lambert(0.5), 1).samples()
    assert Nearness.of(samples) == Nearness(usable=math.inf, lit=math.inf)
