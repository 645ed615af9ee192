"""Every file of a collection in many encodings gives its exact content, or is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from matest.photographs.images import full_scale, read_image

PIXELS = Path(__file__).resolve().parents[4] / "shared" / "data" / "pixels"
# JPEG is not exact.
JPEG_CODES = 3


def contents() -> dict[str, np.ndarray]:
    if not PIXELS.is_dir():
        return {}
    with np.load(PIXELS / "pixels.npz") as file:
        return dict(file)


CONTENTS = contents()


@pytest.mark.skipif(not CONTENTS, reason="the collection of image files is not here")
@pytest.mark.parametrize("name", CONTENTS or ["no file"])
def test_files_have_their_exact_content(name: str) -> None:
    expected, read = CONTENTS[name], read_image(PIXELS / name)
    expected = expected if expected.ndim == 3 else expected[..., None]
    assert read.shape == expected.shape
    if name.endswith(".jpg"):
        assert np.abs(read.astype(int) - expected.astype(int)).max() <= JPEG_CODES
    elif read.dtype.kind == "u":
        # 32-bit codes that are stretched 16-bit ones leave the reader as these: the same fractions of full scale.
        codes, full = expected.astype(np.uint64), int(full_scale(read.dtype))
        np.testing.assert_array_equal(read.astype(np.uint64) * int(full_scale(expected.dtype)), codes * full)
    else:
        # The product of colour and alpha is rounded in the file already.
        np.testing.assert_array_max_ulp(read, expected.astype(np.float32), 1 if "premultiplied" in name else 0)
