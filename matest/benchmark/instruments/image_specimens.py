"""Small image files of every format, as cameras and programs write them."""

from __future__ import annotations

import io
import re
import struct
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

# Rows and columns of the images.
SHAPE = (6, 7)
SEED = 3


def pixels(dtype: Any, *channels: int) -> np.ndarray:
    """An image of noise: integers of any value, floats in [0, 1)."""
    rng = np.random.default_rng(SEED)
    if np.dtype(dtype).kind == "f":
        return rng.random((*SHAPE, *channels)).astype(dtype)
    return rng.integers(0, np.iinfo(dtype).max, (*SHAPE, *channels), dtype=dtype, endpoint=True)


def png() -> list[bytes]:
    import PIL.Image

    palette = PIL.Image.fromarray(pixels(np.uint8, 3)).convert("P")
    bits = PIL.Image.fromarray(pixels(np.uint8)).convert("1")
    return [
        *(_opencv(".png", pixels(*kind)) for kind in ((np.uint8, 3), (np.uint16,), (np.uint16, 3), (np.uint8, 4))),
        _pillow("PNG", pixels(np.uint8, 3), exif=_turned()), _pillow("PNG", pixels(np.uint8, 2)),
        *(_saved(image, "PNG") for image in (palette, bits)),
    ]  # fmt: skip


def jpeg() -> list[bytes]:
    return [
        _pillow("JPEG", pixels(np.uint8, 3), exif=_turned()), _pillow("JPEG", pixels(np.uint8)),
        _pillow("JPEG", pixels(np.uint8, 3), progressive=True, subsampling=0),
    ]  # fmt: skip


def tiff() -> list[bytes]:
    import tifffile

    kinds: list[tuple[np.ndarray, dict[str, Any]]] = [
        (pixels(np.uint16, 3), {"compression": "deflate", "predictor": True}),
        (pixels(np.uint8, 4), {"compression": "lzw", "extrasamples": ["unassalpha"]}),
        (pixels(np.float32, 3), {"compression": "zstd", "predictor": True}),
        (np.moveaxis(pixels(np.uint16, 3), -1, 0), {"planarconfig": "separate", "photometric": "rgb"}),
        (65537 * pixels(np.uint16).astype(np.uint32), {"bigtiff": True}),
        (np.resize(pixels(np.uint8), (32, 48)), {"tile": (16, 16), "compression": "packbits"}),
        (pixels(np.float32), {"photometric": "minisblack", "byteorder": ">"}),
        (pixels(np.uint8) > 99, {"photometric": "miniswhite"}),
    ]
    files = []
    for image, options in kinds:
        file = io.BytesIO()
        tifffile.imwrite(file, image, metadata=None, **options)
        files.append(file.getvalue())
    return files


def exr() -> list[bytes]:
    import OpenEXR

    half = pixels(np.float16, 3)
    kinds: list[tuple[dict[str, np.ndarray], dict[str, Any]]] = [
        ({"RGB": pixels(np.float32, 3)}, {"compression": OpenEXR.ZIP_COMPRESSION}),
        ({"RGBA": np.dstack([half, half[..., :1]])}, {"compression": OpenEXR.PIZ_COMPRESSION}),
        ({"Y": pixels(np.float32)}, {"compression": OpenEXR.NO_COMPRESSION}),
        ({"view.R": half[..., 0], "view.G": half[..., 1], "view.B": half[..., 2]}, {
            "compression": OpenEXR.RLE_COMPRESSION,
            "chromaticities": (0.7, 0.3, 0.2, 0.7, 0.15, 0.05, 0.31, 0.33),
            "displayWindow": (np.array([0, 0], np.int32), np.array([8, 9], np.int32)),
        }),
        ({"RGB": half}, {"compression": OpenEXR.DWAA_COMPRESSION}),
        ({"RGB": pixels(np.float32, 3)}, {"compression": OpenEXR.B44_COMPRESSION}),
    ]  # fmt: skip
    files = []
    with TemporaryDirectory() as folder:
        path = Path(folder) / "a.exr"
        for channels, header in kinds:
            OpenEXR.File({"type": OpenEXR.scanlineimage, **header}, channels).write(str(path))
            files.append(path.read_bytes())
    return files


def hdr() -> list[bytes]:
    wide = np.resize(pixels(np.float32, 3), (4, 16, 3))
    return [_opencv(".hdr", image) for image in (pixels(np.float32, 3), wide)]


def pnm() -> list[bytes]:
    words = " ".join(map(str, pixels(np.uint8).ravel())).encode()
    height, width = SHAPE
    return [
        b"P6\n# a comment\n%d %d\n255\n" % (width, height) + pixels(np.uint8, 3).tobytes(),
        b"P5 %d %d 1023\n" % (width, height) + (pixels(np.uint16) % 1024).astype(">u2").tobytes(),
        b"P2 %d %d 255\n%s\n" % (width, height, words),
    ]


def npy() -> list[bytes]:
    files = []
    swapped = pixels(np.uint16, 3).astype(">u2")
    for image in (pixels(np.float32, 3), pixels(np.uint16), np.asfortranarray(pixels(np.float64)), swapped):
        file = io.BytesIO()
        np.save(file, image)
        files.append(file.getvalue())
    return files


def mat() -> list[bytes]:
    import scipy.io

    files = []
    for options in ({"do_compression": True}, {"do_compression": False}, {"format": "4"}):
        file = io.BytesIO()
        image = pixels(np.float64) if "format" in options else pixels(np.float64, 3)
        scipy.io.savemat(file, {"Normal_gt": image, "scale": 2.0}, **options)
        # The hour is in the file.
        files.append(re.sub(rb"Created on: .{24}", 36 * b" ", file.getvalue()))
    return files


def bmp() -> list[bytes]:
    return [_pillow("BMP", pixels(np.uint8, 3)), _pillow("BMP", pixels(np.uint8)), _opencv(".bmp", pixels(np.uint8, 4))]


def tga() -> list[bytes]:
    kinds = ((np.uint8, 3), (np.uint8,), (np.uint8, 4))
    return [_pillow("TGA", pixels(*kind), compression=packed) for kind in kinds for packed in (None, "tga_rle")]


def webp() -> list[bytes]:
    return [_pillow("WEBP", pixels(np.uint8, count), lossless=True, exif=_turned()) for count in (3, 4)]


def jpeg2000() -> list[bytes]:
    import imagecodecs

    coded = bytes(imagecodecs.jpeg2k_encode(pixels(np.uint16), level=0, reversible=True, bitspersample=16))
    return [_pillow("JPEG2000", pixels(np.uint8, 3)), _pillow("JPEG2000", pixels(np.uint8, 4), no_jp2=True), coded]


def raw() -> list[bytes]:
    """A DNG of one strip: tags of the filter's colours, levels, a matrix, the camera."""
    import tifffile

    matrix = tuple(x for row in np.eye(3, dtype=int).tolist() for value in row for x in (value, 1))
    tags: list[tuple[int, str, int, Any, bool]] = [
        (33421, "H", 2, (2, 2), True), (33422, "B", 4, bytes((0, 1, 1, 2)), True),
        (50706, "B", 4, bytes((1, 4, 0, 0)), True), (50707, "B", 4, bytes((1, 1, 0, 0)), True),
        (50708, "s", 0, "Test", True), (271, "s", 0, "Test", True), (272, "s", 0, "Test", True),
        (50710, "B", 3, bytes((0, 1, 2)), True), (50711, "H", 1, 1, True), (50713, "H", 2, (1, 1), True),
        (50714, "H", 1, 64, True), (50717, "I", 1, 4095, True), (50721, "2i", 9, matrix, True),
        (50778, "H", 1, 21, True), (274, "H", 1, 1, True),
    ]  # fmt: skip
    file = io.BytesIO()
    counts = np.resize(pixels(np.uint16) % 4096, (24, 32)).astype(np.uint16)
    options: dict[str, Any] = {"photometric": 32803, "compression": None, "metadata": None, "software": None}
    tifffile.imwrite(file, counts, extratags=tags, byteorder="<", **options)
    return [file.getvalue()]


def _opencv(suffix: str, image: np.ndarray) -> bytes:
    import cv2

    return cv2.imencode(suffix, image)[1].tobytes()


def _pillow(kind: str, image: np.ndarray, **options: Any) -> bytes:
    import PIL.Image

    return _saved(PIL.Image.fromarray(image), kind, **options)


def _saved(image: Any, kind: str, **options: Any) -> bytes:
    file = io.BytesIO()
    image.save(file, kind, **options)
    return file.getvalue()


def _turned() -> bytes:
    """An EXIF block with an orientation."""
    return b"Exif\0\0MM\0*" + struct.pack(">IHHHIHHI", 8, 1, 274, 3, 1, 6, 0, 0)


IMAGES: dict[str, tuple[str, Any]] = {
    "PNG": ("a.png", png), "TIFF": ("a.tif", tiff), "JPEG": ("a.jpg", jpeg), "EXR": ("a.exr", exr),
    "HDR": ("a.hdr", hdr), "PNM": ("a.ppm", pnm), "NPY": ("a.npy", npy), "MAT": ("a.mat", mat), "BMP": ("a.bmp", bmp),
    "TGA": ("a.tga", tga), "WebP": ("a.webp", webp), "JPEG 2000": ("a.jp2", jpeg2000), "RAW": ("a.dng", raw),
}  # fmt: skip
