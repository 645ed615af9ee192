from __future__ import annotations

import struct
import zlib

import numpy as np
import PIL.Image
import pytest

from matest.photographs.images import read_image, read_image_file
from tests.captures import refusal

HEIGHT, WIDTH = 30, 41


def png(rows: bytes, *, stream: slice = slice(None), ending: bool = True) -> bytes:
    """A 16-bit grey PNG written byte by byte; `stream` is the part of the compressed rows that it holds."""
    blocks = [
        (b"IHDR", struct.pack(">IIBBBBB", WIDTH, HEIGHT, 16, 0, 0, 0, 0)),
        (b"IDAT", zlib.compress(rows)[stream]),
        *([(b"IEND", b"")] if ending else []),
    ]
    packed = [
        struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data)) for name, data in blocks
    ]
    return b"\x89PNG\r\n\x1a\n" + b"".join(packed)


def codes() -> np.ndarray:
    return np.random.default_rng(2).integers(0, 65535, (HEIGHT, WIDTH), dtype=np.uint16)


def rows() -> bytes:
    return b"".join(b"\0" + row.astype(">u2").tobytes() for row in codes())


def test_a_file_written_byte_by_byte_is_exact(tmp_path):
    (tmp_path / "a.png").write_bytes(png(rows()))
    np.testing.assert_array_equal(read_image(tmp_path / "a.png")[..., 0], codes())


DAMAGES = {
    "half of the stream": lambda: png(rows(), stream=slice(0, 1200)),
    "no check sum": lambda: png(rows(), stream=slice(0, -4)),
    "too few rows": lambda: png(rows()[: -(2 * WIDTH + 1)]),
    "no end": lambda: png(rows(), ending=False),
    "an unknown filter": lambda: png(b"\x09" + rows()[1:]),
    "a flipped bit": lambda: png(rows()).replace(zlib.compress(rows())[500:520], bytes(20)),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_file_is_refused(tmp_path, damage):
    (tmp_path / "a.png").write_bytes(DAMAGES[damage]())
    message = refusal(lambda: read_image(tmp_path / "a.png"))
    assert str(tmp_path / "a.png") in message
    assert "copy it again" in message


def test_alpha_is_set_apart(tmp_path):
    for channels, mode in ((2, "LA"), (4, "RGBA")):
        image = np.random.default_rng(2).integers(0, 255, (HEIGHT, WIDTH, channels), dtype=np.uint8)
        PIL.Image.fromarray(image, mode).save(tmp_path / "a.png")
        file = read_image_file(tmp_path / "a.png")
        np.testing.assert_array_equal(file.pixels, image[..., :-1])
        np.testing.assert_array_equal(file.coverage, image[..., -1])


def test_a_palette_is_expanded(tmp_path):
    image = np.random.default_rng(2).integers(0, 255, (4, 5, 3), dtype=np.uint8)
    PIL.Image.fromarray(image).quantize(16).save(tmp_path / "a.png")
    expected = np.asarray(PIL.Image.open(tmp_path / "a.png").convert("RGB"))
    np.testing.assert_array_equal(read_image(tmp_path / "a.png"), expected)


def test_what_follows_the_end_does_not_count(tmp_path):
    (tmp_path / "a.png").write_bytes(png(rows()) + bytes(10_000))
    np.testing.assert_array_equal(read_image(tmp_path / "a.png")[..., 0], codes())
