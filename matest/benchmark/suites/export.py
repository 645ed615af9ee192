"""What conversions to other programs cost, and what Mitsuba renders of them beside our shader, pixel by pixel."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Group

from matest.benchmark.instruments.patch import patch
from matest.benchmark.instruments.rendition import Difference, difference, load
from matest.benchmark.suite import Effort, Progress, Record, Suite
from matest.benchmark.tables import by_case, figure, page, ruled
from matest.brdf import Brdf, CookTorrance, preset
from matest.errors import InputError
from matest.export import TARGETS, mitsuba
from matest.export.conversion import Conversion
from matest.export.textured import Textured
from matest.scene import Camera
from matest.scene.surface import from_sphere

_PLASTIC: dict[str, Any] = {"diffuse": [0.4, 0.3, 0.2], "specular": [0.9, 0.8, 0.7], "slope": 0.15}
_GOLD: dict[str, Any] = {"fresnel": "conductor", "eta": [0.2, 0.4, 1.4], "k": [3.1, 2.3, 1.8]}
_BARE: dict[str, Any] = {"diffuse": 0.0, "specular": 1.0, "slope": 0.15}
GLOSS = CookTorrance(**_PLASTIC)
SMITH_GLOSS = CookTorrance(**_PLASTIC, masking="smith")
METAL = CookTorrance(**_BARE, masking="smith", **_GOLD)
FOAM = preset("foam")
PAPER = preset("laser-paper")
# What is converted, by name; `mapped` is `SMITH_GLOSS` with maps of albedo and slope.
MATERIALS: dict[str, Brdf] = {"gloss": GLOSS, "foam": FOAM, "metal": METAL, "paper": PAPER}
MAPPED = "mapped"
# Columns of conversions: the targets, and Mitsuba's own lobes where a plugin would be written.
_FITTED = "mitsuba --fitted"
WAYS = ("mitsuba", _FITTED, "materialx", "gltf", "merl")
# Targets that maps go with; the others get the means.
_TEXTURED = ("mitsuba", "gltf")
# Pixels along a side of the images.
SIZE = 48
# Angle of the lights from the line of sight.
_LIGHTS = (15.0, 40.0, 65.0)
# A pixel that Mitsuba renders of a material that it evaluates itself may be so far from ours.
PIXEL_LIMIT = 0.01
# A slope in the words of every program, and how far the number in the file may be from it. MaterialX gives facets
# correlated heights: the lobe is fitted, and a little off.
SLOPE = 0.15
_SLOPE_LIMITS = {"mitsuba": 1e-6, "materialx": 0.02, "gltf": 1e-6}
_MISSING = 'not rendered: Mitsuba 3 is missing; pip install "matest-brdf[peers]"'


def measure(effort: Effort, progress: Progress) -> Iterator[Record]:
    """Errors of every conversion of every material, of what Mitsuba renders of it, and of the number of one slope."""
    del effort
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for number, (case, material) in enumerate(MATERIALS.items()):
            progress(case, number, len(MATERIALS) + 2)
            yield from _conversions(case, material, folder, partial(_on_sphere, material))
        progress(MAPPED, len(MATERIALS), len(MATERIALS) + 2)
        yield from _mapped(folder)
        progress("slope", len(MATERIALS) + 1, len(MATERIALS) + 2)
        yield from slopes(folder)


def _conversions(
    case: str,
    material: Brdf,
    folder: Path,
    rendition: Callable[[Conversion], Difference],
    textured: Textured | None = None,
) -> Iterator[Record]:
    """Records of one material in every target."""
    for way in WAYS:
        if textured is not None and way == _FITTED:
            continue
        target = TARGETS[way.partition(" ")[0]]
        options: dict[str, Any] = {"fitted": True} if way == _FITTED else {}
        if way in _TEXTURED and textured is not None:
            options["textured"] = textured
        try:
            conversion = target.write(material, folder / f"{case}{len(options)}{target.SUFFIX}", **options)
        except InputError as error:
            # A library that is not installed.
            yield Record("export", case, f"{way}: error", None, "1", note=str(error))
            continue
        yield Record("export", case, f"{way}: error", conversion.error.relative_rmse, "1")
        yield Record("export", case, f"{way}: median", conversion.error.median, "1")
        if target is mitsuba:
            yield from _rendered(case, way, conversion, rendition)


def _rendered(
    case: str, way: str, conversion: Conversion, rendition: Callable[[Conversion], Difference]
) -> Iterator[Record]:
    """How far Mitsuba's images are from ours: a pixel at most, where it evaluates the material itself."""
    try:
        found = rendition(conversion)
    except ImportError:
        yield Record("export", case, f"{way}: rendered rms", None, "1", note=_MISSING)
        return
    yield Record("export", case, f"{way}: rendered rms", found.rms, "1")
    limit = PIXEL_LIMIT if way == "mitsuba" else None
    yield Record("export", case, f"{way}: rendered pixel", found.largest, "1", limit=limit)


def _on_sphere(material: Brdf, conversion: Conversion) -> Difference:
    """Images of a sphere from Mitsuba and from us."""
    surface = from_sphere((SIZE, SIZE), (SIZE / 2, SIZE / 2), SIZE / 2, None)
    ball = {"type": "sphere", "bsdf": load(conversion.files)}
    return difference(ball, material, surface, Camera((0.0, 0.0, 3.0), height=2.0), _lights())


def _mapped(folder: Path) -> Iterator[Record]:
    made = patch(SMITH_GLOSS, SIZE)

    def on_mesh(conversion: Conversion) -> Difference:
        return difference(load(conversion.files), made.material, made.surface, made.camera, _lights())

    yield from _conversions(MAPPED, made.textured.material, folder, on_mesh, made.textured)


def slopes(folder: Path) -> Iterator[Record]:
    """How far a slope of GGX is from the number that stands for it in each file, by that program's convention."""
    ggx: dict[str, Any] = {"slope": SLOPE, "distribution": "ggx", "masking": "smith"}
    coated, metal = CookTorrance(**_PLASTIC | ggx), CookTorrance(**_BARE | ggx | {"fresnel": "schlick", "f0": 0.8})
    # The number of each, as a slope; glTF's lobe of a dielectric has another F.
    for target, material, name, power in (
        ("mitsuba", coated, "alpha", 1), ("materialx", coated, "surface_roughness", 1),
        ("gltf", metal, "roughnessFactor", 2),
    ):  # fmt: skip
        writer = TARGETS[target]
        try:
            value = writer.write(material, folder / f"slope{writer.SUFFIX}").parameters[name] ** power
        except InputError as error:
            yield Record("export", f"slope {SLOPE}", f"{target}: slope", None, "1", note=str(error))
            continue
        deviation = abs(value / SLOPE - 1)
        yield Record("export", f"slope {SLOPE}", f"{target}: slope", deviation, "1", limit=_SLOPE_LIMITS[target])


def _lights() -> list[np.ndarray]:
    """Unit vectors to the lights, at different azimuths."""
    angles = [(math.radians(tilt), 2.0 * number) for number, tilt in enumerate(_LIGHTS)]
    return [np.array([math.sin(t) * math.cos(a), math.sin(t) * math.sin(a), math.cos(t)]) for t, a in angles]


def table(records: list[Record]) -> Group:
    """One row a material and target."""
    shown = ruled("", "error", "median", "rendered\nrms", "rendered\npixel", "slope")
    for case, metrics in by_case(records).items():
        shown.add_row(case, style="bold")
        for way in WAYS:
            row = [metrics.get(f"{way}: {name}") for name in ("error", "median", "rendered rms", "rendered pixel")]
            row.append(metrics.get(f"{way}: slope"))
            if any(row):
                shown.add_row(f"  {way}", *map(figure, row))
    about = (
        "Error: rms difference of f cos θi over its rms, over pairs of directions; median: relative difference that "
        f"half of the reflected light is below. Rendered: {len(_LIGHTS)} images of a sphere (mapped: of a mesh) of "
        f"{SIZE}×{SIZE} pixels by Mitsuba, beside ours: rms, and the largest relative difference of a pixel. mapped: "
        "albedo and slope vary; MaterialX and MERL get their means, and the error is from these. Slope: of the number "
        f"in the file from {SLOPE}, in that program's convention."
    )
    return page(about, shown, records=records)


SUITE = Suite(measure, table)
