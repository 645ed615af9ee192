from __future__ import annotations

import io
import struct
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
import PIL.Image
import pytest

from matest.photographs.images import full_scale, read_image, read_image_file
from tests.captures import refusal


def codes(maximum: int, *channels: int) -> np.ndarray:
    dtype = np.uint8 if maximum < 256 else np.uint16
    return np.random.default_rng(18).integers(0, maximum, (13, 18, *channels), dtype=dtype, endpoint=True)


def of_pillow(image: np.ndarray, **options: Any) -> bytes:
    file = io.BytesIO()
    PIL.Image.fromarray(image).save(file, "JPEG2000", **options)
    return file.getvalue()


def put(path: Path, data: bytes) -> Path:
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("image", [codes(255), codes(255, 3), codes(65535)], ids=["grey", "RGB", "grey of 16 bits"])
@pytest.mark.parametrize("suffix", [".jp2", ".j2k"])
def test_files_of_pillow_are_exact(tmp_path: Path, suffix: str, image: np.ndarray) -> None:
    path = put(tmp_path / f"a{suffix}", of_pillow(image, no_jp2=suffix == ".j2k"))
    read = read_image(path)
    assert read.dtype == image.dtype
    np.testing.assert_array_equal(read, image.reshape(13, 18, -1))


@pytest.mark.parametrize("bits", [1, 8, 10, 12, 14, 16])
def test_codes_are_fractions_of_the_full_scale_of_their_bits(tmp_path: Path, bits: int) -> None:
    image = codes(2**bits - 1)
    data = imagecodecs.jpeg2k_encode(image, level=0, reversible=True, bitspersample=bits)
    read = read_image(put(tmp_path / "a.jp2", data))
    np.testing.assert_allclose(read[..., 0] / full_scale(read.dtype), image / (2**bits - 1), rtol=1e-7)


def test_alpha_is_set_apart(tmp_path: Path) -> None:
    image = codes(255, 4)
    file = read_image_file(put(tmp_path / "a.jp2", of_pillow(image)))
    np.testing.assert_array_equal(file.pixels, image[..., :3])
    np.testing.assert_array_equal(file.coverage, image[..., 3])


def test_the_wavelet_that_loses_digits_is_refused(tmp_path: Path) -> None:
    path = put(tmp_path / "a.jp2", of_pillow(codes(255, 3), irreversible=True))
    assert "5/3" in refusal(lambda: read_image(path))


def with_box(data: bytes, name: bytes, content: bytes) -> bytes:
    """The file with a box more, or another one of this name, in its header."""
    place = data.index(b"jp2h") - 4
    length = struct.unpack(">I", data[place : place + 4])[0]
    header = data[place + 8 : place + length]
    if name in header:
        start = header.index(name) - 4
        header = header[:start] + header[start + struct.unpack(">I", header[start : start + 4])[0] :]
    header += struct.pack(">I", 8 + len(content)) + name + content
    return data[:place] + struct.pack(">I", 8 + len(header)) + b"jp2h" + header + data[place + length :]


BOXES = {
    "sYCC": (b"colr", struct.pack(">BBBI", 1, 0, 0, 18), "grey or RGB"),
    "inks": (b"colr", struct.pack(">BBBI", 1, 0, 0, 12), "grey or RGB"),
    "associated alpha": (b"cdef", struct.pack(">13H", 4, 0, 0, 1, 1, 0, 2, 2, 0, 3, 3, 2, 0), "alpha was multiplied"),
}


@pytest.mark.parametrize("case", BOXES)
def test_other_colours_are_refused(tmp_path: Path, case: str) -> None:
    name, content, words = BOXES[case]
    path = put(tmp_path / "a.jp2", with_box(of_pillow(codes(255, 4)), name, content))
    assert words in refusal(lambda: read_image(path))


def test_numbers_with_a_sign_are_refused(tmp_path: Path) -> None:
    data = imagecodecs.jpeg2k_encode(codes(255).astype(np.int16) - 100, level=0, reversible=True)
    assert "without sign" in refusal(lambda: read_image(put(tmp_path / "a.jp2", data)))


@pytest.mark.parametrize("share", [0.0, 0.05, 0.2, 0.6, 0.99])
@pytest.mark.parametrize("suffix", [".jp2", ".j2k"])
def test_a_truncated_file_is_refused(tmp_path: Path, suffix: str, share: float) -> None:
    data = of_pillow(codes(255, 3), no_jp2=suffix == ".j2k")
    path = put(tmp_path / f"a{suffix}", data[: int(share * len(data))])
    assert str(path) in refusal(lambda: read_image(path))


def test_what_is_no_picture_is_refused(tmp_path: Path) -> None:
    path = put(tmp_path / "a.jp2", b"no picture")
    assert "no codestream" in refusal(lambda: read_image(path))
