"""How well each photograph is described, and which stand out."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

import matest
from matest.brdf import Lambert, OrenNayar
from matest.capture import Capture
from matest.estimation.photographs import PhotographFit, Turn, standing_out
from matest.estimation.result import Estimate
from matest.scene import Scene
from tests.captures import changed, directional
from tests.miscalibrated import STUDIO, brighter, photographed, tilted
from tests.simulated import Studio, coloured

CLAY = OrenNayar([0.7, 0.6, 0.5], 0.4)
BRIGHT, TURNED = 2, 5  # images
EXCESS, DEGREES = 0.1, 3.0


def exact(scene: Scene) -> Scene:
    return scene


def turned_light() -> Tensor:
    """Where the light of one image stands in truth."""
    stated = STUDIO.lights[TURNED][0].direction
    across = torch.linalg.cross(stated, torch.tensor([0.0, 0.0, 1.0], dtype=stated.dtype))
    angle = math.radians(DEGREES)
    return math.cos(angle) * stated + math.sin(angle) * across / across.norm()


def two_odd_ones(scene: Scene) -> Scene:
    excess = torch.zeros(len(scene))
    excess[BRIGHT] = EXCESS
    bent = brighter(excess)(scene)
    light = replace(bent.lights[TURNED][0], direction=turned_light())
    return replace(bent, lights=tuple((light,) if k == TURNED else each for k, each in enumerate(bent.lights)))


def odd(found: Estimate) -> dict[str, str]:
    return {image.file: image.stands_out for image in found.images if image.stands_out}


@pytest.fixture(scope="module")
def spoilt() -> Estimate:
    return matest.estimate(photographed(CLAY, two_odd_ones, seed=0), "oren-nayar")


def test_an_image_too_bright_and_a_light_that_is_elsewhere_are_named(spoilt: Estimate) -> None:
    assert odd(spoilt) == {"02.exr": "level", "05.exr": "direction"}
    said = [warning for warning in spoilt.warnings if "02.exr" in warning or "05.exr" in warning]
    assert len(said) == 1
    assert re.match(
        r"02\.exr is (10|9\.9) % too bright for its light and 05\.exr's light stands (2\.9|3)° off: ", said[0]
    )


def test_what_is_wrong_with_them_is_told_to_its_standard_error(spoilt: Estimate) -> None:
    bright, turned = spoilt.images[BRIGHT], spoilt.images[TURNED]
    assert bright.level_std < 0.002
    assert abs(bright.level - 1 - EXCESS) < 4 * bright.level_std
    assert bright.direction is not None
    assert bright.direction.degrees < 0.2
    assert turned.direction is not None
    assert turned.direction.std < 0.06
    assert abs(turned.direction.degrees - DEGREES) < 4 * turned.direction.std
    assert turned.direction.toward == pytest.approx(turned_light().tolist(), abs=math.radians(0.2))
    assert abs(turned.level - 1) < 0.03


def test_clean_captures_say_nothing() -> None:
    for seed in range(3):
        assert odd(matest.estimate(photographed(CLAY, exact, seed), "oren-nayar")) == {}
        # Nor does a model that fits no image.
        assert odd(matest.estimate(photographed(CLAY, exact, seed), "lambert")) == {}


def test_errors_of_all_images_make_none_stand_out() -> None:
    tilts = 0.01 * torch.randn(8, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    assert odd(matest.estimate(photographed(CLAY, tilted(tilts), 0), "oren-nayar")) == {}


def test_errors_of_images_add_up_to_that_of_the_fit() -> None:
    # So many values that the four that are fitted do not count.
    capture = photographed(CLAY, two_odd_ones, seed=1, studio=replace(STUDIO, size=64))
    found = matest.estimate(capture, "oren-nayar", holdout=[0])
    assert [image.file for image in found.images] == [*capture.names[1:]]
    alone = matest.estimate(one_image(capture, 1), "oren-nayar", fix={"sigma": 0.4})
    assert alone.images[0].relative_rmse == pytest.approx(alone.fit.relative_rmse)
    assert alone.images[0].reduced_chi2 == pytest.approx(alone.fit.reduced_chi2, rel=1e-3)
    errors = [image.relative_rmse for image in found.images]
    assert min(errors) < found.fit.relative_rmse < max(errors)


def one_image(capture: Capture, image: int) -> Capture:
    photographs = capture.photographs
    scene = replace(photographs.scene, lights=(photographs.scene.lights[image],), ambient=photographs.scene.ambient[:1])
    return replace(
        capture,
        photographs=replace(
            photographs, scene=scene, stored=(photographs.stored[image],), exposures=(1.0,), names=("only.exr",)
        ),
    )


def test_beside_refined_errors_nothing_is_left_to_tell() -> None:
    found = matest.estimate(photographed(CLAY, two_odd_ones, seed=0), "oren-nayar", refine=("intensity", "direction"))
    assert odd(found) == {}
    assert all(abs(image.level - 1) < 4 * image.level_std for image in found.images)
    assert all(image.reduced_chi2 < 1.1 for image in found.images)


def test_lights_of_an_image_turn_together() -> None:
    first, second = (directional(direction, 1.5) for direction in ((0.3, 0.2, 0.93), (-0.5, 0.1, 0.86)))
    pairs = Studio(size=24, lights=((first, second), (second,), (first,)))
    found = matest.estimate(pairs.photograph(Lambert(0.6), 0), "lambert")
    assert found.images[0].direction is not None
    assert found.images[0].direction.toward is None
    assert found.images[1].direction is not None
    assert found.images[1].direction.toward == pytest.approx(second.direction.tolist(), abs=math.radians(1))


def test_a_single_photograph_has_no_level() -> None:
    found = matest.estimate(one_image(photographed(CLAY, exact, seed=0), 0), "oren-nayar")
    assert (found.images[0].level, found.images[0].level_std) == (None, None)
    assert found.images[0].relative_rmse == pytest.approx(found.fit.relative_rmse)


def test_black_photographs_say_nothing_of_their_lights() -> None:
    capture = Studio(size=24).photograph(Lambert(0.6), 0)
    black = changed(capture, stored=tuple(0 * values for values in capture.photographs.stored))
    records = matest.estimate(black, "lambert").to_dict()["images"]
    assert [(record["level"], record["direction"]) for record in records] == [(None, None)] * 6
    json.dumps(records, allow_nan=False)


def test_a_sky_has_no_direction() -> None:
    studio = Studio(size=24, lights=Studio().lights[:3], ambient=0.5)
    capture = studio.expose(0.6 * 0.5 * np.ones_like(studio.clean(Lambert(0.6))), 0)
    found = matest.estimate(changed(capture, scene=replace(studio.scene, lights=((), (), ()))), "lambert")
    assert [image.direction for image in found.images] == [None] * 3
    assert all(abs(image.level - 1) < 5 * image.level_std for image in found.images)


def test_the_records_are_written() -> None:
    found = matest.estimate(Studio(size=24, lights=coloured()[:3]).photograph(Lambert(0.6), 0), "lambert")
    records = found.to_dict()["images"]
    assert [record["file"] for record in records] == ["00.exr", "01.exr", "02.exr"]
    keys = {"file", "relative_rmse", "level", "level_std", "reduced_chi2", "direction", "stands_out", "times"}
    assert set(records[0]) == keys
    assert set(records[0]["direction"]) == {"degrees", "std", "toward"}


def fit(file: str, **changes: object) -> PhotographFit:
    plain = PhotographFit(file, 0.01, 1.0, 0.001, 1.0, Turn(0.1, 0.05, [0.0, 0.0, 1.0]))
    return replace(plain, **changes)  # type: ignore[arg-type]


def test_of_many_the_worst_are_named_and_the_others_counted() -> None:
    fits = [fit(f"{k}.png", level=1 - 0.02 * k, stands_out="level", times=5.0 * k) for k in range(1, 6)]
    (sentence,) = standing_out([fit("fine.png"), *fits])
    assert sentence.startswith("5.png is 10 % too dark for its light, 4.png is 8 % too dark")
    assert "3.png" in sentence
    assert "2.png" not in sentence
    assert "(and 2 more)" in sentence
    assert [*standing_out([fit("fine.png")])] == []
