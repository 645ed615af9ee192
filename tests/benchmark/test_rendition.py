"""What Mitsuba renders, beside what matest shades."""

from __future__ import annotations

import math

import numpy as np
import pytest

from matest.benchmark.instruments.rendition import difference, rendered, shaded
from matest.brdf import Lambert
from matest.scene import Camera
from matest.scene.surface import from_sphere

pytest.importorskip("mitsuba").set_variant("scalar_rgb")
SIZE = 16
SURFACE = from_sphere((SIZE, SIZE), (SIZE / 2, SIZE / 2), SIZE / 2, None)
CAMERA = Camera((0.0, 0.0, 3.0), height=2.0)
LIGHT = np.array([0.6, 0.0, 0.8])
BALL = {"type": "sphere", "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.5, 0.4, 0.3]}}}


def test_a_matte_ball_is_lit_by_the_cosine_in_both() -> None:
    cosine = np.clip(SURFACE.normals.numpy() @ LIGHT, 0, None)[:, None]
    expected = cosine * np.array([0.5, 0.4, 0.3]) / math.pi
    np.testing.assert_allclose(shaded(Lambert([0.5, 0.4, 0.3]), SURFACE, LIGHT), expected, atol=1e-12)
    image = rendered(BALL, CAMERA, LIGHT, SURFACE.shape).reshape(-1, 3)[SURFACE.pixels]
    np.testing.assert_allclose(image, expected, atol=1e-6)


def test_a_body_that_is_a_tenth_too_bright_is_off_by_a_tenth() -> None:
    found = difference(BALL, Lambert([0.55, 0.44, 0.33]), SURFACE, CAMERA, [LIGHT])
    assert (found.rms, found.largest) == pytest.approx((1 - 1 / 1.1, 1 - 1 / 1.1), rel=1e-3)
