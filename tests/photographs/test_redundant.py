"""Channels and photographs that say nothing new."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from matest import load_capture
from matest.brdf import OrenNayar
from matest.capture import Capture
from matest.estimation.estimate import estimate
from matest.estimation.prediction import predict
from matest.photographs.photographs import Photographs
from matest.photographs.redundant import redundancy, without_copies
from matest.samples.redundancy import Redundancy
from matest.simulate import simulate
from tests import scenes
from tests.captures import changed, directional, refusal
from tests.simulated import DIRECTIONS, Studio, coloured

TRUTH = OrenNayar(0.6, 0.4)


def grey(directions=DIRECTIONS[:3]) -> Capture:
    return Studio(size=32, lights=tuple((directional(d, 3.0),) for d in directions)).photograph(TRUTH, seed=1)


def as_colour(capture: Capture) -> Capture:
    """The same pixels three times."""
    lights = tuple((directional(d, 3.0, 3.0, 3.0),) for d in DIRECTIONS[: len(capture)])
    scene = replace(capture.scene, lights=lights, ambient=capture.scene.ambient.repeat(1, 3))
    stored = tuple(pixels.repeat(3, axis=1) for pixels in capture.photographs.stored)
    return changed(capture, scene=scene, stored=stored)


def found(capture: Capture, *images: int) -> Redundancy:
    """What is redundant among some of the images, or all."""
    return redundancy(capture.photographs, images or range(len(capture)))


def test_copies_of_a_channel_count_once() -> None:
    single, reduced = grey(), as_colour(grey()).photographs.samples(distinct=True)
    photographs = reduced.photographs
    assert (photographs.channels, reduced.redundancy.channels, photographs.scene.channels) == (1, 2, 1)
    whole = as_colour(grey()).photographs.samples(distinct=True, every_channel=True)
    assert (whole.photographs.channels, whole.redundancy.channels) == (3, 0)
    one, other = estimate(single, "oren-nayar"), estimate(as_colour(grey()), "oren-nayar")
    assert other.parameters["sigma"].std == one.parameters["sigma"].std
    assert other.parameters["albedo"].value == one.parameters["albedo"].value
    assert any("copies" in work for work in other.skipped["work"])
    assert any("copies" in warning for warning in other.warnings)


def test_channels_that_differ_in_one_pixel_or_in_the_light_are_kept() -> None:
    capture = as_colour(grey())
    stored = [pixels.copy() for pixels in capture.photographs.stored]
    stored[2][7, 1] += 1e-4
    assert without_copies(changed(capture, stored=tuple(stored)).photographs).channels == 3
    tinted = changed(capture, scene=replace(capture.scene, lights=coloured(DIRECTIONS[:3])))
    assert without_copies(tinted.photographs).channels == 3
    assert without_copies(capture.photographs).channels == 1


def test_a_grey_capture_stored_in_colour_is_estimated_as_grey(tmp_path: Path) -> None:
    material = scenes.material("oren-nayar", albedo=0.6, sigma=0.4)
    scenes.write(tmp_path / "scene", material, scenes.sphere(32), scenes.noise(), scenes.distant(scenes.LIGHTS[:3]))
    folder = simulate(tmp_path / "scene", tmp_path / "ball")
    before = estimate(load_capture(folder), "oren-nayar", holdout=[0])
    for file in load_capture(folder).files:
        pixels = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        cv2.imwrite(str(file), np.repeat(pixels[..., None], 3, axis=2))
    capture = load_capture(folder)
    assert capture.channels == 3
    after = estimate(capture, "oren-nayar", holdout=[0])
    assert after.parameters["albedo"].value == before.parameters["albedo"].value
    assert after.parameters["sigma"].std == pytest.approx(before.parameters["sigma"].std, rel=1e-6)
    assert after.holdout["relative_rmse"] == pytest.approx(before.holdout["relative_rmse"])
    # Values for every channel still say what they say.
    even = estimate(capture, "oren-nayar", fix={"albedo": [0.6, 0.6, 0.6]})
    assert even.parameters["albedo"].value == 0.6
    coloured_body = estimate(capture, "oren-nayar", fix={"albedo": [0.6, 0.6, 0.5]})
    assert coloured_body.parameters["albedo"].value == [0.6, 0.6, 0.5]
    predicted, errors = predict(OrenNayar([0.6, 0.6, 0.6], 0.4), capture)
    assert predicted.shape[-1] == 3
    assert max(errors) < 0.1


def test_a_capture_without_any_light_is_refused() -> None:
    dark = Studio(size=32, lights=((directional(DIRECTIONS[0], 0.0),),)).photograph(TRUTH, seed=1)
    assert "correct irradiance" in refusal(lambda: estimate(dark, "lambert"))


def test_the_same_photograph_twice_is_one() -> None:
    capture = grey()
    photographs = capture.photographs
    twice = changed(
        capture,
        scene=replace(capture.scene, lights=capture.scene.lights * 2, ambient=capture.scene.ambient.repeat(2, 1)),
        stored=tuple(pixels.copy() for pixels in photographs.stored) * 2,
        exposures=photographs.exposures * 2,
        names=photographs.names * 2,
    )
    assert list(found(twice).images) == [3, 4, 5]
    one, both = estimate(capture, "oren-nayar"), estimate(twice, "oren-nayar")
    assert both.parameters["sigma"].std == one.parameters["sigma"].std
    pixels = 32 * 32
    assert both.skipped["samples"]["idle"] == 3 * pixels
    assert any("once more" in warning for warning in both.warnings)
    # A photograph left out of the fit stands for no other.
    assert list(found(twice, 3, 4, 5).images) == []


@pytest.mark.parametrize("change", ["pixels", "exposure", "light"])
def test_photographs_that_differ_in_anything_are_two(change: str) -> None:
    capture = grey((DIRECTIONS[0], DIRECTIONS[0]))
    stored = capture.photographs.stored[0]
    exposures, lights = (1.0, 1.0), capture.scene.lights
    other = stored.copy()
    if change == "pixels":
        other[11] += 1e-4
    elif change == "exposure":
        exposures = (1.0, 2.0)
    else:
        lights = (lights[0], (directional(DIRECTIONS[1], 3.0),))
    scene = replace(capture.scene, lights=lights)
    different = changed(capture, stored=(stored, other), exposures=exposures, scene=scene)
    assert found(different).images == {}
    # The same pixels under another light cannot be: one of the files is a copy.
    assert found(different).contradictions == ({} if change == "pixels" else {1: 0})
    told = any("are the same pixels" in warning for warning in estimate(different, "lambert").warnings)
    assert told is (change != "pixels")


def test_black_images_are_alike_under_any_light_but_count_once_under_one() -> None:
    lights = tuple((directional(d, 3.0),) for d in (*DIRECTIONS[:2], DIRECTIONS[1]))
    capture = Studio(size=32, lights=lights).photograph(TRUTH, seed=1)
    black = [0 * pixels for pixels in capture.photographs.stored]
    for pixels in black:
        pixels[7] = 0.5  # a dead pixel
    even = changed(capture, stored=tuple(black))
    assert found(even).contradictions == {}
    assert list(found(even).images) == [2]


def test_an_image_without_light_adds_nothing() -> None:
    lights = (*((directional(d, 3.0),) for d in DIRECTIONS[:2]), (directional(DIRECTIONS[2], 0.0),))
    capture = Studio(size=32, lights=lights).photograph(TRUTH, seed=1)
    assert list(found(capture).images) == [2]
    outcome = estimate(capture, "oren-nayar")
    assert any("stated to give none" in warning for warning in outcome.warnings)
    unlit = replace(capture.photographs, scene=replace(capture.scene, lights=(*capture.scene.lights[:2], ())))
    assert redundancy(unlit, range(3)).images == {2: "no light is stated for it"}
    counts = outcome.skipped["samples"]
    every = counts["background"] + counts["rim"] + counts["shadowed"] + counts["idle"] + outcome.fit.samples
    assert every == 3 * 32 * 32


def test_the_search_for_twins_runs_once_per_estimate(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []

    def counted(photographs: Photographs, images: Iterable[int]) -> Redundancy:
        calls.append(tuple(images))
        return redundancy(photographs, calls[-1])

    monkeypatch.setattr("matest.photographs.photographs.redundancy", counted)
    estimate(grey(), "lambert", holdout=[1])
    assert calls == [(0, 2)]
