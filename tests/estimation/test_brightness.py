"""An estimate says when a surface cannot be as bright or as dark as it comes out."""

from __future__ import annotations

import numpy as np
import pytest

from matest import estimate
from tests.captures import CaptureFolder, encode_as_png, refusal

SAID = "encoding.scale, an exposure or an irradiance is likely wrong by that much"


@pytest.mark.parametrize("scale", [1e-8, 1e-6])
def test_an_albedo_darker_than_any_surface_is_told(folder: CaptureFolder, scale: float) -> None:
    folder.tables["encoding"] = {"scale": scale}
    warnings = estimate(folder.load(), model="lambert").warnings
    assert any(sentence.startswith("No surface is as dark as") and SAID in sentence for sentence in warnings)


def test_images_brighter_than_any_surface_are_told(folder: CaptureFolder) -> None:
    folder.tables["encoding"] = {"scale": 1e8}
    capture = folder.load()
    try:
        said = estimate(capture, model="lambert").warnings
    except ValueError as error:
        said = [str(error)]
    assert any("times as bright as a white surface" in sentence and SAID in sentence for sentence in said)


def test_images_too_dark_to_be_fitted_are_not_called_saturated(folder: CaptureFolder) -> None:
    encode_as_png(folder, np.uint16)
    folder.tables |= {"encoding": {"scale": 1e-12, "transfer": "linear"}, "noise": {"read": 2e-4, "gain": 1e-5}}
    message = refusal(lambda: estimate(folder.load(), model="lambert"))
    assert f"times as bright as a white surface would be: they are black, or {SAID}" in message


@pytest.mark.parametrize("scale", [0.01, 1.0])
def test_what_a_surface_can_be_is_not_remarked_on(folder: CaptureFolder, scale: float) -> None:
    folder.tables["encoding"] = {"scale": scale}
    assert not any(SAID in sentence for sentence in estimate(folder.load(), model="lambert").warnings)


def test_of_lights_of_unknown_strength_nothing_is_said(folder: CaptureFolder) -> None:
    folder.tables["encoding"] = {"scale": 1e-8, "radiometry": "relative"}
    assert not any(SAID in sentence for sentence in estimate(folder.load(), model="lambert").warnings)


def test_powers_of_immense_floats_stay_numbers(folder: CaptureFolder) -> None:
    folder.tables["encoding"] = {"scale": 1e-10}
    for table in folder.tables["image"]:
        file = folder.path / table["file"]
        np.save(file, np.load(file) * 1e10)
    assert estimate(folder.load(), model="lambert").parameters["albedo"].status == "determined"
