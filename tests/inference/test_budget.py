"""Error bars hold what errors of the calibration do to an estimate that does not refine them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import matest
from matest.brdf import CookTorrance, OrenNayar
from matest.scene import Scene
from tests.miscalibrated import STUDIO, Error, brighter, normal_deviates, photographed, tilted, under_sky

MATERIAL = OrenNayar([0.7, 0.5, 0.3], 0.4)
GLOSS = CookTorrance([0.4, 0.2, 0.1], 0.8, 0.25, f0=0.04)


def unchanged(scene: Scene) -> Scene:
    return scene


@pytest.mark.parametrize(("material", "parameter", "fix"), [
    (MATERIAL, "sigma", {}), (GLOSS, "slope", {"f0": 0.04}),
])  # fmt: skip
def test_the_part_of_an_error_bar_is_how_far_such_an_error_moves_the_estimate(
    material: OrenNayar | CookTorrance, parameter: str, fix: dict[str, float]
) -> None:
    size = 0.002
    clean = matest.estimate(
        photographed(material, unchanged, 1), material.expression, fix=fix, uncertainty={"ambient": size}
    )
    spoilt = matest.estimate(photographed(material, under_sky(size), 1), material.expression, fix=fix)
    moved = spoilt.parameters[parameter].value - clean.parameters[parameter].value
    added = clean.nuisance["ambient"].adds[parameter]
    assert added == pytest.approx(abs(moved), rel=0.25)
    fisher = matest.estimate(photographed(material, unchanged, 1), material.expression, fix=fix)
    assert clean.parameters[parameter].value == fisher.parameters[parameter].value
    expected = math.hypot(fisher.parameters[parameter].std, added)
    assert clean.parameters[parameter].std == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(("name", "size"), [("intensity", 0.03), ("direction", 0.0175)])
def test_estimates_with_stated_errors_lie_within_their_error_bars(name: str, size: float) -> None:
    deviations, covered = [], 0
    for seed in range(12):
        errors = size * normal_deviates(8, 3, seed=seed)
        error: Error = tilted(errors) if name == "direction" else brighter(errors[:, 0])
        estimate = matest.estimate(photographed(MATERIAL, error, seed), "oren-nayar", uncertainty={name: size})
        sigma = estimate.parameters["sigma"]
        deviations.append((sigma.value - 0.4) / sigma.std)
        covered += sigma.interval95[0] <= 0.4 <= sigma.interval95[1]
    assert covered >= 10
    assert float(np.sqrt(np.mean(np.square(deviations)))) > 0.3


def test_what_limits_an_error_bar_is_named() -> None:
    estimate = matest.estimate(photographed(MATERIAL, unchanged, 1), "oren-nayar", uncertainty={"radius": 1.0})
    assert estimate.nuisance["radius"].limits == ["albedo", "sigma"]
    assert not estimate.nuisance["radius"].refined
    assert estimate.nuisance["radius"].value is None


def test_each_kind_of_error_adds_the_same_alone_and_among_others() -> None:
    capture = photographed(MATERIAL, unchanged, 1)
    stated = {"radius": 0.3, "blur": 0.5, "normal_noise": 0.01}
    together = matest.estimate(capture, "oren-nayar", uncertainty=stated).nuisance
    for name, size in stated.items():
        alone = matest.estimate(capture, "oren-nayar", uncertainty={name: size}).nuisance[name]
        assert together[name].adds["sigma"] == pytest.approx(alone.adds["sigma"], rel=1e-6)


def test_normals_that_are_noisy_widen_error_bars_with_the_root_of_the_number_of_pixels() -> None:
    stds = []
    for size in (48, 96):
        studio = replace(STUDIO, size=size)
        capture = photographed(MATERIAL, unchanged, 1, studio)
        stds.append(
            matest.estimate(capture, "oren-nayar", uncertainty={"normal_noise": 0.005})
            .nuisance["normal_noise"]
            .adds["sigma"]
        )
    assert 1.4 < stds[0] / stds[1] < 2.6
