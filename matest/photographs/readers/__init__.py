"""Readers of image files, one file a family of formats: the values that are stored, exactly, or a refusal."""

from __future__ import annotations

from matest.photographs.readers.bmp import read_bmp
from matest.photographs.readers.exr import read_exr
from matest.photographs.readers.jpeg import read_jpeg
from matest.photographs.readers.jpeg2000 import read_jpeg2000
from matest.photographs.readers.mat import read_mat
from matest.photographs.readers.npy import read_npy
from matest.photographs.readers.png import read_png
from matest.photographs.readers.pnm import read_pnm
from matest.photographs.readers.radiance import read_hdr
from matest.photographs.readers.raster import Raster, Reader
from matest.photographs.readers.raw import SUFFIXES, read_raw
from matest.photographs.readers.tga import read_tga
from matest.photographs.readers.tiff import read_tiff
from matest.photographs.readers.webp import read_webp

# By suffix, in lower case.
READERS: dict[str, Reader] = {
    ".png": read_png,
    ".tif": read_tiff,
    ".tiff": read_tiff,
    ".jpg": read_jpeg,
    ".jpeg": read_jpeg,
    ".exr": read_exr,
    ".hdr": read_hdr,
    ".npy": read_npy,
    ".mat": read_mat,
    ".pgm": read_pnm,
    ".ppm": read_pnm,
    ".bmp": read_bmp,
    ".tga": read_tga,
    ".webp": read_webp,
    ".jp2": read_jpeg2000,
    ".j2k": read_jpeg2000,
    **dict.fromkeys(SUFFIXES, read_raw),
}

__all__ = ["READERS", "Raster", "Reader"]
