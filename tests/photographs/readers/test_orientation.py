from __future__ import annotations

import numpy as np
import PIL.Image
import PIL.ImageOps
import pytest
import tifffile

from matest.photographs.images import read_image_file
from matest.photographs.readers.orientation import TAG, exif_orientation, upright
from matest.photographs.readers.raster import Raster


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".webp", ".tif"])
@pytest.mark.parametrize("channels", [(), (3,)], ids=["grey", "RGB"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_pixels_are_the_way_up_that_pillow_turns_them(tmp_path, orientation, channels, suffix):
    if suffix == ".webp" and not channels:
        pytest.skip("WebP has no grey")
    path = tmp_path / f"a{suffix}"
    image = np.random.default_rng(1).integers(0, 255, (9, 14, *channels), dtype=np.uint8)
    if suffix == ".tif":
        photometric = "rgb" if channels else "minisblack"
        tags = [(TAG, "H", 1, orientation, True)]
        # Compressed: Pillow turns grey files that it maps into memory wrongly.
        options = {"photometric": photometric, "compression": "zlib", "metadata": None}
        tifffile.imwrite(path, image, extratags=tags, **options)
    else:
        exif = PIL.Image.Exif()
        exif[TAG] = orientation
        PIL.Image.fromarray(image).save(path, exif=exif, **({"lossless": True} if suffix == ".webp" else {}))
    turned = np.asarray(PIL.ImageOps.exif_transpose(PIL.Image.open(path)))
    file = read_image_file(path)
    np.testing.assert_array_equal(file.pixels.squeeze(), turned)
    assert bool(file.notes) == (orientation != 1)
    assert all(f"({orientation})" in note for note in file.notes)


@pytest.mark.parametrize("exif", [b"", b"no EXIF", b"Exif\0\0II*\0", b"Exif\0\0MM\0*\0\0\0\x08\0\x05"])
def test_what_says_no_orientation_is_upright(exif):
    assert exif_orientation(exif) == 1


@pytest.mark.parametrize("orientation", [0, 1, 9, -3])
def test_unknown_orientations_are_upright(orientation):
    raster = Raster(np.zeros((2, 3), np.uint8))
    assert upright(raster, orientation) is raster
