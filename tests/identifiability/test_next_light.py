"""The lights that are tried."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from matest.identifiability.next_light import camera_direction, hemisphere
from matest.scene.surface import from_sphere


def test_candidate_lights_cover_the_side_of_the_camera_evenly() -> None:
    axis = torch.tensor([0.6, 0.0, 0.8], dtype=torch.float64)
    found = torch.stack(hemisphere(axis, 200, 80.0))
    assert torch.allclose(found.norm(dim=1), torch.ones(200, dtype=torch.float64))
    cosines = found @ axis
    assert float(cosines.min()) == pytest.approx(math.cos(math.radians(80)))
    # Even over the cap: the mean cosine is that of its middle, sideways the mean vanishes.
    assert float(cosines.mean()) == pytest.approx((1 + math.cos(math.radians(80))) / 2, abs=1e-6)
    assert float((found.mean(0) - cosines.mean() * axis).norm()) < 0.02


def test_the_camera_is_found_in_double_precision_whatever_that_of_the_surface() -> None:
    surface = from_sphere((20, 20), (10.0, 10.0), 8.0, None)
    single = replace(surface, sightlines=surface.view.float())
    axis = camera_direction(single)
    assert axis.dtype == torch.float64
    assert torch.allclose(axis, camera_direction(surface), atol=1e-6)
