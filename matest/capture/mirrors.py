"""Folders with photographs of mirror spheres, which need no lights, and often have no capture.toml."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from matest.capture import schema
from matest.capture.assembly import SATURATION, ImageFormat, saturation
from matest.capture.description import Description, describe
from matest.capture.geometry import camera_of, check_size
from matest.errors import InputError, errors_of
from matest.lights.mirror import Mirror
from matest.lights.outline import find_outline
from matest.lights.sphere import MirrorSphere
from matest.photographs.images import read_image, read_mask
from matest.photographs.photometry import Encoding
from matest.photographs.readers import READERS
from matest.scene.camera import Camera

# Stems of files beside the photographs that are none of them.
_MASK, _REFERENCE = "mask", "ref"
# Photographs in which an outline is looked for, so many at most.
_OUTLINE_PHOTOGRAPHS = 12
# Share of the largest part of a mask below which another one is no sphere.
_SPECK = 0.1
# Circle of a sphere in the layout of PSBox: x from the left, y from the bottom and radius, a number a line.
_PSBOX_CIRCLE = "circle_data.txt"
Circle = tuple[float, float, float]


def load_mirror(
    path: str | Path,
    circles: Sequence[Circle] = (),
    *,
    transfer: str | float | None = None,
    fov_y: float | None = None,
) -> Mirror:
    """Read a folder with photographs of mirror spheres.

    It has a capture.toml, whose images need no lights, or images (in the order of their names) beside a mask, a circle
    in PSBox's `circle_data.txt`, or neither where `circles` are given or the images show where the sphere ends. A mask
    of several parts shows several spheres, from left to right.

    Args:
        path: the folder, or its capture.toml.
        circles: x, y and radius of the spheres in pixels; none: those of the files.
        transfer: overrides `encoding.transfer`; images that state none count as linear.
        fov_y: vertical field of view of a perspective camera, rad; overrides that of the capture.

    Raises:
        InputError: no images, no circle, or files that cannot be used, in one sentence.
    """
    path = Path(path)
    found = _read(path, transfer)
    mirror = _with_spheres(found.mirror, circles or found.circles, _with_view(found.camera, fov_y), found.label)
    for x, y, radius in (sphere.circle for sphere in mirror.spheres):
        height, width = mirror.shape
        inside = 0 < radius < 10 * max(height, width) and 0 < x < width and 0 < y < height
        if not inside:
            raise InputError(
                f"{path}: the circle {x:g},{y:g},{radius:g} (x, y and radius in pixels) has its centre outside the "
                f"{width}×{height} images; correct it."
            )
    return mirror


def load_target(path: str | Path, *, transfer: str | float | None = None) -> Mirror:
    """Read a folder with photographs of a flat target, as `load_mirror` reads those of spheres; its mask shows it.

    Raises:
        InputError: no images, or files that cannot be used, in one sentence.
    """
    return _read(Path(path), transfer).mirror


@dataclass(frozen=True)
class _Found:
    """What a folder says of its photographs.

    Attributes:
        mirror: the photographs, without spheres.
        circles: of spheres, where files state them.
        camera: that took them.
        label: of the file or folder, for refusals.
    """

    mirror: Mirror
    circles: Sequence[Circle]
    camera: Camera
    label: str


def _read(path: Path, transfer: str | float | None) -> _Found:
    if (path / "capture.toml").is_file() or path.is_file():
        return _described(describe(path, schema.CaptureFile), transfer)
    return _plain(path, transfer)


def _described(description: Description[schema.CaptureFile], transfer: str | float | None) -> _Found:
    tables, file = description.tables, description.file
    unnamed = [number for number, table in enumerate(tables.image) if table.file is None]
    if unnamed:
        raise InputError(f"{file}: image {unnamed[0]} has no file; name one for every [[image]].")
    files = tuple(
        description.path(table.file or "", f"image {number}: file") for number, table in enumerate(tables.image)
    )
    first = read_image(files[0])
    images = ImageFormat.of(first)
    mask = None
    if tables.mask is not None:
        mask = read_mask(description.path(tables.mask, "mask"))
        check_size(mask, images.shape, f"{description.folder / tables.mask}: the mask")
    camera = Camera() if tables.camera is None else camera_of(tables.camera, str(file))
    geometry = tables.geometry
    circles: list[Circle] = []
    if geometry.centre is not None and geometry.radius is not None:
        circles = [(*geometry.centre, geometry.radius)]
    transfer = transfer if transfer is not None else tables.encoding.transfer
    encoding = Encoding("linear" if transfer is None else transfer, saturation=saturation(description, images))
    encoding = replace(encoding, **_frames(description, encoding, images))
    exposures = tuple(table.exposure for table in tables.image)
    mirror = Mirror(description.folder, files, description.names, (), mask, encoding, images.shape, exposures)
    return _Found(mirror, circles, camera, str(file))


def _with_spheres(mirror: Mirror, circles: Sequence[Circle], camera: Camera, label: str) -> Mirror:
    """Photographs with the spheres in them."""

    def photographs() -> list[np.ndarray]:
        steps = max(len(mirror.files) // _OUTLINE_PHOTOGRAPHS, 1)
        return [mirror.brightness(index) for index in range(0, len(mirror.files), steps)]

    with errors_of(label):
        spheres = _spheres(circles, mirror.mask, mirror.shape, camera, photographs)
    return replace(mirror, spheres=spheres, outline_seen=not circles and mirror.mask is None)


def _frames(description: Description[schema.CaptureFile], encoding: Encoding, images: ImageFormat) -> dict[str, Any]:
    """The pedestal and the flat field of an encoding, at every pixel of the images where a file has them."""
    table = description.tables.encoding
    frames: dict[str, Any] = {}
    for key, file in (("black", table.black), ("flat", table.flat)):
        if isinstance(file, str):
            path = description.path(file, f"encoding.{key}")
            image = read_image(path)
            check_size(image, images.shape, f"{path}: the frame")
            pixels = image.reshape(-1, image.shape[2])
            frames[key] = encoding.signal(pixels, slice(None)) if image.dtype.kind == "u" else pixels
    if not isinstance(table.black, str):
        frames["black"] = float(encoding.linear(np.array(table.black)))
    return frames


def _plain(folder: Path, transfer: str | float | None) -> _Found:
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; give one with photographs, one for each light.")
    psbox = folder / _PSBOX_CIRCLE
    files = tuple(_photographs(folder, _REFERENCE if psbox.is_file() else None))
    if not files:
        raise InputError(f"{folder}: no photographs; put images there, one for each light.")
    first = read_image(files[0])
    shape = (first.shape[0], first.shape[1])
    masks = [file for file in sorted(folder.iterdir()) if file.stem.lower() == _MASK and _is_image(file)]
    mask = read_mask(masks[0]) if masks else None
    if mask is not None:
        check_size(mask, shape, f"{masks[0]}: the mask")
    circles = [_psbox_circle(psbox, shape[0])] if psbox.is_file() else []
    encoding = Encoding(
        "linear" if transfer is None else transfer, saturation=SATURATION if first.dtype.kind == "u" else None
    )
    mirror = Mirror(folder, files, tuple(file.name for file in files), (), mask, encoding, shape)
    return _Found(mirror, circles, Camera(), str(folder))


def _is_image(file: Path) -> bool:
    return file.suffix.lower() in READERS and file.is_file()


def _photographs(folder: Path, reference: str | None) -> Iterator[Path]:
    """Images of a folder by their names, without a mask and a photograph of another name that is no photograph."""
    for file in sorted(folder.iterdir()):
        if _is_image(file) and file.stem.lower() not in (_MASK, reference):
            yield file


def _psbox_circle(file: Path, height: int) -> Circle:
    """The circle of a PSBox folder in pixels from the image's left and upper edge.

    Raises:
        InputError: the file does not hold three numbers.
    """
    try:
        x, y, radius = (float(number) for number in file.read_text("utf-8").split())
    except ValueError:
        raise InputError(f"{file}: expected three numbers, x, y and radius in pixels; correct the file.") from None
    return x, height - y, radius


def _with_view(camera: Camera, fov_y: float | None) -> Camera:
    """The camera with another field of view, at the origin if it was a distant one."""
    if fov_y is None:
        return camera
    if not 0 < fov_y < math.pi:
        raise InputError(f"--fov-y must lie between 0 and π rad; got {fov_y:g}.")
    return replace(camera, height=None, fov_y=fov_y, matrix=None, distortion=())


def _spheres(
    circles: Sequence[Circle],
    mask: np.ndarray | None,
    shape: tuple[int, int],
    camera: Camera,
    photographs: Callable[[], Sequence[np.ndarray]],
) -> tuple[MirrorSphere, ...]:
    """The spheres of circles that are stated, or else those that the mask shows, or else the one that images show.

    Raises:
        InputError: neither is given, and none can be seen.
    """
    if circles:
        return tuple(MirrorSphere.from_circle(circle, shape, camera) for circle in circles)
    if mask is not None:
        return tuple(MirrorSphere.from_mask(part, camera) for part in _parts(mask))
    edge = find_outline(photographs())
    if edge is None:
        raise InputError(
            "no circle: neither a mask nor centre and radius of the sphere, nor an outline that stands out of the "
            "photographs; add mask.png, or give --circle X,Y,R in pixels."
        )
    sphere = MirrorSphere.from_edge(edge, shape, camera)
    # What looks like the outline may be its reflection: the circle is known no better than one that is read off.
    stated = MirrorSphere.from_circle(sphere.circle, shape, camera)
    return (replace(sphere, covariance=sphere.covariance + stated.covariance),)


def _parts(mask: np.ndarray) -> list[np.ndarray]:
    """The masks of single spheres, from left to right: the parts of a mask that do not touch, without specks."""
    from scipy import ndimage

    labels, count = ndimage.label(mask > 0, structure=np.ones((3, 3)))
    sizes = np.bincount(labels.ravel())[1:]
    parts = [np.where(labels == number + 1, mask, 0) for number in range(count) if sizes[number] > _SPECK * max(sizes)]
    return sorted(parts, key=lambda part: float(np.flatnonzero(part.any(axis=0)).mean()))
