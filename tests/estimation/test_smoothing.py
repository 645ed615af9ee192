"""Smoothed maps: what noise they lose, which edges they keep, and what their error bars hold."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
import torch

import matest
from matest.estimation.options import Options
from matest.estimation.parameter_map import ParameterMap, TexelStatus
from matest.estimation.smoothing import smoothed
from matest.inference.quantities import ParameterEstimate
from matest.photographs.images import read_image
from matest.report.folder import write_result
from matest.scene import Surface
from matest.scene.surface import from_normals
from tests.captures import refusal
from tests.estimation.test_mapping import VARIED, capture_of

CERTAIN = ParameterEstimate(0.5, None, None, "1", "determined")
CHANNELS = np.array([1.0, 0.8, 0.6])


def plane(size: int, hole: tuple[int, int] | None = None) -> Surface:
    normals = np.zeros((size, size, 3))
    normals[..., 2] = 1
    if hole is not None:
        normals[hole] = 0
    return from_normals(normals, None)


def map_of(value: np.ndarray, std: np.ndarray, status: np.ndarray | None = None) -> ParameterMap:
    """A map of images [H, W, C]."""
    flat = [torch.from_numpy(part.reshape(-1, part.shape[-1]).astype(np.float32)) for part in (value, std)]
    codes = np.full(len(flat[0]), TexelStatus.DETERMINED) if status is None else status.ravel()
    return ParameterMap("albedo", *flat, torch.from_numpy(codes.astype(np.uint8)))


def squares(
    size: int, contrast: float, relative: float, seed: int = 0
) -> tuple[ParameterMap, torch.Tensor, np.ndarray]:
    """A noisy map of squares of 16 pixels and two albedos, less certain to the right; its truth; what is at an edge."""
    y, x = np.mgrid[:size, :size]
    truth = np.where((y // 16 + x // 16) % 2, 0.3 * contrast, 0.3)[..., None] * CHANNELS
    std = relative * 0.4 * CHANNELS * (1 + 4 * (x / size) ** 4)[..., None]
    value = truth + std * np.random.default_rng(seed).standard_normal(truth.shape)
    inside = np.minimum(np.minimum(y % 16, 15 - y % 16), np.minimum(x % 16, 15 - x % 16))
    return map_of(value, std), torch.from_numpy(truth.reshape(-1, 3)), (inside < 2).ravel()


def covered(found: ParameterMap, truth: torch.Tensor, where: np.ndarray) -> float:
    errors = ((found.value - truth) / found.std)[torch.from_numpy(where)]
    return float((errors.abs() < 1.96).double().mean())


@pytest.mark.parametrize(("contrast", "at_edges"), [(1.0, 0.93), (2.0, 0.93), (1.2, 0.85)])
def test_noise_falls_and_error_bars_with_it(contrast: float, at_edges: float) -> None:
    each, truth, edge = squares(96, contrast, 0.05)
    found = smoothed(each, plane(96), 3, CERTAIN)
    before, after = (float((one.value - truth).square().mean().sqrt()) for one in (each, found))
    assert after < 0.32 * before
    assert covered(found, truth, ~edge) == pytest.approx(0.95, abs=0.015)
    assert covered(found, truth, edge) > at_edges


def test_weights_and_error_bars_are_those_of_their_definition() -> None:
    size, radius, hole = 8, 2, (3, 4)
    rng = np.random.default_rng(1)
    value, std = rng.uniform(0.3, 0.4, (size, size, 2)), rng.uniform(0.01, 0.05, (size, size, 2))
    present = np.ones((size, size), bool)
    present[hole] = False
    pixels = [tuple(p) for p in np.argwhere(present)]

    def filtered(guide: np.ndarray | None, spread: np.ndarray | None, reach: float):
        means, variances = value.copy(), std**2
        for p in pixels:
            near = [q for q in pixels if math.dist(p, q) <= reach]
            closeness = [1.0] * len(near)
            if guide is not None:
                apart = [np.mean((guide[p] - guide[q]) ** 2 / (spread[p] + spread[q])) / 1.5**2 for q in near]
                far = [(math.dist(p, q) / (reach * 2 / 3)) ** 2 for q in near]
                closeness = [math.exp(-0.5 * (a + f)) for a, f in zip(apart, far, strict=True)]
                closeness[near.index(p)] = 1.0
            weights = np.array([k / std[q] ** 2 for k, q in zip(closeness, near, strict=True)])
            sources = np.array([value[q] for q in near])
            means[p] = (weights * sources).sum(0) / weights.sum(0)
            variances[p] = (weights**2 * np.array([std[q] ** 2 for q in near])).sum(0) / weights.sum(0) ** 2
        return means, variances

    guide = filtered(None, None, 1.5)
    for _ in range(2):
        guide = filtered(*guide, radius)
    each = map_of(value[present][:, None], std[present][:, None])
    found = smoothed(each, plane(size, hole), radius, CERTAIN)
    np.testing.assert_allclose(found.value.numpy(), guide[0][present], rtol=1e-4)
    np.testing.assert_allclose(found.std.numpy(), np.sqrt(guide[1][present]), rtol=1e-4)


def test_nothing_crosses_an_edge_beyond_the_noise() -> None:
    size = 24
    value = np.where(np.arange(size) < size // 2, 0.2, 0.8)[None, :, None] * np.ones((size, 1, 1))
    found = smoothed(map_of(value, np.full_like(value, 0.01)), plane(size), 4, CERTAIN)
    np.testing.assert_allclose(found.value.numpy(), value.reshape(-1, 1), atol=1e-4)


def test_an_uncertain_pixel_follows_its_neighbours() -> None:
    value, std = np.full((9, 9, 1), 0.4), np.full((9, 9, 1), 0.01)
    value[4, 4], std[4, 4] = 0.6, 0.2
    found = smoothed(map_of(value, std), plane(9), 3, CERTAIN)
    assert float(found.value[40]) == pytest.approx(0.4, abs=0.005)
    assert float(found.std[40]) < 0.005


def test_what_all_pixels_share_is_not_lessened() -> None:
    value = np.full((16, 16, 1), 0.4)
    each = map_of(value, np.full_like(value, math.hypot(0.04, 0.02)))
    found = smoothed(each, plane(16), 3, ParameterEstimate([0.5], [0.025], None, "1", "determined"))
    alone = smoothed(map_of(value, np.full_like(value, 0.04)), plane(16), 3, CERTAIN)
    torch.testing.assert_close(found.std, (alone.std.square() + 0.02**2).sqrt())


def test_what_the_model_gets_wrong_is_not_lessened() -> None:
    value = np.full((16, 16, 1), 0.4)
    found = smoothed(map_of(value, np.full_like(value, 0.04)), plane(16), 3, CERTAIN, chi2=4.0)
    alone = smoothed(map_of(value, np.full_like(value, 0.02)), plane(16), 3, CERTAIN)
    torch.testing.assert_close(found.std, (alone.std.square() + 0.04**2 - 0.02**2).sqrt())


def test_a_shape_whose_error_bars_grow_with_it_is_not_drawn_down() -> None:
    size, truth, relative = 64, 0.6, 0.15
    value = truth * (1 + relative * np.random.default_rng(2).standard_normal((size, size, 1)))
    # As of σ: what a pixel tells of it falls with its square.
    each = map_of(value, relative * truth * (value / truth) ** 2)
    found = smoothed(each, plane(size), 3, CERTAIN, is_shape=True)
    assert float(found.value.mean()) == pytest.approx(truth, rel=0.01)
    assert float(smoothed(each, plane(size), 3, CERTAIN).value.mean()) < 0.96 * truth
    assert covered(found, torch.full((size * size, 1), truth), np.ones(size * size, bool)) > 0.92


def test_pixels_that_no_photograph_shows_keep_no_value() -> None:
    value, std = np.full((9, 9, 1), 0.4), np.full((9, 9, 1), 0.01)
    status = np.full((9, 9), TexelStatus.DETERMINED)
    value[2:5, 2:5] = std[2:5, 2:5] = np.nan
    status[2:5, 2:5] = TexelStatus.UNSEEN
    found = smoothed(map_of(value, std, status), plane(9), 2, CERTAIN)
    np.testing.assert_array_equal(found.value.isnan().numpy(), np.isnan(value).reshape(-1, 1))
    np.testing.assert_array_equal(found.std.isnan().numpy(), np.isnan(value).reshape(-1, 1))
    np.testing.assert_array_equal(found.status.numpy(), status.ravel())


def test_shared_values_follow_others_and_are_not_followed() -> None:
    value, std = np.full((9, 9, 1), 0.4), np.full((9, 9, 1), 0.01)
    status = np.full((9, 9), TexelStatus.DETERMINED)
    value[:, 5:], std[:, 5:], status[:, 5:] = 0.44, 0.05, TexelStatus.SHARED
    found = smoothed(map_of(value, std, status), plane(9), 2, CERTAIN).value.reshape(9, 9)
    torch.testing.assert_close(found[:, :5], torch.full((9, 5), 0.4))
    assert bool((found[:, 5] < 0.41).all())
    torch.testing.assert_close(found[:, 8], torch.full((9,), 0.44))


def test_an_estimate_keeps_the_map_and_writes_the_smoothed_one_beside_it(tmp_path) -> None:
    capture = capture_of(VARIED, 1)
    plain = matest.estimate(capture, "oren-nayar", maps="albedo")
    estimate = matest.estimate(capture, "oren-nayar", maps="albedo", smooth_maps=3)
    torch.testing.assert_close(estimate.maps["albedo"].value, plain.maps["albedo"].value, equal_nan=True)
    found, surface = estimate.smooth_maps["albedo"], capture.scene.surface
    assert float(found.std.nanmedian()) < 0.4 * float(plain.maps["albedo"].std.nanmedian())
    assert any("Smoothed maps (radius 3 px)" in note for note in estimate.warnings)
    assert not plain.smooth_maps
    write_result(estimate, capture, tmp_path / "out")
    files = json.loads((tmp_path / "out" / "result.json").read_text("utf-8"))["maps"]["albedo"]
    for file, values in ((files["smooth"], found.value), (files["smooth_std"], found.std)):
        np.testing.assert_array_equal(read_image(tmp_path / "out" / file), surface.image(np.nan_to_num(values.numpy())))
    assert "smooth" not in plain.to_dict()["maps"]["albedo"]


@pytest.mark.parametrize("radius", [-1, 21, 2.5])
def test_a_radius_that_is_none_is_refused(radius: float) -> None:
    assert "radius in whole pixels up to 20" in refusal(lambda: Options(maps="albedo", smooth_maps=radius))


def test_smoothing_needs_a_map() -> None:
    assert "add --maps albedo" in refusal(lambda: Options(smooth_maps=3))
