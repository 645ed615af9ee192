"""MATLAB's arrays, as SciPy writes them."""

from __future__ import annotations

import io
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from matest.photographs.images import read_image
from matest.photographs.readers.mat import read_mat
from tests.captures import refusal


def test_the_array_of_a_file_is_read_as_it_is(tmp_path: Path, rng: np.random.Generator) -> None:
    file, image = tmp_path / "normals.mat", rng.normal(size=(5, 4, 3))
    scipy.io.savemat(file, {"Normal_gt": image, "scale": 2.0, "name": "cat"})
    np.testing.assert_array_equal(read_mat(file).pixels, image)
    np.testing.assert_array_equal(read_image(file), image.astype(np.float32))


@pytest.mark.parametrize("content", [{}, {"a": np.ones((3, 3)), "b": np.ones((3, 3, 3))}, {"a": 1.0}])
def test_a_file_without_one_image_is_refused(tmp_path: Path, content: dict[str, object]) -> None:
    file = tmp_path / "normals.mat"
    scipy.io.savemat(file, content)
    message = refusal(lambda: read_mat(file))
    assert "expected one array" in message
    assert ("a, b" in message) == (len(content) == 2)


def test_a_file_of_version_7_3_says_how_to_save_it(tmp_path: Path) -> None:
    file = tmp_path / "normals.mat"
    file.write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512, b"\0"))
    assert "'-v7'" in refusal(lambda: read_mat(file))


@pytest.mark.parametrize("size", [0, 40, 200, 400])
def test_a_damaged_file_is_refused(tmp_path: Path, size: int) -> None:
    file = tmp_path / "normals.mat"
    scipy.io.savemat(file, {"Normal_gt": np.ones((5, 4, 3))})
    file.write_bytes(file.read_bytes()[:size])
    assert str(file) in refusal(lambda: read_mat(file))


@pytest.mark.parametrize("packed", [True, False])
def test_numbers_of_a_type_that_there_is_not_are_refused(tmp_path: Path, packed: bool) -> None:
    content = io.BytesIO()
    scipy.io.savemat(content, {"other": 1.0, "normals": np.full((5, 4, 3), 0.25)})
    # The type of the numbers stands before their length, 8 bytes each; SciPy crashes on type 0.
    whole = content.getvalue()
    tag = struct.pack("<II", 9, 5 * 4 * 3 * 8)
    assert whole.count(tag) == 1
    whole = whole.replace(tag, struct.pack("<II", 0, 5 * 4 * 3 * 8))
    if packed:
        arrays, place = b"", 128
        while place < len(whole):
            end = place + 8 + struct.unpack_from("<I", whole, place + 4)[0]
            array = zlib.compress(whole[place:end])
            arrays += struct.pack("<II", 15, len(array)) + array
            place = end
        whole = whole[:128] + arrays
    (tmp_path / "a.mat").write_bytes(whole)
    assert "the type 0, which there is not" in refusal(lambda: read_mat(tmp_path / "a.mat"))


def uncompressed() -> bytes:
    content = io.BytesIO()
    scipy.io.savemat(content, {"normals": np.full((5, 4, 3), 0.25)})
    return content.getvalue()


@pytest.mark.parametrize("length", [5 * 4 * 3 * 8 - 8, 5 * 4 * 3 * 8 + 8, 0xFFFFFF00])
def test_an_array_of_more_or_fewer_numbers_than_it_has_is_refused(tmp_path: Path, length: int) -> None:
    # SciPy asks for as much memory as the file says.
    tag = struct.pack("<II", 9, 5 * 4 * 3 * 8)
    (tmp_path / "a.mat").write_bytes(uncompressed().replace(tag, struct.pack("<II", 9, length)))
    assert f"normals has 60 numbers in {length} bytes" in refusal(lambda: read_mat(tmp_path / "a.mat"))


def test_an_array_without_a_name_is_refused(tmp_path: Path) -> None:
    # SciPy takes it for something else, and crashes.
    named, unnamed = struct.pack("<II", 1, 7) + b"normals\0", struct.pack("<II", 1, 0)
    whole = uncompressed()
    assert whole.count(named) == 1
    whole = whole.replace(named, unnamed).replace(
        struct.pack("<I", len(whole) - 136), struct.pack("<I", len(whole) - 144)
    )
    (tmp_path / "a.mat").write_bytes(whole)
    assert "no name" in refusal(lambda: read_mat(tmp_path / "a.mat"))


def test_names_that_are_no_words_are_listed_in_one_line(tmp_path: Path) -> None:
    content = io.BytesIO()
    scipy.io.savemat(content, {"first": np.ones((3, 3)), "second": np.ones((3, 3))})
    (tmp_path / "a.mat").write_bytes(content.getvalue().replace(b"first", b"a\n\x1b\x00b"))
    message = refusal(lambda: read_mat(tmp_path / "a.mat"))
    assert message.isprintable()
    assert "second" in message


def test_a_name_that_says_it_is_immense_is_refused(tmp_path: Path) -> None:
    named = struct.pack("<II", 1, 7) + b"normals\0"
    (tmp_path / "a.mat").write_bytes(uncompressed().replace(named, struct.pack("<II", 1, 0xFFFFFF7F) + b"normals\0"))
    assert "a name of 4294967167 characters" in refusal(lambda: read_mat(tmp_path / "a.mat"))
