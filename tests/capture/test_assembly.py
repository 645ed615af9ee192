"""From a description to scene, encoding and exposures."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import torch

from matest.capture import schema
from matest.capture.assembly import ImageFormat, realise
from matest.capture.description import describe
from matest.photographs.images import write_image
from matest.photographs.noise import Noise
from matest.photographs.sensor import Sensor
from matest.scene import PointLight
from tests.captures import SHAPE, CaptureFolder, encode_as_png, refusal, sphere_normals

FLOATS = ImageFormat(SHAPE, 3, np.dtype(np.float32))


def test_a_capture_is_the_setup_of_its_description_with_pixels(folder: CaptureFolder) -> None:
    folder.tables |= {"noise": {"read": 0.01}, "encoding": {"scale": 2.0, "black": 0.1}}
    folder.tables["image"][1]["exposure"] = 3.0
    capture = folder.load()
    setup = realise(describe(folder.path, schema.CaptureFile), FLOATS, precision=np.float32)
    assert setup.noise == Noise(0.01, 0.0)
    assert (setup.exposures, setup.relative, setup.names) == ((1.0, 3.0), False, ("00.npy", "01.npy"))
    assert (setup.encoding.scale, setup.encoding.black, setup.encoding.saturation) == (2.0, 0.1, None)
    torch.testing.assert_close(setup.scene.surface.normals, capture.scene.surface.normals, rtol=0, atol=0)
    sensor = Sensor(setup.encoding, capture.photographs.noise)
    photographs = setup.photographs(capture.photographs.stored, sensor)
    assert photographs.noise_stated
    np.testing.assert_array_equal(photographs.radiance(1), capture.radiance(1))


def test_integers_are_saturated_near_full_scale_unless_it_is_said(folder: CaptureFolder) -> None:
    description = describe(folder.save(), schema.CaptureFile)
    codes = ImageFormat.of(np.zeros((*SHAPE, 3), np.uint16))
    assert realise(description, codes, transfer="linear").encoding.saturation == 0.98
    folder.tables["encoding"] = {"saturation": [0.9, 0.8, 0.7]}
    setup = realise(describe(folder.save(), schema.CaptureFile), codes, transfer="linear")
    assert (setup.encoding.saturation, setup.saturation_stated) == ((0.9, 0.8, 0.7), True)


@pytest.mark.parametrize("saturation", [[0.9, 0.8], 0.0, [0.9, -1.0, 0.9]])
def test_a_saturation_of_no_image_is_refused(folder: CaptureFolder, saturation: object) -> None:
    folder.tables["encoding"] = {"saturation": saturation}
    assert "encoding.saturation must be" in refusal(folder.load)


@pytest.mark.parametrize(
    ("saturation", "mend"),
    [
        (95, "did you mean 0.95?"),
        ([0.9, 0.9, 95], "did you mean 0.95?"),
        (1.5, "give at most 1"),
        (64225, "did you mean 0.98?"),
        (1e6, "give at most 1"),
    ],
)
def test_a_saturation_that_no_code_can_exceed_is_refused(folder: CaptureFolder, saturation: object, mend: str) -> None:
    encode_as_png(folder, np.uint16)
    folder.tables["encoding"]["saturation"] = saturation
    message = refusal(folder.load)
    assert str(folder.file) in message
    assert "fraction of full scale" in message
    assert mend in message


def test_floats_may_saturate_at_any_level(folder: CaptureFolder) -> None:
    folder.tables["encoding"] = {"saturation": 95}
    assert folder.load().photographs.encoding.saturation == 95


def test_grey_images_may_be_lit_by_three_equal_numbers(folder: CaptureFolder) -> None:
    for image in folder.tables["image"]:
        image["lights"][0]["irradiance"] = [2.0, 2.0, 2.0]
    description = describe(folder.save(), schema.CaptureFile)
    lights = realise(description, ImageFormat(SHAPE, 1, np.dtype(np.float32))).scene.lights
    assert lights[0][0].power.tolist() == [2.0]
    folder.tables["image"][0]["lights"][0]["irradiance"] = [2.0, 2.0, 2.1]
    description = describe(folder.save(), schema.CaptureFile)
    assert "one number or 1" in refusal(lambda: realise(description, ImageFormat(SHAPE, 1, np.dtype(np.float32))))


@pytest.fixture
def lamp(folder: CaptureFolder) -> dict[str, Any]:
    """The light of the first image, near the sphere."""
    write_image(folder.path / "normals.exr", sphere_normals())
    write_image(folder.path / "positions.exr", sphere_normals())
    folder.tables["geometry"] = {"normals": "normals.exr", "positions": "positions.exr"}
    light: dict[str, Any] = {"position": [1.0, 0.0, 4.0], "intensity": 20.0}
    folder.tables["image"][0]["lights"] = [light]
    return light


@pytest.mark.parametrize(("beam", "exponent"), [({}, 1.0), ({"anisotropy": 2.5}, 2.5)])
def test_a_near_light_with_an_axis_is_an_led(
    folder: CaptureFolder, lamp: dict[str, Any], beam: dict[str, float], exponent: float
) -> None:
    lamp |= {"axis": [0.0, 0.0, -2.0]} | beam
    capture = folder.load()
    (light,) = capture.scene.lights[0]
    assert isinstance(light, PointLight)
    assert light.axis is not None
    assert (light.axis.tolist(), light.anisotropy) == ([0.0, 0.0, -1.0], exponent)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"axis": [0.0, 0.0, 0.0]}, "axis must point along the beam"),
        ({"axis": [0.0, 0.0, math.nan]}, "axis must be finite"),
        ({"anisotropy": 1.0}, "anisotropy goes with axis"),
        ({"axis": [0.0, 0.0, -1.0], "anisotropy": -1.0}, "between 0 and 1000"),
        ({"axis": [0.0, 0.0, -1.0], "anisotropy": math.nan}, "between 0 and 1000"),
        ({"axis": [0.0, 0.0, -1.0], "direction": [0.0, 0.0, 1.0]}, "not with direction"),
    ],
    ids=["no axis", "NaN", "no beam", "negative", "NaN exponent", "distant"],
)
def test_a_beam_that_makes_no_sense_is_refused(
    folder: CaptureFolder, lamp: dict[str, Any], change: dict[str, Any], words: str
) -> None:
    if "direction" in change:
        lamp.clear()
    lamp |= change
    message = refusal(folder.load)
    assert message.startswith(f"{folder.file}: image 0, light 0")
    assert words in message
