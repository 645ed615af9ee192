from __future__ import annotations

import struct

import numpy as np
import PIL.Image
import pytest

from matest.photographs.images import read_image
from tests.captures import refusal


def codes(*channels: int) -> np.ndarray:
    return np.random.default_rng(13).integers(0, 255, (13, 18, *channels), dtype=np.uint8)


@pytest.mark.parametrize("channels", [(), (3,)], ids=["grey", "RGB"])
def test_codes_are_exact(tmp_path, channels):
    PIL.Image.fromarray(codes(*channels)).save(tmp_path / "a.bmp")
    read = read_image(tmp_path / "a.bmp")
    expected = codes(*channels).reshape(13, 18, -1)
    np.testing.assert_array_equal(read, np.broadcast_to(expected, read.shape))


def test_a_mask_of_one_bit_is_black_and_white(tmp_path):
    image = codes() > 127
    PIL.Image.fromarray(image).save(tmp_path / "a.bmp")
    np.testing.assert_array_equal(read_image(tmp_path / "a.bmp").max(axis=2), np.where(image, 255, 0))


@pytest.mark.parametrize("share", [0.0, 0.02, 0.6, 0.99])
def test_a_truncated_file_is_refused(tmp_path, share):
    PIL.Image.fromarray(codes(3)).save(tmp_path / "a.bmp")
    data = (tmp_path / "a.bmp").read_bytes()
    (tmp_path / "a.bmp").write_bytes(data[: int(share * len(data))])
    assert str(tmp_path / "a.bmp") in refusal(lambda: read_image(tmp_path / "a.bmp"))


def test_five_bits_a_channel_are_refused(tmp_path):
    header = b"BM" + struct.pack("<IHHI", 62, 0, 0, 54) + struct.pack("<IiiHHIIiiII", 40, 2, 2, 1, 16, 0, 8, 0, 0, 0, 0)
    (tmp_path / "a.bmp").write_bytes(header + bytes(8))
    assert "24 bits a pixel" in refusal(lambda: read_image(tmp_path / "a.bmp"))
