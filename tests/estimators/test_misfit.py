"""How far samples are from a radiance, against sums by hand."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from matest.brdf import OrenNayar
from matest.estimators import Problem, accumulate
from matest.estimators.misfit import misfit
from matest.estimators.passes import radiance_model
from matest.photographs.photometry import Encoding
from matest.samples import Tile
from tests.captures import changed
from tests.simulated import Studio

CLAY = OrenNayar(0.6, 0.4)
CLIP = 0.3


def darker(tile: Tile) -> Tensor:
    """A model that is a tenth darker than what was measured."""
    return 0.9 * tile.batch.radiance


def test_a_model_a_tenth_darker_has_that_error_at_every_pixel() -> None:
    samples = Studio().photograph(CLAY, seed=1).samples()
    found = misfit(darker, samples.tiles(merge=False))
    assert found.statistics.relative_rmse == pytest.approx(0.1, rel=1e-5)
    assert found.statistics.total("samples") == len(samples) == len(found.errors)
    torch.testing.assert_close(found.errors, torch.full_like(found.errors, 0.1), rtol=1e-4, atol=0)


def test_scores_are_those_of_a_pass_over_the_samples() -> None:
    samples, none = Studio().photograph(CLAY, seed=1).samples(), torch.zeros(0, dtype=torch.float64)
    problem = Problem.of(CLAY, samples.channels, (), CLAY.parameters, {})
    found = misfit(radiance_model(problem, none), samples.tiles(merge=False)).statistics
    expected = accumulate(problem, none, samples.tiles(merge=False), none)
    assert torch.equal(found.labels, expected.labels)
    torch.testing.assert_close(found.scores, expected.scores, rtol=1e-4, atol=1e-6)
    assert found.reduced_chi2 == pytest.approx(1.0, abs=0.05)


def test_clipped_values_count_where_the_model_is_darker_than_the_clip() -> None:
    capture = Studio().photograph(CLAY)
    stored = tuple(image.clip(max=CLIP) for image in capture.photographs.stored)
    capture = changed(capture, stored=stored, encoding=Encoding(saturation=CLIP * (1 - 1e-6)))
    samples = capture.samples([0])
    clipped = float(np.mean(capture.radiance(0)[samples.usable(0)].max(axis=1) >= CLIP))
    assert 0.05 < clipped < 0.9
    level = 1.1 * CLIP

    def bright(tile: Tile) -> Tensor:
        return torch.full_like(tile.batch.radiance, level)

    found = misfit(bright, samples.tiles(merge=False))
    # A model above the clip everywhere errs at the others alone.
    assert len(found.errors) == pytest.approx((1 - clipped) * len(samples), abs=1)


def test_no_sample_has_no_error() -> None:
    found = misfit(darker, [])
    assert found.statistics.total("samples") == 0
    assert len(found.errors) == 0
