"""The page of formats: every row is a file written by another hand, read to the digit, and its spoilt twin refused."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import imagecodecs
import numpy as np
import pytest
import scipy.io
import tifffile
from PIL import Image

from matest.capture.formats.colmap import read_colmap
from matest.capture.formats.transforms import read_transforms
from matest.photographs.images import read_image
from matest.photographs.readers import READERS
from matest.tables import FORMATS, Declaration, load_table
from matest.tables.merl import CELLS
from tests.capture.formats.camera_files import (
    HEIGHT,
    POSE,
    WIDTH,
    blender,
    nerfstudio,
    write_binary,
    write_json,
    write_text,
)
from tests.captures import refusal
from tests.photographs.image_files import write_exr, write_hdr
from tests.photographs.raw_files import write_dng
from tests.tables.dome import Dome

PAGE = (Path(__file__).parents[1] / "docs" / "formats.md").read_text("utf-8")
RNG = np.random.default_rng(7)
BYTES = RNG.integers(0, 256, (10, 8, 3), dtype=np.uint8)
WORDS = RNG.integers(0, 65536, (10, 8, 3), dtype=np.uint16)
FLOATS = RNG.random((10, 6, 3), dtype=np.float32)
COUNTS = RNG.integers(0, 4096, (40, 32), dtype=np.uint16)
# One view of two planes of light, for the tables.
ROWS = "theta_i,phi_i,theta_r,phi_r,value\n" + "".join(f"0.5,0,{0.1 * k:.1f},3.14,{0.2 + 0.01 * k}\n" for k in range(9))


@dataclass(frozen=True)
class Format:
    """A row of the page.

    Attributes:
        write: the golden file into a folder; its path, and what it holds.
        read: what matest makes of it.
        spoil: makes the malformed twin of it.
    """

    write: Callable[[Path], tuple[Path, Any]]
    read: Callable[[Path], Any]
    spoil: Callable[[Path], None]


def cut(path: Path) -> None:
    """Leave the first part of a file, as an interrupted copy does."""
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 6 // 10])


def changed(old: str, new: str, name: str = "") -> Callable[[Path], None]:
    def change(path: Path) -> None:
        file = path / name if name else path
        text = file.read_text("utf-8")
        assert old in text
        file.write_text(text.replace(old, new, 1), "utf-8")

    return change


def image(suffix: str, save: Callable[[Path], Any]) -> Format:
    def write(folder: Path) -> tuple[Path, Any]:
        path = folder / f"photo{suffix}"
        return path, save(path)

    return Format(write, read_image, cut)


def by_opencv(values: np.ndarray) -> Callable[[Path], np.ndarray]:
    def save(path: Path) -> np.ndarray:
        assert cv2.imwrite(str(path), values[..., ::-1])
        return values

    return save


def saved(values: np.ndarray, save: Callable[[Path], object]) -> Callable[[Path], np.ndarray]:
    def write(path: Path) -> np.ndarray:
        save(path)
        return values

    return write


def jpeg(path: Path) -> np.ndarray:
    cv2.imwrite(str(path), BYTES[..., ::-1])
    return np.asarray(Image.open(path))


def hdr(path: Path) -> np.ndarray:
    return write_hdr(path, BYTES[:, :6], RNG.integers(120, 136, (10, 6), dtype=np.uint8))


def pnm(path: Path) -> np.ndarray:
    codes = WORDS % 1024
    path.write_bytes(b"P6\n8 10\n1023\n" + codes.astype(">u2").tobytes())
    return (codes / 1023).astype(np.float32)


def raw(path: Path) -> np.ndarray:
    write_dng(path, COUNTS)
    green = (COUNTS[::2, 1::2].astype(float) + COUNTS[1::2, ::2]) / 2
    return np.stack([COUNTS[::2, ::2], green, COUNTS[1::2, 1::2]], axis=-1).astype(np.float32) / np.float32(4095)


def camera(save: Callable[[Path], Path], spoil: Callable[[Path], None]) -> Format:
    def read(path: Path) -> np.ndarray:
        file = read_transforms(path) if path.suffix == ".json" else read_colmap(path)
        view = file.view(0, (WIDTH, HEIGHT))
        return np.concatenate([view.axes, view.position[None]])

    pose = np.concatenate([POSE.turns.as_matrix().T, POSE.position[None]])
    return Format(lambda folder: (save(folder), pose), read, spoil)


def in_json(content: dict[str, Any]) -> Callable[[Path], Path]:
    def save(folder: Path) -> Path:
        write_json(folder / "transforms.json", content)
        return folder / "transforms.json"

    return save


def table(name: str, text: str, spoil: Callable[[Path], None]) -> Format:
    """A table of measurements; what is looked at is the ratio of its first values."""

    def write(folder: Path) -> tuple[Path, Any]:
        (folder / name).write_text(text, "utf-8")
        return folder / name, None

    def read(path: Path) -> None:
        values = load_table(path, Declaration("rad", "retro", "f") if text is ROWS else None).values
        assert bool((values > 0).all())

    return Format(write, read, spoil)


def merl(folder: Path) -> tuple[Path, Any]:
    path = folder / "table.binary"
    with path.open("wb") as file:
        np.array([90, 90, 180], "<i4").tofile(file)
        np.full(3 * CELLS, 300.0).tofile(file)
    return path, None


def read_merl(path: Path) -> None:
    # The red of the format is scaled by 1/1500.
    assert float(load_table(path).values[0, 0]) == pytest.approx(0.2)


CORNELL = "2\n450 550\n" + "".join(f"0.5 0.0 {0.1 * k:.1f} 3.14159265 0.2 0.3\n" for k in range(9))
WORLD = np.array([[0.0, 1, 0, 0], [1, 0, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]])
IMAGES = {
    "PNG": image(".png", by_opencv(WORDS)),
    "TIFF": image(".tif", saved(WORDS, lambda path: tifffile.imwrite(path, WORDS, photometric="rgb"))),
    "JPEG": image(".jpg", jpeg),
    "OpenEXR": image(
        ".exr", saved(FLOATS, lambda path: write_exr(path, {name: FLOATS[..., k] for k, name in enumerate("RGB")}))
    ),
    "Radiance": image(".hdr", hdr),
    "NumPy": image(".npy", saved(FLOATS, lambda path: np.save(path, FLOATS))),
    "MATLAB": image(".mat", saved(FLOATS, lambda path: scipy.io.savemat(path, {"normals": FLOATS}))),
    "PGM, PPM": image(".ppm", pnm),
    "BMP": image(".bmp", by_opencv(BYTES)),
    "TGA": image(".tga", saved(BYTES, lambda path: Image.fromarray(BYTES).save(path))),
    "WebP": image(".webp", saved(BYTES, lambda path: Image.fromarray(BYTES).save(path, lossless=True))),
    "JPEG 2000": image(
        ".jp2", saved(WORDS, lambda path: path.write_bytes(imagecodecs.jpeg2k_encode(WORDS, level=0, reversible=True)))
    ),
    "camera RAW": image(".dng", raw),
}
CAMERAS = {
    "transforms.json of Blender": camera(in_json(blender({"r_0": POSE})), changed('"file_path"', '"path"')),
    "transforms.json of nerfstudio": camera(
        in_json(nerfstudio({"r_0": POSE}, WORLD)), changed('"camera_model": "OPENCV"', '"camera_model": "FISHEYE"')
    ),
    "COLMAP, text": camera(
        lambda folder: write_text(folder, {"r_0.png": POSE}), changed("PINHOLE", "FOV", "cameras.txt")
    ),
    "COLMAP, binary": camera(
        lambda folder: write_binary(folder, {"r_0.png": POSE}), lambda path: cut(path / "images.bin")
    ),
}
TABLES = {
    "MERL": Format(merl, read_merl, cut),
    "Cornell": table("table.brdf", CORNELL, changed(" 0.3\n", "\n")),
    "CSV of angles": table("table.csv", ROWS, changed("theta_r", "angle")),
    "CSV of measurements": table("dome.csv", Dome(lights=2, pixels=6).text(), changed("# transfer: linear\n", "")),
}
FORMATS_OF_PAGE = IMAGES | CAMERAS | TABLES


def row(name: str) -> list[str]:
    """The cells of the row of a format, without its name."""
    for line in PAGE.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if cells[0] == name:
            return cells[1:]
    raise AssertionError(f"docs/formats.md has no row {name}")


@pytest.mark.parametrize("name", FORMATS_OF_PAGE)
def test_a_golden_file_is_read_and_its_spoilt_twin_refused_as_the_page_says(name: str, tmp_path: Path) -> None:
    kind = FORMATS_OF_PAGE[name]
    path, content = kind.write(tmp_path)
    found = kind.read(path)
    if content is not None:
        np.testing.assert_allclose(found, content, rtol=0, atol=1e-6 if name in CAMERAS or name == "camera RAW" else 0)
    kind.spoil(path)
    label, _, sentence = refusal(lambda: kind.read(path)).partition(": ")
    assert str(tmp_path) in label
    written, twin, refused, source = row(name)
    assert all((written, twin, source))
    # Numbers, and what a decoder says in its own words, differ: the page has … for them.
    pattern = ".*".join(map(re.escape, refused.split("…")))
    assert re.fullmatch(pattern, sentence), sentence


def test_the_page_has_a_row_for_everything_that_is_read() -> None:
    read = " ".join(row(name)[0] for name in IMAGES)
    assert not [suffix for suffix in READERS if f"`{suffix}`" not in read]
    tables = " ".join(row(name)[0] for name in TABLES)
    assert not [suffix for suffix in FORMATS if f"`{suffix}`" not in tables]
    # And none for what is not.
    known = {*re.findall(r"`(\.\w+)`", read)}
    assert known == {*READERS}
    assert len(IMAGES) == len({*READERS.values()})
