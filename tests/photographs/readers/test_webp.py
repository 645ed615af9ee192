from __future__ import annotations

import numpy as np
import PIL.Image
import pytest

from matest.photographs.images import read_image, read_image_file
from tests.captures import refusal


def codes(channels: int) -> np.ndarray:
    return np.random.default_rng(10).integers(0, 255, (13, 18, channels), dtype=np.uint8)


def test_lossless_files_are_exact(tmp_path):
    PIL.Image.fromarray(codes(3)).save(tmp_path / "a.webp", lossless=True)
    np.testing.assert_array_equal(read_image(tmp_path / "a.webp"), codes(3))


def test_alpha_is_set_apart(tmp_path):
    PIL.Image.fromarray(codes(4)).save(tmp_path / "a.webp", lossless=True, exact=True)
    file = read_image_file(tmp_path / "a.webp")
    np.testing.assert_array_equal(file.pixels, codes(4)[..., :3])
    np.testing.assert_array_equal(file.coverage, codes(4)[..., 3])


@pytest.mark.parametrize("channels", [3, 4])
def test_lossy_files_are_refused(tmp_path, channels):
    PIL.Image.fromarray(codes(channels)).save(tmp_path / "a.webp", quality=90)
    assert "without loss" in refusal(lambda: read_image(tmp_path / "a.webp"))


def test_films_are_refused(tmp_path):
    first, second = PIL.Image.fromarray(codes(3)), PIL.Image.fromarray(codes(3)[::-1].copy())
    first.save(tmp_path / "a.webp", lossless=True, save_all=True, append_images=[second])
    assert "film" in refusal(lambda: read_image(tmp_path / "a.webp"))


@pytest.mark.parametrize("share", [0.0, 0.2, 0.6, 0.99])
def test_a_truncated_file_is_refused(tmp_path, share):
    PIL.Image.fromarray(codes(3)).save(tmp_path / "a.webp", lossless=True)
    data = (tmp_path / "a.webp").read_bytes()
    (tmp_path / "a.webp").write_bytes(data[: int(share * len(data))])
    assert str(tmp_path / "a.webp") in refusal(lambda: read_image(tmp_path / "a.webp"))
