"""Folders as laboratories lay them out, written without matest: a sphere or a relief under known lights.

`GOLDEN` writes a good folder of each layout, `MALFORMED` turns it into one that is refused, with the sentence after its
path; both stand in `docs/layouts.md`.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io

from tests.captures import ALBEDO, SHAPE, inside_sphere, lambert_sphere, put_image, sphere_normals

LIGHTS = ((0.3, 0.2, 0.9), (-0.5, 0.1, 0.8), (0.1, -0.4, 0.9), (0.2, 0.5, 0.8), (-0.3, -0.3, 0.9))
INTENSITIES = ((1.2, 1.0, 0.8), (0.9, 1.0, 1.1), (1.0, 1.0, 1.0), (1.3, 1.2, 1.1), (0.8, 0.9, 0.7))
# Of the dome: lights at this distance from the middle of an image that is so wide, mm.
RADIUS, WIDTH = 300.0, 200.0


def unit(vector: Sequence[float]) -> np.ndarray:
    return np.array(vector) / np.linalg.norm(vector)


def diligent(folder: Path) -> None:
    """A sphere in the layout of DiLiGenT."""
    names = [f"{k:03d}.png" for k in range(1, len(LIGHTS) + 1)]
    (folder / "filenames.txt").write_text("\n".join(names) + "\n", "ascii")
    np.savetxt(folder / "light_directions.txt", [unit(light) for light in LIGHTS], fmt="%.8f")
    np.savetxt(folder / "light_intensities.txt", INTENSITIES, fmt="%.4f")
    scipy.io.savemat(folder / "Normal_gt.mat", {"Normal_gt": sphere_normals()})
    put_image(folder / "mask.png", (255 * inside_sphere()).astype(np.uint8))
    for name, light, intensity in zip(names, LIGHTS, INTENSITIES, strict=True):
        put_image(folder / name, codes(light, intensity, np.uint16))


def light_list(folder: Path, y: float = 1.0, shape: str = "mask") -> None:
    """A sphere in the layout of RTI; `y` is −1 for lists whose y points down."""
    lines = [f"photo_{k}.png {a:.6f} {y * b:.6f} {c:.6f}" for k, (a, b, c) in enumerate(map(unit, LIGHTS))]
    (folder / "sphere.lp").write_text("\n".join([str(len(LIGHTS)), *lines]) + "\n", "ascii")
    for k, light in enumerate(LIGHTS):
        put_image(folder / f"photo_{k}.png", codes(light, (1.0, 1.0, 1.0), np.uint8))
    put_image(folder / "mask.png", (255 * inside_sphere()).astype(np.uint8))
    if shape == "normals":
        np.save(folder / "normals.npy", sphere_normals().astype(np.float32))


def dome(folder: Path, **changes: Any) -> None:
    """A relief under lights on a dome, as Relight describes it."""
    np.save(folder / "normals.npy", relief().astype(np.float32))
    for k, position in enumerate(dome_positions()):
        np.save(folder / f"{k:02d}.npy", near_lambert(position).astype(np.float32))
    content = {
        "imageWidth": WIDTH,
        "domeDiameter": 2 * RADIUS,
        "verticalOffset": 0.0,
        "lightConfiguration": "spherical",
        "directions": [dict(zip("xyz", map(float, unit(light)), strict=True)) for light in LIGHTS],
        "ledAdjust": [],
    }
    (folder / "dome.dome").write_text(json.dumps(content | changes), "ascii")


def dome_positions() -> list[np.ndarray]:
    return [RADIUS * unit(light) for light in LIGHTS]


def codes(light: Sequence[float], intensity: Sequence[float], dtype: type[np.unsignedinteger]) -> np.ndarray:
    """A photograph of the sphere, linear, full scale = radiance 1."""
    radiance = lambert_sphere([{"direction": list(light), "irradiance": list(intensity)}])
    return np.round(np.iinfo(dtype).max * radiance).astype(dtype)


def relief() -> np.ndarray:
    """Normals of a wavy surface."""
    rows, columns = np.indices(SHAPE)
    x, y = 0.3 * np.sin(columns / 5), 0.3 * np.cos(rows / 4)
    return np.stack([x, y, np.sqrt(1 - x * x - y * y)], axis=-1)


def near_lambert(position: np.ndarray) -> np.ndarray:
    """Radiance of the relief, which lies in the plane z = 0, under a near light of intensity π R²."""
    rows, columns = np.indices(SHAPE)
    pixel = WIDTH / SHAPE[1]
    x, y = (columns + 0.5 - SHAPE[1] / 2) * pixel, (SHAPE[0] / 2 - rows - 0.5) * pixel
    offset = position - np.stack([x, y, np.zeros(SHAPE)], axis=-1)
    distance = np.linalg.norm(offset, axis=-1)
    cosine = np.clip((offset * relief()).sum(-1) / distance, 0, None)
    return (cosine * RADIUS**2 / distance**2)[..., None] * np.array(ALBEDO)


def rewrite(file: Path, change: Callable[[str], str]) -> None:
    """Change the text of a file."""
    file.write_text(change(file.read_text("ascii")), "ascii")


GOLDEN: dict[str, Callable[[Path], None]] = {"DiLiGenT": diligent, "RTI light list": light_list, "RTI dome": dome}

# Of each layout what spoils its golden folder, and the sentence that follows the path of the file or the folder.
MALFORMED: dict[str, tuple[Callable[[Path], None], str]] = {
    "DiLiGenT": (
        lambda folder: rewrite(folder / "light_intensities.txt", lambda text: text.partition("\n")[2]),
        "expected 5 lines, one a light of light_directions.txt; got 4.",
    ),
    "RTI light list": (
        lambda folder: rewrite(folder / "sphere.lp", lambda text: text.replace("5", "6", 1)),
        "line 1 says 6 lights, and 5 follow; complete the list or correct the number.",
    ),
    "RTI dome": (
        lambda folder: dome(folder, domeDiameter=60.0, positionsSphere=[[*map(float, p)] for p in dome_positions()]),
        "light 0 (from 0) lies 300 from the centre of a dome whose radius is 30; give both in one unit, or say "
        "lights3d.",
    ),
}
