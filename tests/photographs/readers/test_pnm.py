from __future__ import annotations

import cv2
import numpy as np
import PIL.Image
import pytest

from matest.photographs.images import full_scale, read_image, read_image_file
from tests.captures import refusal

HEIGHT, WIDTH = 7, 11


def codes(maximum: int, *channels: int) -> np.ndarray:
    return np.random.default_rng(8).integers(0, maximum, (HEIGHT, WIDTH, *channels), dtype=np.uint16, endpoint=True)


def written(image: np.ndarray, maximum: int, *, text: bool = False, comment: str = "") -> bytes:
    kind = {(2, True): 2, (3, True): 3, (2, False): 5, (3, False): 6}[image.ndim, text]
    header = f"P{kind}\n{comment}{WIDTH} {HEIGHT}\n{maximum}\n".encode()
    if text:
        return header + " ".join(map(str, image.ravel())).encode()
    return header + image.astype(np.uint8 if maximum < 256 else ">u2").tobytes()


@pytest.mark.parametrize("text", [False, True])
@pytest.mark.parametrize("channels", [(), (3,)], ids=["PGM", "PPM"])
@pytest.mark.parametrize("maximum", [1, 15, 100, 255, 1023, 4095, 65535])
def test_codes_are_fractions_of_the_maximum_that_the_file_states(tmp_path, maximum, channels, text):
    path = tmp_path / ("a.ppm" if channels else "a.pgm")
    image = codes(maximum, *channels)
    path.write_bytes(written(image, maximum, text=text, comment="# by a camera 9 9\n"))
    read = read_image(path)
    assert read.shape == (HEIGHT, WIDTH, 3 if channels else 1)
    np.testing.assert_allclose(read.squeeze() / full_scale(read.dtype), image / maximum, rtol=1e-7)


@pytest.mark.parametrize("maximum", [255, 65535])
def test_codes_are_those_that_opencv_reads(tmp_path, maximum):
    (tmp_path / "a.ppm").write_bytes(written(codes(maximum, 3), maximum))
    expected = cv2.imread(str(tmp_path / "a.ppm"), cv2.IMREAD_UNCHANGED)[..., ::-1]
    read = read_image(tmp_path / "a.ppm")
    assert read.dtype == expected.dtype
    np.testing.assert_array_equal(read, expected)


def test_files_of_pillow_are_exact(tmp_path):
    image = codes(255, 3).astype(np.uint8)
    PIL.Image.fromarray(image).save(tmp_path / "a.ppm")
    np.testing.assert_array_equal(read_image(tmp_path / "a.ppm"), image)
    PIL.Image.fromarray(codes(65535)).save(tmp_path / "a.pgm")
    np.testing.assert_array_equal(read_image(tmp_path / "a.pgm")[..., 0], codes(65535))


def test_an_odd_maximum_is_noted(tmp_path):
    (tmp_path / "a.pgm").write_bytes(written(codes(1023), 1023))
    assert "fractions of 1023" in read_image_file(tmp_path / "a.pgm").notes[0]
    (tmp_path / "a.pgm").write_bytes(written(codes(255), 255))
    assert not read_image_file(tmp_path / "a.pgm").notes


def test_the_first_pixels_may_look_like_white_space(tmp_path):
    image = codes(255)
    image[0, :3] = (10, 32, 35)
    (tmp_path / "a.pgm").write_bytes(written(image, 255))
    np.testing.assert_array_equal(read_image(tmp_path / "a.pgm")[..., 0], image)


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (written(codes(255), 255)[:-1], "truncated"),
        (written(codes(1023), 1023)[:-1], "truncated"),
        (written(codes(255), 255, text=True)[:-4], "truncated"),
        (b"P5\n3 x 255\n", "does not begin like"),
        (b"P5\n2 1 0\n\1\1", "maximum is 0"),
        (b"P5\n2 1 70000\n\1\1", "maximum is 70000"),
        (b"P2\n2 1 255\n1 b\n", "whole numbers"),
        (b"P2\n2 1 255\n1 -4\n", "whole numbers"),
        (b"P5\n2 1 100\n\1\xff", "above the maximum"),
    ],
)
def test_damaged_files_are_refused_with_the_reason(tmp_path, data, reason):
    (tmp_path / "a.pgm").write_bytes(data)
    message = refusal(lambda: read_image(tmp_path / "a.pgm"))
    assert str(tmp_path / "a.pgm") in message
    assert reason in message
