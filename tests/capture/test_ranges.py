"""Every number of a capture or scene file lies in the range of its key."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from matest.capture import schema
from matest.capture.description import describe
from matest.capture.ranges import FINITE, GAMMA, SEED, SIDE, SOLID_ANGLE, range_faults, shown
from tests.captures import CaptureFolder, encode_as_png, refusal

# What no number of a file may be.
NO_NUMBERS = ("nan", "inf", "-inf", "1e30", "-1e30")
# A table for each struct of the schema, with a place for a number at every key that takes one.
NUMBERS = [
    (table, field.name)
    for table, kind in (
        ("geometry", schema.GeometryTable),
        ("camera", schema.CameraTable),
        ("encoding", schema.EncodingTable),
        ("noise", schema.NoiseTable),
    )
    for field in msgspec.structs.fields(kind)
    if "float" in str(field.type)
]


def write(folder: CaptureFolder, table: str, key: str, value: str) -> Path:
    """The capture file with a key whose value is written as it stands."""
    folder.tables.get(table, {}).pop(key, None)
    folder.tables.setdefault(table, {})
    folder.save()
    text = folder.file.read_text("utf-8")
    folder.file.write_text(text.replace(f"[{table}]\n", f"[{table}]\n{key} = {value}\n"), "utf-8")
    return folder.file


@pytest.mark.parametrize("value", NO_NUMBERS)
@pytest.mark.parametrize(("table", "key"), NUMBERS)
def test_what_is_no_number_is_refused_at_every_key(folder: CaptureFolder, table: str, key: str, value: str) -> None:
    kind = {"geometry": schema.GeometryTable, "camera": schema.CameraTable}.get(table)
    annotation = "" if kind is None else str(next(f.type for f in msgspec.structs.fields(kind) if f.name == key))
    written = value
    if "tuple" in annotation and "matrix" not in key:
        count = annotation.count("float")
        written = f"[{', '.join([value] + ['1.0'] * (count - 1))}]"
    elif key == "matrix":
        written = f"[[{value}, 0.0, 1.0], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]]"
    elif "list" in annotation:
        written = f"[{value}]"
    file = write(folder, table, key, written)
    message = refusal(lambda: describe(file, schema.CaptureFile))
    assert message.startswith(f"{file}: {table}.{key} ")
    assert f"got {float(value)}" in message or f"got [{float(value)}" in message or f"got [[{float(value)}" in message


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"exposure": float("nan")}, "image 1: exposure must be positive and below 1e+15; got nan."),
        ({"ambient": [0.0, float("inf"), 0.0]}, "image 1: ambient must be one number or one per channel, not negative"),
        ({"lights": [{"direction": [0.0, 0.0, float("nan")]}]}, "image 1, light 0: direction must be finite"),
        ({"lights": [{"direction": [0.0, 0.0, 1.0], "irradiance": -1.0}]}, "image 1, light 0: irradiance must be"),
        ({"lights": [{"direction": [0.0, 0.0, 1.0], "solid_angle": 0.0}]}, "image 1, light 0: solid_angle must lie"),
    ],
)
def test_the_image_and_the_light_of_a_number_are_named(folder: CaptureFolder, change: dict, words: str) -> None:
    folder.tables["image"][1] |= change
    message = refusal(lambda: describe(folder.save(), schema.CaptureFile))
    assert message.startswith(f"{folder.file}: {words}")


@pytest.mark.parametrize("number", ["9" * 5000, "-" + "9" * 5000])
def test_a_whole_number_of_thousands_of_digits_is_refused_by_its_key(folder: CaptureFolder, number: str) -> None:
    file = write(folder, "encoding", "scale", number)
    message = refusal(lambda: describe(file, schema.CaptureFile))
    assert message == f"{file}: scale is a whole number of thousands of digits; correct it."


def test_a_long_hexadecimal_number_is_refused(folder: CaptureFolder) -> None:
    message = refusal(lambda: describe(write(folder, "noise", "seed", "0x" + "f" * 5000), schema.CaptureFile))
    assert "noise.seed" in message
    assert len(message) < 300


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("noise.read", 4.0, "noise.read is a fraction of full scale, at most 0.1; got 4. If that is a code of 255"),
        ("noise.gain", 30.0, "noise.gain is a fraction of full scale, at most 0.1; got 30."),
        ("encoding.black", 64.0, "encoding.black is a fraction of full scale, at most 0.5; got 64. If that is a code"),
        ("encoding.black", -0.6, "encoding.black is a fraction of full scale, at most 0.5; got -0.6."),
    ],
)
def test_codes_in_place_of_fractions_are_told(folder: CaptureFolder, key: str, value: float, words: str) -> None:
    encode_as_png(folder, np.uint8)
    table, name = key.split(".")
    folder.tables["encoding"] = {"transfer": "linear"}
    folder.tables.setdefault(table, {})[name] = value
    assert words in refusal(folder.load)


@pytest.mark.parametrize("gamma", [0.0, -2.2, 0.01, 100.0, float("nan"), float("inf")])
def test_a_gamma_that_no_camera_has_is_refused_from_file_and_option(folder: CaptureFolder, gamma: float) -> None:
    assert "encoding.transfer as a number is a gamma" in refusal(lambda: folder.load(transfer=gamma))
    folder.tables["encoding"] = {"transfer": gamma}
    assert "encoding.transfer as a number is a gamma" in refusal(folder.load)


def test_ends_belong_to_a_range_as_it_says() -> None:
    assert (0.0 in SOLID_ANGLE, 4 * np.pi in SOLID_ANGLE) == (False, True)
    assert (0.1 in GAMMA, 10.0 in GAMMA, 0.0999 in GAMMA) == (True, True, False)
    assert (0 in SEED, -1 in SEED, 2**63 - 1 in SEED, 2**63 in SEED) == (True, False, True, False)
    assert float("nan") not in FINITE
    assert 16385 not in SIDE


def test_true_and_words_are_no_numbers() -> None:
    tables: Any = schema.EncodingTable(black="dark.png", saturation=None)
    assert not any(wrong for wrong, _ in range_faults(tables))


def test_long_numbers_are_not_printed() -> None:
    assert shown([1, 10**25]) == "[1, a whole number of more than 20 digits]"
    assert shown(0.5) == "0.5"
