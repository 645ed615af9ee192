"""Files that say they hold more than they do, or than an image has, are refused before memory is asked for."""

from __future__ import annotations

import io
import resource
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

import cv2
import imagecodecs
import numpy as np
import PIL.Image
import pytest

from matest.photographs.images import read_image
from matest.photographs.readers.raster import MOST_PIXELS, check_size
from tests.captures import refusal

SIDE = 60_000


def npy(header: str, content: bytes = b"\0" * 100) -> bytes:
    """A file of NumPy's array format with any header."""
    text = header.encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + content


def of_shape(shape: object, kind: str = "'<f4'") -> bytes:
    return npy(f"{{'descr': {kind}, 'fortran_order': False, 'shape': {shape}}}")


def png(width: int, height: int) -> bytes:
    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    head = struct.pack(">IIBBBBB", width, height, 16, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(b"\0")) + chunk(b"IEND", b"")


def encoded(suffix: str, side: int = 8) -> bytearray:
    return bytearray(cv2.imencode(suffix, np.full((side, side, 3), 90, np.uint8))[1].tobytes())


def jpeg() -> bytes:
    data = encoded(".jpg")
    place = data.index(b"\xff\xc0") + 5
    data[place : place + 4] = struct.pack(">HH", SIDE, SIDE)
    return bytes(data)


def bmp() -> bytes:
    data = encoded(".bmp")
    data[18:26] = struct.pack("<ii", SIDE, -SIDE)
    return bytes(data)


def tga() -> bytes:
    return struct.pack("<BBBHHBHHHHBB", 0, 0, 2, 0, 0, 0, 0, 0, SIDE, SIDE, 24, 0) + b"\0" * 100


FILES = {
    "bomb.npy": of_shape((100_000, 100_000, 3)),
    "overflow.npy": of_shape((2**33, 2**33, 3)),
    "long.npy": of_shape((10**30, 64, 3)),
    "digits.npy": of_shape(f"({'9' * 5000}, 1)"),
    "negative.npy": of_shape((-1, 64, 3)),
    "short.npy": of_shape((64, 64, 3)),
    "object.npy": of_shape((1,), "'|O'"),
    "nested.npy": npy("(" * 5000),
    "no Python.npy": of_shape((8, 8), "','"),
    "signs.npy": npy("{'descr': '<f4', 'fortran_order': False, 'shape': " + "-" * 9000 + "1}"),
    "version.npy": b"\x93NUMPY\x03\x00" + struct.pack("<I", 2**31) + b" " * 1000,
    "empty.npy": b"",
    "bomb.png": png(SIDE, SIDE),
    "tight.png": png(16_000, 16_000),
    "bomb.jpg": jpeg(),
    "bomb.bmp": bmp(),
    "bomb.tga": tga(),
    "bomb.hdr": f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {SIDE} +X {SIDE}\n".encode() + b"\2\2\0\0" * 9,
    "bomb.pgm": f"P5 {SIDE} {SIDE} 255\n".encode() + b"\0" * 99,
    "overflow.pgm": b"P5 4294967296 4294967296 255\n" + b"\0" * 99,
    "digits.pgm": b"P5 " + b"9" * 5000 + b" 2 255\n" + b"\0" * 99,
    "bomb.webp": b"RIFF\x1e\0\0\0WEBPVP8L" + struct.pack("<I", 10) + b"\x2f\xff\xff\xff\x0f" + b"\0" * 9,
}


@pytest.fixture
def little_memory() -> Iterator[None]:
    """A gigabyte of address space more than is used, so that a bomb fails here if it goes off."""
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (used + (1 << 30), before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_AS, before)


@pytest.mark.parametrize("name", FILES)
@pytest.mark.usefixtures("little_memory")
def test_a_file_that_lies_about_its_size_is_refused(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(FILES[name])
    message = refusal(lambda: read_image(path))
    assert message.startswith(f"{path}: ")
    assert "Unable to allocate" not in message


def test_an_archive_of_arrays_is_no_array(tmp_path: Path) -> None:
    content = io.BytesIO()
    np.savez(content, a=np.ones((4, 4), np.float32))
    path = tmp_path / "a.npy"
    path.write_bytes(content.getvalue())
    assert "archive of arrays" in refusal(lambda: read_image(path))


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("kind", ["<f4", ">f8", "<u2", "|u1", ">u2"])
def test_arrays_are_read_as_numpy_reads_them(tmp_path: Path, order: str, kind: str) -> None:
    image = np.asarray(np.arange(60).reshape(4, 5, 3), dtype=kind, order=order)  # type: ignore[call-overload]
    np.save(tmp_path / "a.npy", image)
    np.testing.assert_array_equal(read_image(tmp_path / "a.npy"), np.load(tmp_path / "a.npy"))


def test_sizes_of_photographs_and_masks_pass(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"\0" * 100_000)
    check_size(tmp_path / "a", (16_384, 16_384), 1)
    check_size(tmp_path / "a", (65_535, 1), 2, channels=3)
    assert f"{MOST_PIXELS:,}" in refusal(lambda: check_size(tmp_path / "a", (16_385, 16_384), 1))


def test_a_chunk_of_png_that_says_it_is_longer_than_the_file_is_not_waited_for(tmp_path: Path) -> None:
    data = png(4, 4)
    place = data.index(b"IDAT") - 4
    (tmp_path / "a.png").write_bytes(data[:place] + struct.pack(">I", 3 << 30) + data[place + 4 :])
    assert "truncated" in refusal(lambda: read_image(tmp_path / "a.png"))


def test_a_mask_of_one_bit_may_be_packed_more_tightly_than_a_photograph(tmp_path: Path) -> None:
    PIL.Image.new("1", (8000, 8000), 1).save(tmp_path / "a.png")
    assert (tmp_path / "a.png").stat().st_size < 25_000
    assert read_image(tmp_path / "a.png").shape == (8000, 8000, 1)


@pytest.mark.usefixtures("little_memory")
def test_more_tiles_of_jpeg_2000_than_the_file_can_have_are_refused(tmp_path: Path) -> None:
    data = bytearray(imagecodecs.jpeg2k_encode(np.ones((8, 8), np.uint8), level=0, codecformat="j2k"))
    # The image is 8000 by 8000, its tiles one by one.
    data[8:16], data[24:32] = struct.pack(">II", 8000, 8000), struct.pack(">II", 1, 1)
    (tmp_path / "a.j2k").write_bytes(data)
    assert "truncated" in refusal(lambda: read_image(tmp_path / "a.j2k"))
