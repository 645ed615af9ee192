"""From a scene file to a capture on disk: what a camera would have photographed."""

from __future__ import annotations

import math
import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from matest.bands import Band, bands
from matest.brdf import Brdf, model, preset
from matest.brdf.curvature import SHARPEST, curvature
from matest.capture import schema
from matest.capture.assembly import ImageFormat, Setup, realise
from matest.capture.description import Description, describe, image_channels, image_shape
from matest.capture.writing import as_toml, changes
from matest.errors import Fault, InputError, errors_of, refuse
from matest.estimation.specification import optics, resolve
from matest.outputs import check_distinct, check_writable, keep_inputs, whole_files
from matest.photographs.images import full_scale, write_image
from matest.photographs.noise import Noise, steps
from matest.photographs.photometry import Encoding
from matest.photographs.storage import Storage, release
from matest.progress import Progress, silent
from matest.scene import Scene
from matest.supersampling import PixelMeans, radiance_of_rays
from matest.workers import one_behind

# Level of the brightest pixel of integer images without a scale, fraction of full scale: noise does not saturate it.
_PEAK_LEVEL = 0.9
# Share of a code by which the radiance of a pixel may be wrong before it becomes an integer: few codes round otherwise.
_CODE_SHARE = 0.2
# Type of pixels by their bits, the better ones first; None: floats.
_DTYPES = {16: np.uint16, 8: np.uint8, None: np.float32}
# Bits that each format of images can hold.
_BITS: dict[str, tuple[int | None, ...]] = {
    ".exr": (None,),
    ".npy": (None,),
    ".png": (16, 8),
    ".tif": (16, 8),
    ".tiff": (16, 8),
}
# Keys of [camera] that only a scene has.
_SCENE_KEYS = ("resolution", "supersampling")
# Name of the capture file.
_CAPTURE = "capture.toml"
# First line of the capture files that are written here: only such a file is written over.
_HEADER = "# A simulated capture, written by 'matest render' from {scene}; rendering again replaces it.\n"


@dataclass(frozen=True)
class SimulatedScene:
    """A scene file and the geometry, light and material that it describes.

    Attributes:
        description: content of the file.
        images: format of the images that it is rendered to.
        material: the model.
        setup: geometry and lights at the images' resolution times the supersampling, and the camera.
        supersampling: rays per pixel and axis.
    """

    description: Description[schema.SceneFile]
    images: ImageFormat
    material: Brdf
    setup: Setup
    supersampling: int

    @property
    def scene(self) -> Scene:
        """Geometry and lights."""
        return self.setup.scene

    @cached_property
    def pixels(self) -> PixelMeans:
        """The means over the rays of each pixel."""
        return PixelMeans.of(self.scene, self.supersampling)

    def by_band(self, values: np.ndarray) -> Iterator[tuple[Band, np.ndarray]]:
        """Bands of rows of its images, from top to bottom, and their share of values at covered pixels [m, …]."""
        first = 0
        for band in bands(self.scene.surface, self.supersampling):
            last = first + len(band.covered)
            yield band, values[first:last]
            first = last


def load_scene(path: str | Path) -> SimulatedScene:
    """Read a scene: a folder with a `scene.toml`, or that file.

    Raises:
        InputError: anything about it that cannot be used, in one sentence.
    """
    description = describe(path, schema.SceneFile)
    file, tables = description.file, description.tables
    material = material_of(tables.material, str(file))
    images = scene_format(description, material)
    supersampling = tables.camera.supersampling if tables.camera else 1
    if supersampling > 1 and tables.geometry.normals:
        raise InputError(f"{file}: camera.supersampling must be 1 with a normal map; got {supersampling}.")
    if tables.encoding.flat is not None or isinstance(tables.encoding.black, str):
        raise InputError(f"{file}: a simulated camera has no flat field or dark frame; use a number for black.")
    black = tables.encoding.black
    if images.dtype.kind == "u" and not black < _PEAK_LEVEL:
        raise InputError(f"{file}: encoding.black must leave room for light, below {_PEAK_LEVEL}; got {black}.")
    transfer = tables.encoding.transfer or "linear"
    sized = any(light.size is not None for image in tables.image for light in image.lights)
    setup = realise(
        description,
        images,
        transfer=transfer,
        supersampling=supersampling,
        curvature=curvature(material) if sized else SHARPEST,
    )
    with errors_of(file):
        material = material.replace(optics(material, setup.scene))
    return SimulatedScene(description, images, material, setup, supersampling)


def scene_format(description: Description[schema.SceneFile], material: Brdf) -> ImageFormat:
    """The format of the images that a scene of this material is rendered to.

    Raises:
        InputError: colours of neither one nor three values, no size, or file names whose format has not these bits.
    """
    colours = {len(value) for value in material.parameters.values() if value.ndim}
    channels = image_channels(description, colours)
    shape = image_shape(description)
    bits = bits_of(description.tables, str(description.file))
    return ImageFormat(shape, channels, np.dtype(_DTYPES[bits]))


def radiance(scene: SimulatedScene, image: int) -> np.ndarray:
    """Noise-free radiance [H, W, C] of one image, float64, averaged over each pixel if the scene is supersampled."""
    values = radiance_of_rays(scene.scene, scene.supersampling, image, scene.material)
    return np.concatenate([band.image(part) for band, part in scene.by_band(values)])


def _radiance_to_a_code(scene: SimulatedScene, image: int) -> np.ndarray:
    """`radiance` of the covered pixels [m, C], to a part of a code where pixels become integers."""
    if scene.supersampling == 1 or scene.images.dtype.kind != "u":
        return radiance_of_rays(scene.scene, scene.supersampling, image, scene.material)
    encoding, exposure = scene.setup.encoding, scene.setup.exposures[image]
    tolerance = _CODE_SHARE * float(steps(encoding.transfer, int(full_scale(scene.images.dtype))).min())
    # A scale that is not stated is chosen such that the highest radiance does not exceed full scale.
    scale = None if scene.description.tables.encoding.scale is None else encoding.scale / exposure
    return scene.pixels.radiance(image, scene.material, tolerance, scale)


def simulate(path: str | Path, out: str | Path | None = None, progress: Progress = silent) -> Path:
    """Render a scene file to a capture folder that `matest.load_capture` reads.

    Writes the images (PNG of `noise.bits`, otherwise EXR), `mask.png`, `normals.exr`, the mesh and `capture.toml`.
    The same scene gives the same pixels every time.

    Args:
        path: scene file or its folder.
        out: the capture's folder; default: the scene's own.
        progress: called with a word, the number of images written and their total.

    Raises:
        InputError: a bad scene, or a folder whose capture was not made by rendering.
    """
    scene = load_scene(path)
    tables, file = scene.description.tables, scene.description.file
    folder = Path(out) if out is not None else file.parent
    bits = bits_of(tables, str(file))
    suffix = ".png" if bits else ".exr"
    names = [table.file or f"{number:02d}{suffix}" for number, table in enumerate(tables.image)]
    _check_outputs(scene.description, folder, names)
    check_writable(folder)
    # Kept, since the brightest of all pixels may decide how all are exposed; beyond a budget in a temporary file.
    storage, images, peak = Storage(), [], 0.0
    for number, exposure in enumerate(scene.setup.exposures):
        values = _radiance_to_a_code(scene, number)
        peak = max(peak, float(values.max(initial=0)) * exposure)
        images.append(storage.keep(values))
        progress("rendering images", number + 1, len(tables.image))
    camera = _Camera(scene, _exposed(scene, peak), bits)
    with whole_files(folder, last=_CAPTURE) as part:
        photographs = (camera.photograph(number, images[number]) for number in range(len(images)))
        files = ((part / name, pixels) for name, pixels in zip(names, photographs, strict=True))
        one_behind(lambda file: _write(*file), files)
        _write_geometry(scene, part, copies=not _same(folder, file.parent))
        text = _HEADER.format(scene=file.name) + as_toml(_capture_table(tables, camera.encoding, names))
        (part / _CAPTURE).write_text(text, "utf-8")
    return folder


def material_of(table: dict[str, Any], label: str) -> Brdf:
    """The model of a [material] table: a preset, or parameters by name, by path, or in a table per component.

    Raises:
        InputError: an unknown model, preset or parameter, or a value outside its domain.
    """
    values = dict(table)
    expression, name = values.pop("model", None), values.pop("preset", None)
    if expression is not None and name is not None:
        raise InputError(f"{label}: [material] has both model and preset; give one of them.")
    if not isinstance(expression if name is None else name, str):
        raise InputError(
            f'{label}: [material] needs model = "NAME" or preset = "NAME"; \'matest models\' lists the names.'
        )
    with errors_of(f"{label}: [material]"):
        if name is not None:
            material = preset(name, values.pop("f0", None))
            if values:
                raise InputError(f"a preset has parameters of its own; leave out {', '.join(values)}.")
            return material
        brdf, fixed = model(expression)
        by_path: dict[str, Any] = dict(fixed)
        for key, value in values.items():
            parts = (
                {f"{key}.{inner}": number for inner, number in value.items()}
                if isinstance(value, dict)
                else {key: value}
            )
            by_path |= {resolve(brdf, path): number for path, number in parts.items()}
        return brdf.replace(by_path)


def bits_of(tables: schema.CaptureFile, label: str) -> int | None:
    """Bits of the images: as the scene says, or as the names of its files imply; None for floats.

    Raises:
        InputError: names of formats that cannot be written, that differ, or that hold no such bits.
    """
    files = [image.file for image in tables.image if image.file]
    bits = tables.noise.bits if tables.noise else None
    refuse(label, _name_faults(files))
    if not files:
        return bits
    common = [choice for choice in _DTYPES if all(choice in _BITS[Path(file).suffix.lower()] for file in files)]
    if bits is None and common:
        return common[0]
    if bits not in common:
        raise InputError(f"{label}: {', '.join(files)} cannot hold noise.bits = {bits}; rename them or change bits.")
    return bits


def _name_faults(files: list[str]) -> Iterator[Fault]:
    """Names that images of a capture cannot have."""
    for file in files:
        path = Path(os.path.normpath(file))
        yield not file.isprintable(), f"file = {file!r} has characters that no name should have; rename it."
        yield path.suffix.lower() not in _BITS, f"images are written as {', '.join(_BITS)}; got '{file}'. Rename it."
        outside = path.is_absolute() or str(path).startswith("..")
        yield outside, f"file = '{file}' leads outside the capture's folder; name a file inside it."


def _check_outputs(description: Description, folder: Path, names: list[str]) -> None:
    """Refuse to write over anything but an earlier rendering.

    Raises:
        InputError: a file that is in the way, or that the scene itself refers to.
    """
    target = folder / _CAPTURE
    earlier = target.is_file() and target.read_bytes().startswith(_HEADER.split("{")[0].encode())
    if target.exists() and not earlier:
        raise InputError(f"{target}: exists and was not written by 'matest render'; give another folder with -o.")
    copied = [] if _same(folder, description.folder) else _copied(description)
    written = [*names, "mask.png", "normals.exr", _CAPTURE, *copied]
    check_distinct(written, description.file)
    outputs = [folder / name for name in written]
    inputs = [description.file, *(description.folder / name for _, name in description.references)]
    keep_inputs(outputs, inputs)
    ours = _outputs_of(target) if earlier else set()
    for path in (path for path in outputs if path != target):
        if os.path.lexists(path) and path not in ours:
            raise InputError(f"{path}: would be overwritten; give another folder with -o.")


def _outputs_of(file: Path) -> set[Path]:
    """The files that came with a capture file of an earlier rendering."""
    try:
        tables = schema.read(file, schema.CaptureFile)
    except InputError:
        return set()
    names = ["mask.png", "normals.exr", *(image.file for image in tables.image if image.file is not None)]
    names += [name for name in (tables.geometry.mesh, tables.geometry.positions) if name is not None]
    camera = tables.camera.file if tables.camera is not None else None
    copied = [] if camera is None else [file.parent / camera, *(file.parent / camera).glob("*")]
    return {*copied, *(file.parent / name for name in names)}


def _copied(description: Description) -> list[str]:
    """Files of geometry and camera that a capture takes from its scene."""
    taken = ("geometry.mesh", "geometry.positions", "camera.file")
    return [reference for key, reference in description.references if key in taken]


def _same(folder: Path, source: Path) -> bool:
    """Whether two paths lead to one folder."""
    return folder.resolve() == source.resolve()


def _exposed(scene: SimulatedScene, peak: float) -> Encoding:
    """The encoding of the images; without a stated scale, integers get one that exposes the brightest pixel well.

    Args:
        scene: that was rendered.
        peak: the largest product of radiance and exposure.
    """
    encoding = scene.setup.encoding
    if scene.description.tables.encoding.scale is not None or scene.images.dtype.kind != "u":
        return encoding
    scale = peak / (_PEAK_LEVEL - float(scene.description.tables.encoding.black)) if peak > 0 else 1.0
    # Two digits are enough, and leave the file readable.
    step = 10 ** math.floor(math.log10(scale)) / 10
    return replace(encoding, scale=float(f"{math.ceil(scale / step) * step:.6g}"))


class _Camera:
    """A camera that photographs the images of a scene one after the other, with noise of its own in each.

    Args:
        scene: that was rendered.
        encoding: from pixels to radiance.
        bits: of the images; None: floats.
    """

    def __init__(self, scene: SimulatedScene, encoding: Encoding, bits: int | None) -> None:
        noise = scene.description.tables.noise
        self.encoding = encoding
        self._scene, self._bits = scene, bits
        self._generator = np.random.Generator(np.random.Philox(noise.seed if noise else 0))

    def photograph(self, image: int, radiance: np.ndarray) -> np.ndarray:
        """Pixels [H, W, C] as a file holds them, of the radiance of all covered pixels of an image."""
        scene = self._scene
        noise, exposure = scene.setup.noise or Noise(0.0, 0.0), scene.setup.exposures[image]
        pixels = np.empty((*scene.images.shape, radiance.shape[1]), scene.images.dtype)
        for band, values in scene.by_band(radiance):
            light = expose(band.image(values), exposure, self.encoding, noise, self._generator)
            pixels[band.rows.start : band.rows.stop] = stored_pixels(light, self.encoding, self._bits)
        release(radiance)
        return pixels


def expose(
    image: np.ndarray, exposure: float, encoding: Encoding, noise: Noise, generator: np.random.Generator
) -> np.ndarray:
    """Linear fractions of full scale, black level and noise included."""
    signal = image * exposure / encoding.scale
    spread = np.sqrt(noise.read**2 + noise.gain * signal)
    return signal + encoding.black + spread * generator.standard_normal(signal.shape)


def stored_pixels(pixels: np.ndarray, encoding: Encoding, bits: int | None) -> np.ndarray:
    """Linear fractions of full scale, black included, as an image file holds them: integers, or float32 (None)."""
    if bits is None:
        return (pixels if encoding.transfer == "linear" else encoding.encoded(pixels)).astype(np.float32)
    return np.round(encoding.encoded(pixels).clip(0, 1) * (2**bits - 1)).astype(_DTYPES[bits])


def _write_geometry(scene: SimulatedScene, folder: Path, copies: bool) -> None:
    """Mask (share of the pixel that is object), normals, and with `copies` the files the geometry refers to."""
    mask, normals = np.empty(scene.images.shape, np.uint8), np.empty((*scene.images.shape, 3), np.float32)
    for band in bands(scene.scene.surface, scene.supersampling):
        rows = slice(band.rows.start, band.rows.stop)
        mask[rows] = np.ceil(band.coverage * 255)
        mean = band.means(scene.scene.surface.normals[band.index.start : band.index.stop].numpy())
        length = np.linalg.norm(mean, axis=-1, keepdims=True)
        normals[rows] = band.image(mean / np.maximum(length, 1e-12))
    _write(folder / "mask.png", mask)
    _write(folder / "normals.exr", normals)
    for reference in _copied(scene.description) if copies else ():
        (folder / reference).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(scene.description.folder / reference, folder / reference)


def _capture_table(tables: schema.SceneFile, encoding: Encoding, names: list[str]) -> dict[str, Any]:
    """The capture file of a rendered scene: the scene's tables, with transfer, scale and file names of its images."""
    out: dict[str, Any] = {"mask": "mask.png", "geometry": changes(tables.geometry)}
    if tables.light_axes != "world":
        out["light_axes"] = tables.light_axes
    if tables.geometry.normals is not None:
        out["geometry"]["normals"] = "normals.exr"
    if tables.camera is not None:
        # A file says everything of the pose.
        camera = msgspec.to_builtins(tables.camera) if tables.camera.file is None else changes(tables.camera)
        out["camera"] = {key: v for key, v in camera.items() if v not in (None, []) and key not in _SCENE_KEYS}
    out["encoding"] = changes(tables.encoding) | {"transfer": encoding.transfer, "scale": encoding.scale}
    if tables.noise is not None and (tables.noise.read or tables.noise.gain):
        out["noise"] = {"read": tables.noise.read, "gain": tables.noise.gain}
    if tables.uncertainty:
        out["uncertainty"] = tables.uncertainty
    out["image"] = [changes(image) | {"file": name} for image, name in zip(tables.image, names, strict=True)]
    return out


def _write(path: Path, image: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_image(path, image)
