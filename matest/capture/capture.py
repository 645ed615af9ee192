"""A capture: image files and their description, read into photographs of a scene."""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import torch

from matest.capture import schema
from matest.capture.assembly import ImageFormat, Setup, realise
from matest.capture.description import Description, capture_sources, describe
from matest.capture.digests import digest, digested
from matest.capture.open_conventions import settled
from matest.capture.understanding import understood
from matest.errors import InputError
from matest.photographs.file_images import FileImages
from matest.photographs.images import ImageFile, read_image, read_image_file
from matest.photographs.photographs import Photographs
from matest.photographs.samples import PhotographSamples
from matest.photographs.sensor import sensor_of
from matest.photographs.storage import Storage
from matest.progress import Progress, silent
from matest.samples.uncertainty import Uncertainty
from matest.scene import Scene
from matest.workers import in_threads

# Images that a note lists by name, at most.
_NAMES = 3

# Pixels. An error of the circle of a sphere of 40 pixels' radius by this much moves its roughness by 0.1 %.
_EXACT_CIRCLE = 0.005


@dataclass(frozen=True)
class Capture:
    """Photographs and the files that hold them.

    Attributes:
        name: of its folder.
        photographs: of the object, with its geometry and light.
        files: the image files.
        folder: that holds the capture.
        sums: SHA-256 of the bytes that were read of every file: images, capture.toml, and the others.
        timing: seconds spent reading images, building geometry and estimating noise.
        uncertainty: of the calibration, as far as capture.toml states it.
        description: that it was read from, with what the photographs decided; None for one made in memory.
        understood: how it was read, a clause for each of its conventions.
    """

    name: str
    photographs: Photographs
    files: tuple[Path, ...] = ()
    folder: Path = Path()
    sums: dict[Path, str] = field(default_factory=dict)
    timing: dict[str, float] = field(default_factory=dict)
    uncertainty: Uncertainty = field(default_factory=Uncertainty)
    description: Description | None = None
    understood: dict[str, str] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.photographs)

    def __repr__(self) -> str:
        pixels = len(self.scene.surface)
        return f"Capture({self.name}: {len(self)} photographs, {pixels} pixels of the object, {self.channels} channels)"

    @property
    def scene(self) -> Scene:
        """Surface, lights, shadows."""
        return self.photographs.scene

    @property
    def channels(self) -> int:
        return self.photographs.channels

    @property
    def relative(self) -> bool:
        """True when the common scale of the lights is unknown."""
        return self.photographs.relative

    @property
    def names(self) -> list[str]:
        """The image files as the capture refers to them."""
        return list(self.photographs.names)

    @cached_property
    def objects(self) -> dict[str, Capture]:
        """Of several objects that are seen, each by its name: the same photographs, and no pixel but its own.

        Shadows of the others lie on it; light that the others send to it is not modelled. Empty where there is one.
        """
        objects = self.scene.surface.objects
        return {} if objects is None else {name: self.object(name) for name in objects.seen}

    def object(self, name: str | None = None) -> Capture:
        """One object of several, by its name; the only one without.

        Raises:
            InputError: no object of that name is seen, or there are several and none is named.
        """
        if name is None and self.scene.surface.objects is None:
            return self
        photographs = self.photographs.object(name, self.name)
        return replace(self, name=f"{self.name}/{name}" if name else self.name, photographs=photographs)

    @property
    def circle_uncertainty(self) -> Uncertainty:
        """Of the pose and the radius of a sphere whose circle was fitted to the mask; none is stated of other objects.

        It holds what the edge of the mask scatters about the circle, not a mask that is too wide all around. The
        second number of the pose is the angle that the first subtends at the radius: nothing depends on it. A circle
        that is known so well that no estimate depends on its errors has none.
        """
        circle = self.scene.surface.circle
        if circle is None or max(circle.centre_std, circle.radius_std) < _EXACT_CIRCLE:
            return Uncertainty()
        return Uncertainty(pose=(circle.centre_std, circle.centre_std / circle.radius), radius=circle.radius_std)

    @property
    def stated_uncertainty(self) -> Uncertainty:
        """What capture.toml states of the calibration, and of the circle of a sphere otherwise what its fit gives."""
        return self.circle_uncertainty.merged(self.uncertainty)

    def radiance(self, image: int, index: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Measured radiance [n, C] of object pixels, float32."""
        return self.photographs.radiance(image, index)

    def samples(
        self,
        images: Iterable[int] | None = None,
        *,
        dtype: torch.dtype = torch.float32,
        device: torch.device | str = "cpu",
    ) -> PhotographSamples:
        """Geometry and photometry of every lit pixel, tile by tile (of some images only, if given)."""
        return self.photographs.samples(images, dtype=dtype, device=device)

    def digests(self) -> dict[str, str]:
        """SHA-256 of every file of the capture as it was read, by its path from the folder."""
        return _by_name(self.sums, self.folder)


def load_capture(
    path: str | Path,
    *,
    transfer: str | float | None = None,
    root: Path | None = None,
    progress: Progress = silent,
) -> Capture:
    """Read a capture: a folder with a `capture.toml`, or that file; or a folder of a layout (`capture.formats`).

    Images are decoded once and in parallel; shadows are traced where the object can shadow itself.

    Args:
        path: folder or file.
        transfer: overrides `encoding.transfer`: "linear", "srgb" or a gamma.
        root: folder that file references may not leave (default: the capture's own).
        progress: called with a word, the number of images decoded and their total.

    Raises:
        InputError: anything about the files that cannot be used, in one sentence.
    """
    sums: dict[Path, str] = {}
    with digested(capture_sources(path), sums):
        description = describe(path, schema.CaptureFile, root=root)
    files = [table.file for table in description.tables.image]
    if None in files:
        raise InputError(
            f"{description.file}: image {files.index(None)} has no file; a capture names one for every [[image]]."
        )
    paths = [description.path(name, f"image {k}: file") for k, name in enumerate(files) if name is not None]
    timing = {"read": 0.0, "geometry": 0.0, "noise": 0.0}
    # The size and the type of the first image decide how the geometry and the encoding are built.
    with _time(timing, "read"), digested(paths[:1], sums):
        first = read_image_file(paths[0])
    references = [Path(os.path.normpath(description.folder / name)) for _, name in description.references]
    with _time(timing, "geometry"), digested(references, sums):
        setup = _setup(description, paths, first, transfer)
    with _time(timing, "read"):
        files_read = _decode(paths, first, setup.scene.surface.pixels, sums, progress)
    arrays = [file.pixels for file in files_read]
    stored = FileImages([(path, sums[path]) for path in paths], _unchanged, setup.scene.surface.pixels, arrays)
    setup = setup.with_exposures([file.exposure for file in files_read])
    with _time(timing, "noise"):
        sensor = sensor_of(
            stored, setup.encoding, setup.scene.surface, setup.noise, clips_as_stated=setup.saturation_stated
        )
    said = (
        *setup.notes,
        *_notes_of_layout(description),
        *_sentences(description.names, [file.notes for file in files_read]),
    )
    photographs = replace(setup.photographs(stored, sensor), notes=said)
    with _time(timing, "geometry"):
        photographs, description = settled(photographs, description)
    return Capture(
        name=description.name,
        photographs=photographs,
        files=tuple(paths),
        folder=description.folder,
        sums={file: sums[file] for file in description.files},
        timing=timing,
        uncertainty=description.uncertainty,
        description=description,
        understood=understood(description, photographs),
    )


def present_digests(path: str | Path, root: Path | None = None) -> dict[str, str]:
    """What `Capture.digests` would be if the capture was read now, without decoding its photographs.

    Args:
        path, root: as `load_capture` takes them.

    Raises:
        InputError: the capture cannot be read.
        OSError: a file of it cannot be read.
    """
    description = describe(path, schema.CaptureFile, root=root)
    return _by_name({file: digest(file) for file in description.files}, description.folder)


def _by_name(digests: dict[Path, str], folder: Path) -> dict[str, str]:
    """Digests by the path of the file from a folder."""
    return {os.path.relpath(file, folder): digest for file, digest in digests.items()}


def _notes_of_layout(description: Description) -> tuple[str, ...]:
    """What is said of a capture that is read from a layout: what that takes for granted, and what was unusual."""
    content = description.content
    if content is None:
        return ()
    words = f"Read as {description.layout}: {content.axes}; {'; '.join(content.assumptions)}."
    return words, *content.notes


def _setup(
    description: Description[schema.CaptureFile], paths: list[Path], first: ImageFile, transfer: str | float | None
) -> Setup:
    """Everything about the photographs except their pixels, which are in the format of the first.

    Raises:
        InputError: the description does not fit this format, or the first image is unlike the others.
    """
    images = ImageFormat.of(first.pixels)
    try:
        # What is fitted is in single precision.
        return realise(description, images, transfer=transfer, precision=np.float32)
    except InputError:
        # A mask, say, that does not fit the first image may fit all others.
        if len(paths) > 1 and ImageFormat.of(read_image(paths[1])) != images:
            raise _odd_image(paths) from None
        raise


@contextmanager
def _time(seconds: dict[str, float], step: str) -> Iterator[None]:
    """Add the time that the block takes to `seconds`."""
    start = time.perf_counter()
    yield
    seconds[step] += time.perf_counter() - start


def _decode(
    paths: list[Path], first_file: ImageFile, pixels: np.ndarray, sums: dict[Path, str], progress: Progress
) -> list[ImageFile]:
    """Every image with the object's pixels [N, C] only; digests of the files are added to `sums`.

    Memory holds only a few whole images at once.
    """
    storage = Storage()
    first = first_file.pixels

    def kept(file: ImageFile) -> ImageFile:
        image = file.pixels
        return replace(file, pixels=storage.keep(image.reshape(-1, image.shape[2])[pixels]), coverage=None)

    def load(path: Path) -> ImageFile | None:
        with digested([path], sums):
            file = read_image_file(path)
        return kept(file) if ImageFormat.of(file.pixels) == ImageFormat.of(first) else None

    files = [kept(first_file)]
    for count, loaded in enumerate(in_threads(load, paths[1:]), start=2):
        if loaded is None:
            raise _odd_image(paths)
        files.append(loaded)
        progress("reading images", count, len(paths))
    return files


def _unchanged(path: Path, digest_before: str) -> np.ndarray:
    """The pixels of an image file that was read before.

    Raises:
        InputError: the file is not what it was, or cannot be read now.
    """
    sums: dict[Path, str] = {}
    with digested([path], sums):
        pixels = read_image(path)
    if sums[path] != digest_before:
        raise InputError(f"{path}: expected the image that was read before; the file has changed. Run again.")
    return pixels


def _odd_image(paths: list[Path]) -> InputError:
    """What is wrong with the first image that is not of the format of most."""
    formats = [ImageFormat.of(image) for image in in_threads(read_image, paths)]
    usual, _ = Counter(formats).most_common(1)[0]
    path, odd = next((path, one) for path, one in zip(paths, formats, strict=True) if one != usual)
    like = paths[formats.index(usual)].name
    if formats.count(usual) > 1:
        like += f" and {formats.count(usual) - 1} more"
    if odd.shape != usual.shape:
        sizes = ["×".join(map(str, one.shape)) for one in (usual, odd)]
        sentence = f"expected the size of {like}, {sizes[0]}; got {sizes[1]}. All images of a capture have one size."
    else:
        kinds = [f"{one.channels} channel(s) of {one.dtype}" for one in (usual, odd)]
        sentence = f"expected {kinds[0]} like {like}; got {kinds[1]}. Convert the images to one kind."
    return InputError(f"{path}: {sentence}")


def _sentences(names: Sequence[str], notes: Sequence[tuple[str, ...]]) -> tuple[str, ...]:
    """One sentence for every note, with the names of the images that it is of."""
    images: dict[str, list[str]] = {}
    for name, notes_of_image in zip(names, notes, strict=True):
        for note in notes_of_image:
            images.setdefault(note, []).append(name)
    return tuple(f"{_image_list(some, len(names))}: {note}." for note, some in images.items())


def _image_list(some: list[str], total: int) -> str:
    """Names of some of all images; after the first few, how many more there are."""
    if len(some) == total > 1:
        return "All images"
    more = len(some) - _NAMES
    return ", ".join(some[:_NAMES]) + (f" and {more} more" if more > 0 else "")
