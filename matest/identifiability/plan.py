"""Photographs, taken or planned, as a prediction of error bars needs them: geometry, lights, camera and noise."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from matest.brdf import Brdf
from matest.capture import Capture, load_capture, schema
from matest.capture.assembly import ImageFormat, realise
from matest.capture.description import Description, capture_file, capture_sources, describe, image_channels, image_shape
from matest.capture.understanding import understood
from matest.errors import InputError
from matest.photographs.noise import Noise
from matest.photographs.photographs import Photographs
from matest.photographs.readers import raw
from matest.photographs.sensor import Sensor
from matest.progress import Progress, silent
from matest.samples.uncertainty import Uncertainty
from matest.scene import Scene
from matest.scene_file import material_in, scene_format
from matest.shading import Material, render_image
from matest.simulate import stored_pixels

# A camera of 10,000 electrons full well and 10 electrons read noise.
TYPICAL = Noise(read=1e-3, gain=1e-4)
# The brightest pixel of a planned photograph whose exposure nobody gave, share of full scale: bright, not clipped.
_BRIGHTEST = 0.9
# Pixel types of photographs that do not exist yet, by suffix; all others hold 16 bits.
_PIXEL_TYPES: dict[str, type[np.generic]] = {
    **dict.fromkeys((".exr", ".hdr", ".npy", *raw.SUFFIXES), np.float32),
    **dict.fromkeys((".jpg", ".jpeg", ".bmp", ".tga", ".webp"), np.uint8),
}


@dataclass(frozen=True)
class Plan:
    """Photographs of which only geometry, lights, camera and noise count.

    Attributes:
        name: of the folder.
        photographs: their pixels are zero where no files exist.
        material: of a scene; None for a capture.
        exposed: whether the radiance of full scale is known; if not, the brightest predicted pixel lies at 90 % of it.
        noise_source: where the noise comes from, as a clause.
        uncertainty: of the calibration, as far as the plan states it.
        taken: whether the photographs exist.
        understood: how the files were read, a clause for each convention.
    """

    name: str
    photographs: Photographs
    material: Brdf | None = None
    exposed: bool = True
    noise_source: str = "as the capture states it"
    uncertainty: Uncertainty = field(default_factory=Uncertainty)
    taken: bool = False
    understood: dict[str, str] = field(default_factory=dict)

    @classmethod
    def of(cls, capture: Capture) -> Plan:
        """The plan of a capture whose photographs exist."""
        plan = cls(
            capture.name,
            capture.photographs,
            uncertainty=capture.stated_uncertainty,
            taken=True,
            understood=capture.understood,
        )
        return plan if plan.photographs.noise_stated else replace(plan, noise_source="estimated from the images")

    def with_noise(self, read: float, gain: float, source: str = "as given") -> Plan:
        """The same photographs with noise of variance read² + gain·signal, fractions of full scale.

        Raises:
            InputError: negative or not finite, or no noise at all.
        """
        if not (math.isfinite(read) and math.isfinite(gain) and read >= 0 and gain >= 0 and read + gain > 0):
            raise InputError(
                f"noise takes read noise and gain, finite, not negative and not both zero; got {read:g} and {gain:g}. "
                "A typical camera has 0.001 and 0.0001."
            )
        noise = Noise(read, gain).with_rounding(self.photographs.encoding, self.photographs.stored[0].dtype)
        photographs = replace(self.photographs, noise=noise, noise_stated=True)
        return replace(self, photographs=photographs, noise_source=source)


def load_plan(
    path: str | Path,
    *,
    transfer: str | float | None = None,
    root: Path | None = None,
    name: str | None = None,
    progress: Progress = silent,
) -> Plan:
    """Read what is to be checked: a capture with or without its photographs, or a scene.

    Args:
        path: a folder with a `capture.toml` or else a `scene.toml`, or one of these files.
        transfer: overrides `encoding.transfer`.
        root: folder that file references may not leave (default: that of the file).
        name: of one of several objects.
        progress: called with a word, the number of images decoded and their total.

    Raises:
        InputError: anything about the files that cannot be used; only some of the photographs exist; several objects
            and none, or no such, is named.
    """
    path = Path(path)
    is_scene = (path / "scene.toml").is_file() and not (path / "capture.toml").is_file()
    file = capture_file(path, "scene.toml") if is_scene else capture_sources(path)[0]
    if is_scene or _has_material(file):
        simulated = describe(file, schema.SceneFile, root=root)
        material = material_in(simulated)
        return _planned(simulated, scene_format(simulated, material), transfer, material, name)
    description = describe(file, schema.CaptureFile, root=root)
    files = [table.file for table in description.tables.image]
    if any(name and (description.folder / name).is_file() for name in files):
        return Plan.of(load_capture(file, transfer=transfer, root=root, progress=progress).object(name))
    dtype = np.dtype(_PIXEL_TYPES.get(Path(files[0] or "").suffix.lower(), np.uint16))
    images = ImageFormat(image_shape(description), image_channels(description), dtype)
    return _planned(description, images, transfer, None, name)


def photographs_of(material: Brdf, photographs: Photographs) -> Photographs:
    """Photographs without noise of another material, in the place of some photographs."""
    encoding, dtype = photographs.encoding, photographs.stored[0].dtype
    bits = 8 * dtype.itemsize if dtype.kind == "u" else None
    stored = []
    for image in range(len(photographs)):
        signal = _radiance(photographs.scene, image, material) * (photographs.exposures[image] / encoding.scale)
        if encoding.flat is not None:
            signal = signal * encoding.flat
        stored.append(stored_pixels(signal + encoding.black, encoding, bits))
    return replace(photographs, stored=tuple(stored))


def with_full_scale_for(material: Brdf, photographs: Photographs) -> Photographs:
    """The photographs with full scale such that the brightest pixel of a material lies at 90 % of it."""
    scene, encoding = photographs.scene, photographs.encoding
    peak = max(float(_radiance(scene, k, material).max()) * e for k, e in enumerate(photographs.exposures))
    scale = peak / (_BRIGHTEST - float(np.max(encoding.black)))
    return replace(photographs, encoding=replace(encoding, scale=scale)) if scale > 0 else photographs


def _radiance(scene: Scene, image: int, material: Brdf) -> np.ndarray:
    """Radiance [N, C] of the object's pixels."""
    rendered = render_image(scene, image, material).detach().numpy()
    return rendered.reshape(-1, rendered.shape[-1])[scene.surface.pixels]


def _planned(
    description: Description,
    images: ImageFormat,
    transfer: str | float | None,
    material: Material | None,
    name: str | None,
) -> Plan:
    """A plan of photographs that do not exist, of the object of that name where there are several."""
    table = description.tables.encoding
    setup = realise(description, images, transfer=transfer or table.transfer or "linear")
    pixels = np.zeros((len(setup.scene.surface), images.channels), images.dtype)
    stated_noise = setup.noise if setup.noise is not None and setup.noise != Noise(0.0, 0.0) else None
    noise = stated_noise or TYPICAL
    photographs = setup.photographs((pixels,) * len(setup.exposures), Sensor(setup.encoding, noise))
    exposed = table.scale is not None or images.dtype.kind == "f"
    conventions = understood(description, photographs)
    photographs = photographs.object(name, description.name)
    if isinstance(material, Mapping):
        material = material[name] if name is not None else next(iter(material.values()))
    source = "as the file states it" if stated_noise else "that of a typical camera, as none is stated"
    plan = Plan(
        description.name,
        photographs,
        material,
        exposed,
        uncertainty=description.uncertainty,
        understood=conventions,
    )
    return plan.with_noise(noise.read, noise.gain, source)


def _has_material(file: Path) -> bool:
    """Whether a file is a scene; the reader of captures refuses a file that is no TOML."""
    try:
        return schema.has_material(tomllib.loads(file.read_text("utf-8")))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError):
        return False
