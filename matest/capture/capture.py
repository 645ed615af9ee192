"""A capture: photographs of one object whose shape and lights are known."""

from __future__ import annotations

import hashlib
import mmap
import os
import tempfile
import time
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import torch

from matest.capture import schema
from matest.capture.assembly import Folder, build_encoding, build_scene, build_surface
from matest.errors import InputError
from matest.photographs.images import full_scale, read_image
from matest.photographs.photometry import FLOAT_FLOOR, Encoding, Noise, estimate_noise, quantisation, steps
from matest.photographs.samples import PhotographSamples
from matest.progress import Progress, silent
from matest.scene import Scene
from matest.workers import in_threads

# Pixels beyond this many bytes go to a temporary file: memory does not grow with the number of images.
_MEMORY_BUDGET = 96 << 20
# Noise is estimated from at most this many images.
_NOISE_IMAGES = 8


@dataclass(frozen=True)
class Capture:
    """Photographs with their geometry and light, read once; only the object's pixels are kept, as stored.

    Attributes:
        name: name of its folder.
        scene: surface, lights, shadows.
        stored: per image the object's pixels [N, C] as in the file.
        encoding: from pixels to radiance.
        exposures: per image.
        noise: camera noise, given or estimated from the images.
        noise_given: whether the capture states its noise.
        relative: True when the common scale of the lights is unknown.
        files: the image files.
        folder: where it lies.
        others: capture.toml and the other files it refers to.
        timing: seconds spent reading images, building geometry and estimating noise.
        copies: channels that have been left out as copies of the one that is there (`without_copies`).
    """

    name: str
    scene: Scene
    stored: tuple[np.ndarray, ...]
    encoding: Encoding
    exposures: tuple[float, ...]
    noise: Noise
    noise_given: bool
    relative: bool
    files: tuple[Path, ...]
    folder: Path = Path()
    others: tuple[Path, ...] = ()
    timing: dict[str, float] = field(default_factory=dict)
    copies: int = 0

    def __len__(self) -> int:
        return len(self.stored)

    @property
    def channels(self) -> int:
        return self.stored[0].shape[1]

    def samples(
        self,
        images: Iterable[int] | None = None,
        *,
        dtype: torch.dtype = torch.float32,
        device: torch.device | str = "cpu",
    ) -> PhotographSamples:
        """Geometry and photometry of every lit pixel, tile by tile (of some images only, if given)."""
        return PhotographSamples(self, tuple(range(len(self))) if images is None else tuple(images), dtype, device)

    def radiance(self, image: int, index: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Measured radiance [n, C] of object pixels, float32."""
        stored = self.stored[image]
        chosen = stored[index] if isinstance(index, slice) else np.take(stored, index, axis=0)
        return self.encoding.signal(chosen, index, self.encoding.scale / self.exposures[image])

    def release(self, image: int) -> None:
        """Give back the memory of an image's pixels where they lie in a temporary file too."""
        _give_back(self.stored[image])

    @property
    def names(self) -> list[str]:
        """The image files as the capture refers to them."""
        return [os.path.relpath(file, self.folder) for file in self.files]

    def digests(self) -> dict[str, str]:
        """SHA-256 of every file of the capture, by its path in it."""
        return {
            os.path.relpath(file, self.folder): "sha256:" + hashlib.sha256(file.read_bytes()).hexdigest()
            for file in (*self.files, *self.others)
        }


def load_capture(
    path: str | Path,
    *,
    transfer: str | float | None = None,
    root: Path | None = None,
    progress: Progress = silent,
) -> Capture:
    """Read a capture: a folder with a `capture.toml`, or that file.

    Images are decoded once and in parallel; shadows are traced where the object can shadow itself.

    Args:
        path: folder or file.
        transfer: overrides `encoding.transfer`: "linear", "srgb" or a gamma.
        root: folder that file references may not leave (default: the capture's own).
        progress: called with a word, the number of images decoded and their total.

    Raises:
        InputError: anything about the files that cannot be used, in one sentence.
    """
    file = capture_file(path, "capture.toml")
    tables = schema.read(file, schema.CaptureFile)
    folder = Folder(file, (root or file.parent).absolute())
    if not tables.image:
        raise InputError(f"{file}: expected at least one [[image]]; got none.")
    names = [table.file for table in tables.image]
    if None in names:
        raise InputError(f"{file}: image {names.index(None)} has no file; a capture names one for every [[image]].")
    paths = [folder.file(name, f"image {k}: file") for k, name in enumerate(names) if name is not None]

    clock = time.perf_counter()
    first = read_image(paths[0])
    read_s = time.perf_counter() - clock
    shape, channels = (first.shape[0], first.shape[1]), first.shape[2]

    clock = time.perf_counter()
    surface = build_surface(tables, folder, shape, str(file))
    for k, table in enumerate(tables.image):
        if not (np.isfinite(table.exposure) and table.exposure > 0):
            raise InputError(f"{file}: image {k}: exposure must be positive; got {table.exposure}.")
    encoding = build_encoding(tables.encoding, folder, surface, first, transfer)
    scene, powers_known = build_scene(tables, folder, surface, channels)
    geometry_s = time.perf_counter() - clock

    clock = time.perf_counter()
    stored = _decode(paths, first, surface.pixels, progress)
    read_s += time.perf_counter() - clock
    _check_noise(tables.noise, str(file))
    capture = Capture(
        name=file.parent.absolute().name,
        scene=scene,
        stored=stored,
        encoding=encoding,
        exposures=tuple(table.exposure for table in tables.image),
        noise=Noise(0.0, 0.0),
        noise_given=tables.noise is not None,
        relative=tables.encoding.radiometry == "relative" or not powers_known,
        folder=folder.path,
        files=tuple(paths),
        others=(file, *(folder.file(name, key) for key, name in references(tables))),
        timing={"read": read_s, "geometry": geometry_s},
    )
    clock = time.perf_counter()
    noise = _noise(capture, tables.noise)
    return replace(capture, noise=noise, timing={**capture.timing, "noise": time.perf_counter() - clock})


def capture_file(path: str | Path, name: str) -> Path:
    """The TOML file that a path names: itself, or `name` inside the folder.

    Raises:
        InputError: there is none.
    """
    path = Path(path)
    file = path / name if path.is_dir() else path
    if not file.is_file():
        expected = f"expected a folder with a {name}" if path.is_dir() or not path.suffix else "no such file"
        raise InputError(f"{path}: {expected}; check the path.")
    if file.suffix.lower() != ".toml":
        raise InputError(
            f"{path}: expected a folder or its {name}; got a {file.suffix or 'nameless'} file. Give the folder."
        )
    return file


def _decode(paths: list[Path], first: np.ndarray, pixels: np.ndarray, progress: Progress) -> tuple[np.ndarray, ...]:
    """The object's pixels of every image; at no time are more than a few whole images in memory."""
    spill = _Spill()

    def load(path: Path) -> np.ndarray:
        image = read_image(path)
        if image.shape[:2] != first.shape[:2]:
            raise InputError(
                f"{path}: expected the size of the first image, {paths[0].name} ({first.shape[0]}×{first.shape[1]}); "
                f"got {image.shape[0]}×{image.shape[1]}. All images of a capture have one size."
            )
        if image.shape[2] != first.shape[2] or image.dtype != first.dtype:
            raise InputError(
                f"{path}: expected {first.shape[2]} channel(s) of {first.dtype} like {paths[0].name}; got "
                f"{image.shape[2]} of {image.dtype}. Convert the images to one kind."
            )
        return spill.keep(image.reshape(-1, image.shape[2])[pixels])

    stored = [spill.keep(first.reshape(-1, first.shape[2])[pixels])]
    for count, kept in enumerate(in_threads(load, paths[1:]), start=2):
        stored.append(kept)
        progress("reading images", count, len(paths))
    return tuple(stored)


class _Spill:
    """Keeps arrays in memory up to the budget, and beyond it in temporary files that vanish with them."""

    def __init__(self) -> None:
        self._bytes = 0

    def keep(self, array: np.ndarray) -> np.ndarray:
        self._bytes += array.nbytes
        if self._bytes <= _MEMORY_BUDGET:
            return array
        with tempfile.TemporaryFile() as file:
            spilled = np.memmap(file, dtype=array.dtype, shape=array.shape, mode="w+")
        spilled[:] = array
        spilled.flush()
        _give_back(spilled)
        return spilled


def _give_back(array: np.ndarray) -> None:
    """Drop the pages of a mapped file from memory; they are read again when they are needed."""
    mapped = getattr(array, "_mmap", None)
    if mapped is not None and hasattr(mmap, "MADV_DONTNEED"):
        mapped.madvise(mmap.MADV_DONTNEED)


def references(tables: schema.CaptureFile) -> list[tuple[str, str]]:
    """Files that a capture refers to beside its images, with the key that does."""
    geometry, encoding = tables.geometry, tables.encoding
    found = {
        "mask": tables.mask,
        "geometry.mesh": geometry.mesh,
        "geometry.normals": geometry.normals,
        "geometry.positions": geometry.positions,
        "encoding.black": encoding.black,
        "encoding.flat": encoding.flat,
    }
    return [(key, name) for key, name in found.items() if isinstance(name, str)]


def _check_noise(table: schema.NoiseTable | None, label: str) -> None:
    for key in ("read", "gain"):
        value = getattr(table, key) if table is not None else 0.0
        if not (np.isfinite(value) and value >= 0):
            raise InputError(
                f"{label}: noise.{key} must be finite and not negative; got {value}. Correct or remove it."
            )


def _noise(capture: Capture, table: schema.NoiseTable | None) -> Noise:
    stored = capture.stored[0]
    floor = quantisation(capture.encoding, stored.dtype)
    if table is not None:
        # Stated noise leaves rounding to the image format.
        read = float(np.hypot(table.read, floor))
        # Noise stated to be none leaves rounding and geometry.
        peak = float(capture.encoding.signal(stored, slice(None)).max())
        return Noise(read or FLOAT_FLOOR * max(peak, 1e-30), table.gain)
    surface = capture.scene.surface
    chosen = np.linspace(0, len(capture) - 1, min(len(capture), _NOISE_IMAGES)).round().astype(int)
    signals, valid = [], []
    for image in chosen:
        pixels = capture.stored[image]
        clipped = capture.encoding.saturated(pixels) | (pixels <= 0)
        signals.append(surface.image(capture.encoding.signal(pixels, slice(None)).astype(np.float32)))
        valid.append(surface.image(~clipped & ~surface.rim[:, None]))
    black = float(np.mean(capture.encoding.black))

    def step(signal: np.ndarray) -> np.ndarray:
        if stored.dtype.kind != "u":
            return np.zeros_like(signal)
        top = int(full_scale(stored.dtype))
        codes = (capture.encoding.encoded(signal + black) * top).round().clip(0, top).astype(int)
        return steps(capture.encoding.transfer, top)[codes]

    return estimate_noise(signals, valid, floor, step)
