"""Residuals of maps tell a shape that differs from pixel to pixel, and what every photograph has left."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.nn.functional import normalize

import matest
from matest.benchmark.instruments.photographs import Sensor, ring, sphere, subject
from matest.brdf import OrenNayar
from matest.capture import Capture
from matest.estimation.result import Estimate

SIZE = 48


def halves(left: float, right: float) -> Tensor:
    surface = sphere(SIZE)
    return torch.from_numpy(np.where(surface.pixels % SIZE < SIZE // 2, left, right))[:, None]


def photographed(low: float, high: float, lights: int = 8) -> Capture:
    """A sphere of two albedos, and of two values of σ."""
    return subject(sphere(SIZE), ring(lights), OrenNayar(halves(0.3, 0.6), halves(low, high)), Sensor()).photograph()


def advice(estimate: Estimate) -> list[str]:
    return [note for note in estimate.warnings if "from pixel to pixel" in note]


def test_a_shape_that_differs_is_named_with_its_size() -> None:
    estimate = matest.estimate(photographed(0.2, 0.6), "oren-nayar", maps="albedo")
    (note,) = advice(estimate)
    assert note.startswith("sigma differs from pixel to pixel, by about ±0.")
    assert float(note.partition("±")[2].partition(" ")[0]) == pytest.approx(0.2, rel=0.2)
    assert note.endswith("--maps albedo,sigma.")
    mended = matest.estimate(photographed(0.2, 0.6), "oren-nayar", maps="albedo,sigma")
    assert mended.fit.reduced_chi2 < 1.1
    assert not advice(mended)
    assert any("take that of their region: there are 2" in note for note in mended.warnings)


def test_one_shape_is_not_taken_for_several() -> None:
    assert not advice(matest.estimate(photographed(0.4, 0.4), "oren-nayar", maps="albedo"))


def test_wrong_lights_are_not_taken_for_a_shape_that_differs() -> None:
    capture, generator = photographed(0.4, 0.4), torch.Generator().manual_seed(0)
    lights = [
        (replace(light, direction=normalize(light.direction + 0.01 * torch.randn(3, generator=generator), dim=0)),)
        for (light,) in capture.scene.lights
    ]
    scene = replace(capture.scene, lights=tuple(lights))
    wrong = replace(capture, photographs=replace(capture.photographs, scene=scene))
    estimate = matest.estimate(wrong, "oren-nayar", maps="albedo")
    assert estimate.fit.reduced_chi2 > 1.2
    assert not advice(estimate)


def test_the_chi2_of_photographs_is_that_of_what_texels_leave_of_them() -> None:
    """Of three values of a pixel its map takes one: a third of χ² per value is missing, and not of all alike."""
    estimate = matest.estimate(photographed(0.4, 0.4, lights=3), "oren-nayar", maps="albedo")
    assert estimate.fit.reduced_chi2 == pytest.approx(1, abs=0.05)
    for photograph in estimate.images:
        assert photograph.reduced_chi2 == pytest.approx(1, abs=0.08)
