from __future__ import annotations

import struct

import numpy as np
import PIL.Image
import pytest

from matest.photographs.images import read_image, read_image_file
from tests.captures import refusal

HEIGHT, WIDTH = 6, 9


def codes(*channels: int) -> np.ndarray:
    return np.random.default_rng(9).integers(0, 255, (HEIGHT, WIDTH, *channels), dtype=np.uint8)


def written(image: np.ndarray, *, bottom_up: bool = False, runs: bool = False) -> bytes:
    """A TGA file byte by byte; with `runs`, every pixel is a run of one."""
    channels = 1 if image.ndim == 2 else image.shape[2]
    kind = (3 if channels == 1 else 2) + (8 if runs else 0)
    flags = (0 if bottom_up else 0x20) + (8 if channels == 4 else 0)
    header = struct.pack("<BBBHHBHHHHBB", 0, 0, kind, 0, 0, 0, 0, 0, WIDTH, HEIGHT, 8 * channels, flags)
    order = {1: [0], 3: [2, 1, 0], 4: [2, 1, 0, 3]}[channels]
    pixels = image.reshape(HEIGHT, WIDTH, channels)[:: -1 if bottom_up else 1, :, order].reshape(-1, channels)
    return header + b"".join((b"\x80" if runs else b"") + pixel.tobytes() for pixel in pixels)


@pytest.mark.parametrize("bottom_up", [False, True])
@pytest.mark.parametrize("runs", [False, True])
@pytest.mark.parametrize("channels", [(), (3,), (4,)], ids=["grey", "RGB", "RGBA"])
def test_codes_are_exact(tmp_path, channels, runs, bottom_up):
    image = codes(*channels)
    (tmp_path / "a.tga").write_bytes(written(image, runs=runs, bottom_up=bottom_up))
    file = read_image_file(tmp_path / "a.tga")
    np.testing.assert_array_equal(file.pixels, image.reshape(HEIGHT, WIDTH, -1)[..., :3])
    assert (file.coverage is not None) == (channels == (4,))


def test_files_of_pillow_are_exact(tmp_path):
    for compression in (None, "tga_rle"):
        PIL.Image.fromarray(codes(3)).save(tmp_path / "a.tga", compression=compression)
        np.testing.assert_array_equal(read_image(tmp_path / "a.tga"), codes(3))


@pytest.mark.parametrize("runs", [False, True])
@pytest.mark.parametrize("share", [0.0, 0.05, 0.5, 0.95])
def test_a_truncated_file_is_refused(tmp_path, share, runs):
    data = written(codes(3), runs=runs)
    (tmp_path / "a.tga").write_bytes(data[: int(share * len(data))])
    assert str(tmp_path / "a.tga") in refusal(lambda: read_image(tmp_path / "a.tga"))


def test_five_bits_and_palettes_are_refused(tmp_path):
    path = tmp_path / "a.tga"
    path.write_bytes(struct.pack("<BBBHHBHHHHBB", 0, 0, 2, 0, 0, 0, 0, 0, 2, 1, 16, 0x21) + bytes(4))
    assert "8 bits a channel" in refusal(lambda: read_image(path))
    PIL.Image.fromarray(codes(3)).quantize(16).save(path)
    assert "palette" in refusal(lambda: read_image(path))
