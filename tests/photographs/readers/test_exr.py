from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from matest.photographs.images import read_image, read_image_file, read_mask
from tests.captures import refusal
from tests.photographs.image_files import write_exr

HEIGHT, WIDTH = 6, 9


def planes(names: str | list[str]) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(14)
    return {name: rng.uniform(0, 9, (HEIGHT, WIDTH)).astype(np.float32) for name in names}


def stacked(channels: dict[str, np.ndarray], names: str | list[str] = "RGB") -> np.ndarray:
    return np.stack([channels[name] for name in names], axis=-1)


def layer(name: str, names: str = "RGB") -> list[str]:
    return [f"{name}.{channel}" for channel in names]


@pytest.mark.parametrize(
    "data", [(2, 1, 5, 4), (-2, -3, 6, 8), (-4, 2, 4, 20), (0, 0, 8, 5)], ids=["inside", "outside", "across", "same"]
)
@pytest.mark.parametrize("origin", [(0, 0), (100, -50)])
def test_the_data_window_lies_where_it_belongs_in_the_display_window(tmp_path, data, origin):
    left, top, right, bottom = data
    pixels = np.random.default_rng(15).uniform(1, 2, (bottom - top + 1, right - left + 1, 3)).astype(np.float32)
    x, y = origin
    header = {
        "type": OpenEXR.scanlineimage,
        "compression": OpenEXR.ZIP_COMPRESSION,
        "dataWindow": ((left + x, top + y), (right + x, bottom + y)),
        "displayWindow": ((x, y), (x + WIDTH - 1, y + HEIGHT - 1)),
    }
    OpenEXR.File(header, {"RGB": pixels}).write(str(tmp_path / "a.exr"))
    expected = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    for row in range(HEIGHT):
        for column in range(WIDTH):
            if top <= row <= bottom and left <= column <= right:
                expected[row, column] = pixels[row - top, column - left]
    file = read_image_file(tmp_path / "a.exr")
    np.testing.assert_array_equal(file.pixels, expected)
    assert any("display window" in note for note in file.notes) == (data != (0, 0, 8, 5))


def test_a_data_window_outside_of_the_image_is_refused(tmp_path):
    header = {"type": OpenEXR.scanlineimage, "dataWindow": ((20, 0), (28, 5)), "displayWindow": ((0, 0), (8, 5))}
    OpenEXR.File(header, {"RGB": np.ones((HEIGHT, WIDTH, 3), np.float32)}).write(str(tmp_path / "a.exr"))
    assert "outside" in refusal(lambda: read_image(tmp_path / "a.exr"))


@pytest.mark.parametrize("names", ["RGB", "Y"])
def test_alpha_is_divided_out_and_said_to_be(tmp_path, names):
    colours, alpha = planes(names), np.full((HEIGHT, WIDTH), 0.25, np.float32)
    alpha[:2] = 0
    write_exr(tmp_path / "a.exr", {name: plane * alpha for name, plane in colours.items()} | {"A": alpha})
    file = read_image_file(tmp_path / "a.exr")
    np.testing.assert_array_equal(file.pixels[2:], stacked(colours, names)[2:])
    assert not file.pixels[:2].any()
    np.testing.assert_array_equal(file.coverage, alpha)
    assert ["alpha" in note for note in file.notes] == [True]


def test_light_without_coverage_is_zero(tmp_path):
    alpha = np.ones((HEIGHT, WIDTH), np.float32)
    alpha[0] = 0
    write_exr(tmp_path / "a.exr", planes("RGB") | {"A": alpha})
    assert not read_image(tmp_path / "a.exr")[0].any()


def test_an_alpha_that_is_zero_everywhere_is_refused(tmp_path):
    write_exr(tmp_path / "a.exr", planes("RGB") | {"A": np.zeros((HEIGHT, WIDTH), np.float32)})
    assert "alpha is 0 everywhere" in refusal(lambda: read_image(tmp_path / "a.exr"))


def test_full_alpha_changes_nothing(tmp_path):
    channels = planes("RGB") | {"A": np.ones((HEIGHT, WIDTH), np.float32)}
    write_exr(tmp_path / "a.exr", channels)
    file = read_image_file(tmp_path / "a.exr")
    np.testing.assert_array_equal(file.pixels, stacked(channels))
    assert not file.notes


def test_the_alpha_of_a_photograph_is_its_mask(tmp_path):
    alpha = np.zeros((HEIGHT, WIDTH), np.float32)
    alpha[1:4, 2:5], alpha[1, 2] = 1, 0.5
    write_exr(tmp_path / "a.exr", {name: plane * alpha for name, plane in planes("RGB").items()} | {"A": alpha})
    np.testing.assert_array_equal(read_mask(tmp_path / "a.exr"), alpha)


CHOICES = {
    "the layer without a name": (["R", "G", "B", *layer("diffuse")], "", "not diffuse"),
    "the only layer": (layer("diffuse"), "diffuse.", "layer diffuse is read"),
    "the only picture": (layer("diffuse") + layer("depth", "Z") + layer("depth", "W"), "diffuse.", "layer diffuse"),
    "the whole picture": (layer("View.Combined") + layer("View.Normal", "XYZ"), "View.Combined.", "not View.Normal"),
}


@pytest.mark.parametrize("choice", CHOICES)
def test_the_layer_that_must_be_meant_is_read_and_named(tmp_path, choice):
    names, prefix, words = CHOICES[choice]
    channels = planes(names)
    write_exr(tmp_path / "a.exr", channels)
    file = read_image_file(tmp_path / "a.exr")
    np.testing.assert_array_equal(file.pixels, stacked(channels, [f"{prefix}{channel}" for channel in "RGB"]))
    assert len(file.notes) == 1
    assert words in file.notes[0]


def test_several_layers_are_refused_by_name(tmp_path):
    write_exr(tmp_path / "a.exr", planes(layer("diffuse") + layer("specular")))
    message = refusal(lambda: read_image(tmp_path / "a.exr"))
    assert "diffuse, specular" in message
    assert str(tmp_path / "a.exr") in message


def parts(path: Path, *names: str) -> list[dict[str, np.ndarray]]:
    rng = np.random.default_rng(16)
    channels = [{c: rng.uniform(0, 1, (HEIGHT, WIDTH)).astype(np.float32) for c in "RGB"} for _ in names]
    OpenEXR.File([OpenEXR.Part({}, dict(c), name=n) for c, n in zip(channels, names, strict=True)]).write(str(path))
    return channels


def test_the_first_part_is_read_and_the_others_are_named(tmp_path):
    first, _ = parts(tmp_path / "a.exr", "left", "right")
    file = read_image_file(tmp_path / "a.exr")
    np.testing.assert_array_equal(file.pixels, stacked(first))
    assert "not right" in file.notes[0]


@pytest.mark.parametrize("kind", [OpenEXR.scanlineimage, OpenEXR.tiledimage])
@pytest.mark.parametrize(
    ("compression", "damage"),
    [
        (OpenEXR.ZIP_COMPRESSION, "spoilt"),  # the others have no check sum
        (OpenEXR.ZIP_COMPRESSION, "cut"),
        (OpenEXR.PIZ_COMPRESSION, "cut"),
        (OpenEXR.RLE_COMPRESSION, "cut"),
    ],
)
def test_what_the_decoder_complains_of_is_refused(tmp_path, compression, damage, kind):
    smooth = np.tile(np.arange(400, dtype=np.float32), (300, 1))
    header = {"compression": compression, "type": kind}
    if kind == OpenEXR.tiledimage:
        header["tiles"] = OpenEXR.TileDescription()
    OpenEXR.File(header, {"Y": smooth}).write(str(tmp_path / "a.exr"))
    np.testing.assert_array_equal(read_image(tmp_path / "a.exr")[..., 0], smooth)
    data = bytearray((tmp_path / "a.exr").read_bytes())
    middle = len(data) // 2
    data[middle : middle + 60] = bytes(60)
    (tmp_path / "a.exr").write_bytes(data if damage == "spoilt" else data[:middle])
    message = refusal(lambda: read_image(tmp_path / "a.exr"))
    assert str(tmp_path / "a.exr") in message
    assert "OpenEXR says" in message


def test_channels_of_integers_are_refused(tmp_path):
    ids = np.arange(HEIGHT * WIDTH, dtype=np.uint32).reshape(HEIGHT, WIDTH)
    OpenEXR.File({"type": OpenEXR.scanlineimage}, {"id": ids}).write(str(tmp_path / "a.exr"))
    assert "expected floats" in refusal(lambda: read_image(tmp_path / "a.exr"))


def test_alpha_next_to_zero_gives_values_that_are_refused(tmp_path):
    alpha = np.ones((HEIGHT, WIDTH), np.float32)
    alpha[2, 3] = 1e-40
    write_exr(tmp_path / "a.exr", planes("RGB") | {"A": alpha})
    assert "1 pixel holds NaN, infinity or larger ones" in refusal(lambda: read_image(tmp_path / "a.exr"))


def test_luminance_with_chroma_is_refused(tmp_path):
    write_exr(tmp_path / "a.exr", planes(["Y", "RY", "BY"]))
    assert "R, G, B" in refusal(lambda: read_image(tmp_path / "a.exr"))


def test_chromaticities_of_another_type_are_refused(tmp_path):
    path = tmp_path / "a.exr"
    header = {"chromaticities": (0.7, 0.3, 0.2, 0.7, 0.15, 0.05, 0.31, 0.33), "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"RGB": np.ones((4, 5, 3), np.float32)}).write(str(path))
    name = b"chromaticities\0"
    path.write_bytes(path.read_bytes().replace(2 * name, name + b"chromaticityes\0"))
    assert "chromaticities are no numbers" in refusal(lambda: read_image(path))
