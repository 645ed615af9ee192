"""Photographs taken, or only planned: what a prediction of error bars needs to know of them."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from matest.brdf import Brdf, Lambert
from matest.capture import Capture, load_capture, schema
from matest.capture.assembly import Folder, build_encoding, build_scene, build_surface
from matest.capture.capture import capture_file
from matest.errors import InputError
from matest.photographs.noise import Noise
from matest.photographs.photographs import Photographs
from matest.progress import Progress, silent
from matest.scene import Scene
from matest.shading import render_image
from matest.simulate import bits_of, channels_of, material_of, shape_of, stored_pixels

# A camera of 10,000 electrons full well and 10 electrons read noise.
TYPICAL = Noise(read=1e-3, gain=1e-4)
# The brightest pixel of a planned photograph whose exposure nobody gave, as a share of full scale.
_EXPOSED = 0.9
# Photographs that do not exist yet, by suffix; all others hold 16 bits.
_KINDS = {".exr": np.float32, ".hdr": np.float32, ".npy": np.float32, ".jpg": np.uint8, ".jpeg": np.uint8}


@dataclass(frozen=True)
class Plan:
    """Photographs as far as geometry, lights and camera go.

    Attributes:
        name: of the folder.
        photographs: where none exist the pixels are zero.
        material: of a scene; None for a capture.
        exposed: whether the radiance of full scale is known; if not, the brightest predicted pixel lies at 90 % of it.
        noise_source: where the noise comes from, as a clause.
    """

    name: str
    photographs: Photographs
    material: Brdf | None = None
    exposed: bool = True
    noise_source: str = "as the capture states it"

    @classmethod
    def of(cls, capture: Capture) -> Plan:
        """The plan that photographs already follow."""
        plan = cls(capture.name, capture.photographs)
        return plan if plan.photographs.noise_stated else replace(plan, noise_source="estimated from the images")

    def with_noise(self, read: float, gain: float) -> Plan:
        """The same photographs with noise of variance read² + gain·signal, fractions of full scale.

        Raises:
            InputError: negative or not finite, or no noise at all.
        """
        if not (math.isfinite(read) and math.isfinite(gain) and read >= 0 and gain >= 0 and read + gain > 0):
            raise InputError(
                f"noise takes read noise and gain, finite, not negative and not both zero; got {read:g} and {gain:g}. "
                "A typical camera has 0.001 and 0.0001."
            )
        given = self.photographs
        noise = Noise(read, gain).with_rounding(given.encoding, given.stored[0].dtype)
        return replace(self, photographs=replace(given, noise=noise, noise_stated=True), noise_source="as given")


def load_plan(
    path: str | Path,
    *,
    transfer: str | float | None = None,
    progress: Progress = silent,
) -> Plan:
    """Read what is to be checked: a capture with or without its photographs, or a scene.

    Args:
        path: a folder with a `capture.toml` or else a `scene.toml`, or one of these files.
        transfer: overrides `encoding.transfer`.
        progress: called with a word, the number of images decoded and their total.

    Raises:
        InputError: anything about the files that cannot be used; only some of the photographs exist.
    """
    path = Path(path)
    scene = (path / "scene.toml").is_file() and not (path / "capture.toml").is_file()
    file = capture_file(path, "scene.toml" if scene else "capture.toml")
    if scene or _has_material(file):
        described = schema.read(file, schema.SceneFile)
        return _planned(described, file, transfer, material_of(described.material, str(file)))
    tables = schema.read(file, schema.CaptureFile)
    if any(table.file and (file.parent / table.file).is_file() for table in tables.image):
        return Plan.of(load_capture(file, transfer=transfer, progress=progress))
    return _planned(tables, file, transfer, None)


def photographed(photographs: Photographs, material: Brdf) -> Photographs:
    """Photographs of `material` as the same camera would take them without noise."""
    encoding, dtype = photographs.encoding, photographs.stored[0].dtype
    bits = 8 * dtype.itemsize if dtype.kind == "u" else None
    stored = []
    for image in range(len(photographs)):
        signal = _radiance(photographs.scene, image, material) * (photographs.exposures[image] / encoding.scale)
        if encoding.flat is not None:
            signal = signal * encoding.flat
        stored.append(stored_pixels(signal + encoding.black, encoding, bits))
    return replace(photographs, stored=tuple(stored))


def exposed(photographs: Photographs, material: Brdf) -> Photographs:
    """The same with full scale chosen so that the brightest pixel of `material` lies at 90 % of it."""
    scene, encoding = photographs.scene, photographs.encoding
    peak = max(float(_radiance(scene, k, material).max()) * e for k, e in enumerate(photographs.exposures))
    scale = peak / (_EXPOSED - float(np.max(encoding.black)))
    return replace(photographs, encoding=replace(encoding, scale=scale)) if scale > 0 else photographs


def _radiance(scene: Scene, image: int, material: Brdf) -> np.ndarray:
    """Radiance [N, C] of the object's pixels."""
    rendered = render_image(scene, image, material).detach().numpy()
    return rendered.reshape(-1, rendered.shape[-1])[scene.surface.pixels]


def _planned(tables: schema.CaptureFile, file: Path, transfer: str | float | None, material: Brdf | None) -> Plan:
    """A plan of photographs that do not exist."""
    label, folder = str(file), Folder(file, file.parent.absolute())
    if not tables.image:
        raise InputError(f"{file}: expected at least one [[image]] with lights; got none.")
    for k, table in enumerate(tables.image):
        if not (math.isfinite(table.exposure) and table.exposure > 0):
            raise InputError(f"{file}: image {k}: exposure must be positive; got {table.exposure}.")
    channels = channels_of(tables, material or Lambert(), label)
    surface = build_surface(tables, folder, shape_of(tables, folder, label), label)
    scene, powers_known = build_scene(tables, folder, surface, channels)
    dtype = _dtype(tables, label, material is not None)
    chosen = tables.encoding
    encoding = build_encoding(
        chosen, folder, surface, np.zeros((1, 1, channels), dtype), transfer or chosen.transfer or "linear"
    )
    stated = tables.noise is not None and (tables.noise.read > 0 or tables.noise.gain > 0)
    noise = Noise(tables.noise.read, tables.noise.gain) if tables.noise is not None and stated else TYPICAL
    names = [image.file or f"image {number}" for number, image in enumerate(tables.image)]
    photographs = Photographs(
        scene=scene,
        stored=(np.zeros((len(surface), channels), dtype),) * len(tables.image),
        encoding=encoding,
        exposures=tuple(image.exposure for image in tables.image),
        noise=noise,
        noise_stated=True,
        relative=chosen.radiometry == "relative" or not powers_known,
        names=tuple(names),
    )
    known = chosen.scale is not None or np.dtype(dtype).kind == "f"
    plan = Plan(file.parent.absolute().name, photographs, material, known).with_noise(noise.read, noise.gain)
    source = "as the file states it" if stated else "that of a typical camera, as none is stated"
    return replace(plan, noise_source=source)


def _has_material(file: Path) -> bool:
    """Whether a file is a scene; one that is no TOML is left to the reader of captures to refuse."""
    try:
        return "material" in tomllib.loads(file.read_text("utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError):
        return False


def _dtype(tables: schema.CaptureFile, label: str, scene: bool) -> type:
    """The kind of number that the photographs will hold."""
    if scene:
        bits = bits_of(tables, label)
        return {8: np.uint8, 16: np.uint16}.get(bits or 0, np.float32)
    return _KINDS.get(Path(tables.image[0].file or "").suffix.lower(), np.uint16)
