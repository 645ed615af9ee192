"""Files of every format that are cut off: refused in a sentence, or read as the whole file is."""

from __future__ import annotations

import io
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
import tifffile

from matest.benchmark.instruments import image_specimens
from matest.errors import InputError
from matest.photographs.images import ImageFile, read_image_file

# Where files are cut: shares of their bytes, and bytes from the end, where numbers, checksums and end markers are.
SHARES = (0.02, 0.1, 0.3, 0.5, 0.7, 0.8, 0.9, 0.99)
FROM_END = (1, 2, 4, 8, 12, 16)
NOISE = np.random.default_rng(5).integers(0, 1 << 16, (96, 80, 3), dtype=np.uint16)


def tiff(**options: Any) -> bytes:
    file = io.BytesIO()
    tifffile.imwrite(file, NOISE, photometric="rgb", metadata=None, **options)
    return file.getvalue()


def exr(folder: Path, **header: Any) -> bytes:
    OpenEXR.File(header, {"RGB": NOISE.astype(np.float32)}).write(str(folder / "whole.exr"))
    return (folder / "whole.exr").read_bytes()


def in_parts(kind: str, folder: Path) -> list[bytes]:
    """Files whose pixels lie in many strips, tiles or blocks."""
    if kind == "TIFF":
        strips = [tiff(rowsperstrip=8, compression=name) for name in (None, "deflate", "lzw")]
        return [*strips, tiff(tile=(16, 16)), tiff(tile=(16, 32), compression="zstd")]
    if kind == "EXR":
        packed = (OpenEXR.NO_COMPRESSION, OpenEXR.ZIPS_COMPRESSION, OpenEXR.ZIP_COMPRESSION, OpenEXR.PIZ_COMPRESSION)
        lines = [exr(folder, type=OpenEXR.scanlineimage, compression=name) for name in packed]
        tiles = {"type": OpenEXR.tiledimage, "tiles": OpenEXR.TileDescription()}
        return [*lines, *(exr(folder, compression=name, **tiles) for name in packed[::2])]
    return []


def read(path: Path) -> ImageFile:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return read_image_file(path)


def same(one: ImageFile, other: ImageFile) -> bool:
    alike = one.pixels.dtype == other.pixels.dtype and np.array_equal(one.pixels, other.pixels)
    return alike and np.array_equal(one.coverage, other.coverage)  # type: ignore[arg-type]


@pytest.mark.parametrize("side", [6, 70])
@pytest.mark.parametrize("kind", image_specimens.IMAGES)
def test_a_file_that_is_cut_off_has_the_pixels_of_the_whole_or_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, side: int
) -> None:
    monkeypatch.setattr(image_specimens, "SHAPE", (side, side + 1))
    name, make = image_specimens.IMAGES[kind]
    path = tmp_path / name
    for data in [*make(), *(in_parts(kind, tmp_path) if side == 70 else [])]:
        path.write_bytes(data)
        whole = read(path)
        for length in {*(int(share * len(data)) for share in SHARES), *(len(data) - count for count in FROM_END)}:
            path.write_bytes(data[:length])
            refused = ""
            try:
                part = read(path)
            except InputError as error:
                refused = str(error)
            assert refused.startswith(f"{path}: ") if refused else same(part, whole), f"after {length} of {len(data)}"


def test_a_number_of_a_text_that_may_be_half_of_one_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.pgm"
    for text, last in ((b"12\n", 12), (b"12 ", 12), (b"12#", 12), (b"120", 120), (b"26", 26), (b"0 3", 0)):
        path.write_bytes(b"P2 2 1 255\n200 " + text)
        assert read_image_file(path).pixels.ravel().tolist() == [200, last]
    path.write_bytes(b"P2 2 1 255\n200 12")
    with pytest.raises(InputError, match="line break"):
        read_image_file(path)
