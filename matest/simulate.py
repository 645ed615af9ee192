"""From a scene file to a capture on disk: what a camera would have photographed."""

from __future__ import annotations

import math
import os
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from matest.bands import bands
from matest.capture import schema
from matest.capture.description import Description
from matest.capture.writing import as_toml, changes
from matest.errors import InputError
from matest.outputs import check_distinct, check_writable, keep_inputs
from matest.photographs.images import full_scale, write_image
from matest.photographs.noise import Noise, steps
from matest.photographs.photometry import Encoding
from matest.photographs.storage import Storage, release
from matest.places import whole_files
from matest.progress import Progress, silent
from matest.scene_file import DTYPES, PEAK_LEVEL, SimulatedScene, bits_of, load_scene
from matest.supersampling import radiance_of_rays
from matest.workers import one_behind

# Share of a code by which the radiance of a pixel may be wrong before it becomes an integer: few codes round otherwise.
_CODE_SHARE = 0.2
# Keys of [camera] that only a scene has.
_SCENE_KEYS = ("resolution", "supersampling")
# Name of the capture file.
_CAPTURE = "capture.toml"
# First line of the capture files that are written here: only such a file is written over.
_HEADER = "# A simulated capture, written by 'matest render' from {scene}; rendering again replaces it.\n"


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


def simulate(source: str | Path | SimulatedScene, out: str | Path | None = None, progress: Progress = silent) -> Path:
    """Render a scene file to a capture folder that `matest.load_capture` reads.

    Writes the images (PNG of `noise.bits`, otherwise EXR), `mask.png`, `normals.exr`, the mesh and `capture.toml`.
    The same scene gives the same pixels every time.

    Args:
        source: scene file or its folder, or what `load_scene` makes of it.
        out: the capture's folder; default: the scene's own.
        progress: called with a word, the number of images written and their total.

    Raises:
        InputError: a bad scene, or a folder whose capture was not made by rendering.
    """
    scene = source if isinstance(source, SimulatedScene) else load_scene(source)
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
    written = [*names, *_geometry_names(description.tables), _CAPTURE, *copied]
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
    names = [*_geometry_names(tables), *(image.file for image in tables.image if image.file is not None)]
    geometry = (tables.geometry.mesh, tables.geometry.positions, *(one.mesh for one in tables.object))
    maps = (light.environment for image in tables.image for light in image.lights)
    names += [name for name in (*geometry, *maps) if name is not None]
    camera = tables.camera.file if tables.camera is not None else None
    copied = [] if camera is None else [file.parent / camera, *(file.parent / camera).glob("*")]
    return {*copied, *(file.parent / name for name in names)}


def _geometry_names(tables: schema.CaptureFile) -> list[str]:
    """Files of what the camera sees that are written beside the photographs."""
    return ["mask.png", "normals.exr", *(["objects.png"] if tables.object else [])]


def _copied(description: Description) -> list[str]:
    """Files of geometry and camera that a capture takes from its scene."""
    # A mask is written anew, and so is a normal map.
    left = ("mask", "geometry.normals")
    return list(dict.fromkeys(reference for key, reference in description.references if key not in left))


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
    scale = peak / (PEAK_LEVEL - float(scene.description.tables.encoding.black)) if peak > 0 else 1.0
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
    return np.round(encoding.encoded(pixels).clip(0, 1) * (2**bits - 1)).astype(DTYPES[bits])


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
    if scene.scene.surface.objects is not None:
        _write(folder / "objects.png", _object_map(scene))
    for reference in _copied(scene.description) if copies else ():
        (folder / reference).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(scene.description.folder / reference, folder / reference)


def _object_map(scene: SimulatedScene) -> np.ndarray:
    """The object in each pixel, counted from 1 in the order of the file, 0 on the background [H, W], uint8."""
    objects, numbers = scene.scene.surface.objects, np.zeros(scene.images.shape, np.uint8)
    assert objects is not None
    for band in bands(scene.scene.surface, scene.supersampling):
        index, most = objects.index[band.index.start : band.index.stop], np.zeros(len(band.covered))
        picture = np.zeros(len(band.covered), np.uint8)
        for number in objects.seen.values():
            share = band.means((index == number)[:, None].astype(float))[:, 0]
            picture[share > most] = number + 1
            most = np.maximum(share, most)
        numbers[band.rows.start : band.rows.stop] = band.image(picture[:, None])[..., 0]
    return numbers


def _capture_table(tables: schema.SceneFile, encoding: Encoding, names: list[str]) -> dict[str, Any]:
    """The capture file of a rendered scene: the scene's tables, with transfer, scale and file names of its images."""
    out: dict[str, Any] = {"mask": "mask.png"}
    if tables.light_axes != "world":
        out["light_axes"] = tables.light_axes
    if tables.object:
        out["object"] = [changes(msgspec.structs.replace(one, material=None)) for one in tables.object]
    else:
        out["geometry"] = changes(tables.geometry)
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
