from __future__ import annotations

from pathlib import Path

import pytest

from matest.capture import schema
from tests.captures import refusal

GOOD = """
mask = "mask.png"
[geometry]
mesh = "vase.ply"
[camera]
kind = "perspective"
position = [0, 0, 5]
fov_y = 0.35
distortion = [0.1, 0, 0, 0]
[encoding]
transfer = 2.2
black = "dark.png"
[noise]
read = 0.002
gain = 5e-4
[[image]]
file = "00.png"
exposure = 2
lights = [ { direction = [0.3, 0.2, 1], irradiance = [3.1, 3, 2] }, { position = [1, 2, 3], intensity = 4 } ]
ambient = 0.1
"""


@pytest.fixture
def file(tmp_path):
    return tmp_path / "capture.toml"


def read_text(file, text: str):
    file.write_text(text, "utf-8")
    return schema.read(file, schema.CaptureFile)


def test_a_complete_file_is_read(file):
    tables = read_text(file, GOOD)
    assert tables.mask == "mask.png"
    assert tables.geometry.mesh == "vase.ply"
    assert (tables.camera.kind, tables.camera.position, tables.camera.fov_y) == ("perspective", (0, 0, 5), 0.35)
    assert (tables.encoding.transfer, tables.encoding.black) == (2.2, "dark.png")
    assert (tables.noise.read, tables.noise.gain) == (0.002, 0.0005)
    (image,) = tables.image
    assert (image.file, image.exposure, image.ambient) == ("00.png", 2.0, 0.1)
    assert image.lights[0].irradiance == [3.1, 3.0, 2.0]
    assert image.lights[1].position == (1.0, 2.0, 3.0)


@pytest.mark.parametrize(("transfer", "read"), [('"linear"', "linear"), ('"srgb"', "srgb"), ("2", 2.0)])
def test_transfer_is_a_name_or_a_number(file, transfer, read):
    assert read_text(file, GOOD.replace("transfer = 2.2", f"transfer = {transfer}")).encoding.transfer == read


def test_what_is_absent_keeps_its_default(file):
    tables = read_text(file, '[geometry]\nshape = "sphere"\n[[image]]\nfile = "a.png"\n')
    assert tables.mask is None
    assert tables.camera is None
    assert tables.noise is None
    assert (tables.encoding.transfer, tables.encoding.black, tables.encoding.saturation) == (None, 0.0, None)
    assert (tables.image[0].exposure, tables.image[0].lights, tables.image[0].ambient) == (None, [], 0.0)


@pytest.mark.parametrize(
    ("right", "typo", "place"),
    [
        ("mask =", "msak =", "the file"),
        ("[encoding]", "[encodin]", "the file"),
        ("[[image]]", "[[images]]", "the file"),
        ("mesh =", "mehs =", "geometry"),
        ("fov_y =", "fovy =", "camera"),
        ("position = [0, 0, 5]", "positon = [0, 0, 5]", "camera"),
        ("transfer =", "tranfser =", "encoding"),
        ("gain =", "gian =", "noise"),
        ("exposure =", "exposre =", "image"),
        ("irradiance =", "iradiance =", "lights"),
        ("direction =", "directoin =", "lights"),
    ],
)
def test_an_unknown_key_names_the_nearest_known_one(file, right, typo, place):
    message = refusal(lambda: read_text(file, GOOD.replace(right, typo)))
    key = right.strip("[]").split()[0].split("=")[0].strip("[] ")
    wrong = typo.strip("[]").split()[0].split("=")[0].strip("[] ")
    assert str(file) in message
    assert f"'{wrong}'" in message
    assert f"'{key}'" in message
    assert place in message


def test_an_unknown_key_like_no_other_lists_the_known_ones(file):
    message = refusal(lambda: read_text(file, GOOD.replace("gain =", "zzz =")))
    assert "'zzz'" in message
    for key in ("read", "gain"):
        assert key in message


@pytest.mark.parametrize(
    ("right", "wrong", "place", "expected"),
    [
        ('mask = "mask.png"', "mask = 3", "mask", "str"),
        ("fov_y = 0.35", 'fov_y = "wide"', "camera.fov_y", "float"),
        ("position = [0, 0, 5]", "position = [0, 5]", "camera.position", "length 3"),
        ('kind = "perspective"', 'kind = "fisheye"', "camera.kind", "perspective"),
        ("transfer = 2.2", 'transfer = "sRGB"', "encoding.transfer", "srgb"),
        ("read = 0.002", "read = [1, 2]", "noise.read", "float"),
        ("exposure = 2", 'exposure = "1/60"', "exposure", "float"),
        ("intensity = 4", 'intensity = "bright"', "intensity", "float"),
        ("direction = [0.3, 0.2, 1]", 'direction = ["up", 0, 1]', "direction", "float"),
    ],
)
def test_a_value_of_the_wrong_kind_says_where_and_what_is_expected(file, right, wrong, place, expected):
    message = refusal(lambda: read_text(file, GOOD.replace(right, wrong)))
    assert str(file) in message
    assert place in message
    assert expected in message


def test_double_brackets_around_a_table_that_stands_once_are_told(file):
    message = refusal(lambda: read_text(file, GOOD.replace("[noise]", "[[noise]]")))
    assert message == f"{file}: noise: expected one table; write [noise] with single brackets, once."
    message = refusal(lambda: read_text(file, GOOD.replace("[[image]]", "[image]")))
    assert message == f"{file}: image: expected a list, got a table; correct the value."


@pytest.mark.parametrize(("missing", "key"), [('[geometry]\nmesh = "vase.ply"\n', "geometry"), ("[[image]]", "image")])
def test_a_missing_table_is_named(file, missing, key):
    text = GOOD.replace(missing, "") if key == "geometry" else GOOD[: GOOD.index(missing)]
    message = refusal(lambda: read_text(file, text))
    assert str(file) in message
    assert f"'{key}' is missing" in message


def test_a_scene_needs_a_material(file):
    file.write_text(GOOD, "utf-8")
    assert "'material' is missing" in refusal(lambda: schema.read(file, schema.SceneFile))
    file.write_text(GOOD + '[material]\nmodel = "lambert"\nalbedo = 0.3\n', "utf-8")
    assert schema.read(file, schema.SceneFile).material == {"model": "lambert", "albedo": 0.3}


@pytest.mark.parametrize(
    "content", [b"mask = mask.png\n", b"[geometry\n", b"mask = 'a'\nmask = 'b'\n", b"\xff\xfe\x00m", b"{}"]
)
def test_a_file_that_is_no_toml_is_refused(file, content):
    file.write_bytes(content)
    message = refusal(lambda: schema.read(file, schema.CaptureFile))
    assert str(file) in message
    assert "TOML" in message


def test_a_missing_file_is_refused(file):
    message = refusal(lambda: schema.read(file, schema.CaptureFile))
    assert str(file) in message
    assert "no such file" in message


def test_a_scene_is_told_from_a_capture(tmp_path: Path) -> None:
    file = tmp_path / "scene.toml"
    file.write_text('[geometry]\nshape = "sphere"\n[material]\nmodel = "lambert"\n[[image]]\nfile = "a.png"\n')
    assert "matest render" in refusal(lambda: schema.read(file, schema.CaptureFile))
    assert schema.read(file, schema.SceneFile).material == {"model": "lambert"}


def test_a_file_of_values_nested_without_end_is_refused(file):
    message = refusal(lambda: read_text(file, "mask = " + "[" * 5000 + "]" * 5000))
    assert message.startswith(f"{file}: ")


@pytest.mark.parametrize(
    "text", ["a." * 20_000 + "b = 1", "[" + "a." * 20_000 + "b]", "x = {" + "a." * 20_000 + "b=1}"]
)
def test_a_key_of_tables_without_end_is_refused_at_once(file, text):
    file.write_text(text)
    assert "nested too deeply" in refusal(lambda: schema.read(file, schema.CaptureFile))


def test_the_mark_with_which_windows_begins_files_is_read_over(file):
    text = '[geometry]\nshape = "sphere"\n[[image]]\nfile = "a.png"\n'
    assert read_text(file, f"\ufeff{text}") == read_text(file, text)
