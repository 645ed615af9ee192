from __future__ import annotations

import io

import cv2
import numpy as np
import PIL.Image
import pytest
import skimage.io

from matest.photographs.images import read_image
from tests.captures import refusal


def photograph() -> np.ndarray:
    noise = np.random.default_rng(4).uniform(0, 255, (120, 161, 3))
    return (5 * (cv2.GaussianBlur(noise, (0, 0), 3) - 100)).clip(0, 255).astype(np.uint8)


def encoded(image: np.ndarray, mode: str = "RGB", **options: object) -> bytes:
    buffer = io.BytesIO()
    PIL.Image.fromarray(image).convert(mode).save(buffer, "JPEG", **options)
    return buffer.getvalue()


@pytest.mark.parametrize("progressive", [False, True])
@pytest.mark.parametrize("subsampling", ["4:4:4", "4:2:2", "4:2:0"])
@pytest.mark.parametrize("mode", ["RGB", "L"])
def test_codes_are_those_of_two_other_readers(tmp_path, mode, subsampling, progressive):
    path = tmp_path / "a.jpg"
    path.write_bytes(encoded(photograph(), mode, subsampling=subsampling, progressive=progressive))
    read = read_image(path).squeeze()
    np.testing.assert_array_equal(read, skimage.io.imread(path))
    decoded = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(read, decoded[..., ::-1] if mode == "RGB" else decoded)


def test_what_follows_the_image_does_not_count(tmp_path):
    path = tmp_path / "a.jpg"
    path.write_bytes(encoded(photograph()) + b"a film of the same moment" * 1000)
    np.testing.assert_array_equal(read_image(path), skimage.io.imread(path))


def damages(data: bytes) -> dict[str, bytes]:
    middle = len(data) // 2
    return {
        "cut": data[:middle],
        "cut and closed": data[:middle] + b"\xff\xd9",
        "without end": data[:-2],
        "with a gap": data[:middle] + data[middle + 300 :],
        "with zeros": data[:middle] + bytes(300) + data[middle + 300 :],
        "with a marker": data[:middle] + b"\xff\xc4" + data[middle + 2 :],
    }


@pytest.mark.parametrize("progressive", [False, True])
@pytest.mark.parametrize("damage", damages(b""))
def test_a_damaged_file_is_refused_with_what_the_decoder_says(tmp_path, damage, progressive):
    path = tmp_path / "a.jpg"
    path.write_bytes(damages(encoded(photograph(), quality=92, progressive=progressive))[damage])
    message = refusal(lambda: read_image(path))
    assert str(path) in message
    assert "copy it again" in message


def test_inks_are_refused(tmp_path):
    (tmp_path / "a.jpg").write_bytes(encoded(photograph(), "CMYK"))
    message = refusal(lambda: read_image(tmp_path / "a.jpg"))
    assert "CMYK" in message
    assert "Convert it to RGB" in message
