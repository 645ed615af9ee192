"""Small pictures of a photograph and the numbers behind them."""

from __future__ import annotations

import base64

import numpy as np
import pytest
import simplejpeg

from matest.brdf import Lambert
from matest.report.picture_size import PictureSize
from matest.report.pictures import write_pictures
from matest.report.previews import (
    BRIGHTNESS_STEPS,
    RESIDUAL_CODES,
    RESIDUAL_ZERO,
    Preview,
    PreviewPlan,
    jpeg,
    residual_codes,
    thinned,
)
from matest.shading import render_image
from tests.report.test_packing import unpacked
from tests.simulated import Studio, coloured

TRUTH = Lambert([0.6, 0.5, 0.4])
CAPTURE = Studio(size=120, lights=coloured()[:2]).photograph(TRUTH, seed=1)


@pytest.fixture(scope="module")
def previews(tmp_path_factory: pytest.TempPathFactory) -> list[Preview]:
    """A large one and a small one."""
    plan = PreviewPlan(CAPTURE.names, {0}, 1, full=False)
    folder = tmp_path_factory.mktemp("pictures")
    return write_pictures(CAPTURE, TRUTH, folder, PictureSize.PREVIEW, plan=plan).previews


def deviations(codes: np.ndarray) -> np.ndarray:
    """Standard deviations, as `viewer.js` reads codes."""
    return 2 * np.sinh((codes.astype(float) - RESIDUAL_ZERO) / RESIDUAL_CODES)


def test_residuals_of_the_right_model_are_the_noise(previews: list[Preview]) -> None:
    codes = unpacked(previews[0].residual, 1, np.uint8).ravel()
    assert len(codes) == previews[0].width * previews[0].height == 120 * 120
    usable = CAPTURE.samples().usable(0)
    assert (codes > 0).sum() == usable.sum()
    # The spread of 6,000 normal deviates to 2 %, and rounding to codes.
    assert deviations(codes[codes > 0]).std() == pytest.approx(1, abs=0.06)


def test_codes_of_residuals_are_exact_to_half_a_deviation_and_hold_wild_ones() -> None:
    values = np.array([-1e6, -3.0, -1.0, 0.0, 0.5, 2.0, 1e9])
    read = deviations(residual_codes(values, np.ones(7, dtype=bool)))
    assert np.abs(read[1:-1] - values[1:-1]).max() < 0.65
    assert read[[0, -1]] / values[[0, -1]] == pytest.approx(1, abs=0.2)
    assert residual_codes(values, np.zeros(7, dtype=bool)).max() == 0


def test_profiles_have_the_brightness_of_photograph_and_model(previews: list[Preview]) -> None:
    one = previews[0]
    codes = unpacked(one.brightness, one.columns, np.uint16).reshape(2, -1, one.columns)
    values = one.top * (codes / BRIGHTNESS_STEPS) ** 2
    every = slice(one.stride // 2, None, one.stride)
    photo = CAPTURE.scene.surface.image(CAPTURE.radiance(0).mean(axis=1))[every, every]
    model = render_image(CAPTURE.scene, 0, TRUTH).numpy().mean(axis=2)[every, every]
    # Half a step of codes of the root.
    assert np.abs(values[0] - photo.clip(0)).max() < 0.003 * one.top
    assert np.abs(values[1] - model).max() < 0.003 * one.top


def test_the_others_have_small_previews(previews: list[Preview]) -> None:
    assert (previews[1].width, previews[1].step) == (60, 2)
    assert previews[1].stride * previews[1].columns == 60
    assert len(previews[1].residual) < 0.5 * len(previews[0].residual)


def test_pictures_are_jpegs_of_their_channels() -> None:
    for channels in (1, 3):
        uri = jpeg(np.full((20, 30, channels), 90, dtype=np.uint8))
        content = base64.b64decode(uri.partition(",")[2])
        assert simplejpeg.decode_jpeg_header(content)[:2] == (20, 30)
    assert thinned(np.zeros((90, 30, 3), dtype=np.uint8), 45).shape == (45, 15, 3)
