"""The usable pixels of photographs: which they are, their geometry, and their measured radiance with its noise."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import cv2
import numpy as np
import torch
from torch import Tensor

from matest.directions import dot
from matest.photographs.file_images import FileImages
from matest.photographs.noise import rounding
from matest.photographs.photometry import as_tensor
from matest.photographs.smooth_squares import SmoothSquares, find_squares, no_squares
from matest.samples.batch import Batch
from matest.samples.likelihood import Limits, MeasurementNoise, Readout
from matest.samples.redundancy import Redundancy
from matest.scene import Light, Points
from matest.workers import in_threads

if TYPE_CHECKING:
    from matest.photographs.photographs import Photographs

# Standard deviations of one pixel's noise above which the mean of 3×3 pixels shows light, where cast shadows are
# unknown. They are nine standard deviations of that mean, which noise alone does not reach.
_LIT_DEVIATIONS = 3.0
# Share of the variance of rounding at white that noise has there: that of mid-tones is about a quarter of it.
_MIDTONE_ROUNDING = 0.25
# Directions of light of a pixel up to which it counts as one of a tile: tiles of more directions have fewer pixels.
_FEW_NODES = 16
# Fewest pixels of a surface with smooth squares: the search for them on a smaller one takes longer than they save.
_FEWEST_OF_SQUARES = 1 << 15
# Blocks of pixels along each side of the object. Errors may be correlated within a block; the 16 blocks suffice for a
# jackknife.
_BLOCKS_ACROSS = 4
# Blocks of the object.
BLOCKS = _BLOCKS_ACROSS**2


class _Selection(NamedTuple):
    """The usable pixels of each image, and the number of the others.

    Attributes:
        usable: per image, one bit for each of the N pixels, packed.
        counts: usable pixels per image.
        skipped: number of pixels by the reason to leave them out.
    """

    usable: list[np.ndarray]
    counts: list[int]
    skipped: dict[str, int]


class LitPixels:
    """The usable pixels of some of the photographs.

    `skipped` counts the other pixels: background, shadowed (attached shadows, cast shadows and their edges; on a
    surface without a mesh also pixels too dark for the sensor) and rim (pixels that may mix object and background). It
    also counts pixels with a saturated channel. These are usable: their radiance is at least that of saturation.
    """

    def __init__(
        self,
        photographs: Photographs,
        images: tuple[int, ...],
        dtype: torch.dtype,
        device: torch.device | str,
        redundancy: Redundancy | None = None,
    ) -> None:
        self.photographs = photographs
        self.images = images
        self.dtype = dtype
        self.device = device
        # The images and channels that are not used, and why.
        self.redundancy = redundancy or Redundancy()

    @cached_property
    def _selection(self) -> _Selection:
        surface = self.photographs.scene.surface
        background = surface.shape[0] * surface.shape[1] - len(surface)

        def select(image: int) -> tuple[np.ndarray, int, int]:
            usable = self._usable(image)
            dark = int(np.count_nonzero(~surface.rim) - np.count_nonzero(usable))
            saturated = self._saturated(image)
            self.photographs.release(image)
            return np.packbits(usable), dark, 0 if saturated is None else int((usable & saturated).sum())

        by_image = list(in_threads(select, self.images))
        usable_bits = [bits for bits, _, _ in by_image]
        skipped = {
            "background": background * len(self.images),
            "shadowed": sum(dark for _, dark, _ in by_image),
            "saturated": sum(saturated for _, _, saturated in by_image),
            "rim": int(surface.rim.sum()) * len(self.images),
            "redundant": 0,
        }
        counts = [int(np.bitwise_count(bits).sum()) for bits in usable_bits]
        return _Selection(usable_bits, counts, skipped)

    def _saturated(self, image: int) -> np.ndarray | None:
        """Pixels with a saturated channel [N]; None where there are none."""
        stored, saturated = self.photographs.stored[image], self.photographs.encoding.saturated
        if not saturated(stored.max(keepdims=True, initial=0)).any():
            return None
        return np.asarray(saturated(stored).any(axis=1))

    def _usable(self, image: int, index: np.ndarray | slice = slice(None)) -> np.ndarray:
        """True where a pixel does not touch a silhouette and is lit, of the pixels `index` [n]."""
        usable = ~self.photographs.scene.surface.rim[index] & self._lit(image, index)
        return usable & ~self._dark(image)[index]

    def _lit(self, image: int, index: np.ndarray | slice) -> np.ndarray:
        """True where some light, or ambient light, reaches the pixel, and no shadow edge crosses it [n]."""
        scene = self.photographs.scene
        lit = np.full(len(scene.surface), bool((scene.ambient[image] > 0).any()))[index]
        for _, reaches in self.lights(image, index if isinstance(index, slice) else torch.from_numpy(index)):
            lit |= reaches.numpy()
        edge = scene.shadow_edge[image] if scene.shadow_edge else None
        return lit if edge is None else lit & ~edge[index]

    def lights(self, image: int, index: Tensor | slice = slice(None)) -> Iterator[tuple[Tensor, Tensor]]:
        """Unit vectors to each node of an image's lights [1 or n, 3], and which pixels of `index` it reaches [n]."""
        scene = self.photographs.scene
        shadows = scene.shadows[image] if scene.shadows else None
        normals = scene.surface.normals_as(torch.float32).detach()[index]
        positions = scene.near_positions(image, index)
        positions = None if positions is None else positions.detach().float()
        view = scene.surface.toward_viewer(index).detach().float()
        lights = [light.to(torch.float32, "cpu") for light in scene.lights[image]]
        nodes = (toward for light in lights for toward in _one_by_one(light, positions, normals, view))
        for number, toward in enumerate(nodes):
            reaches = dot(normals, toward) > 0
            if shadows is not None:
                reaches &= torch.from_numpy(~shadows[number][index])
            yield toward, reaches

    def _dark(self, image: int) -> np.ndarray:
        """True where no channel is above the noise, on a surface whose cast shadows cannot be traced [N].

        The mean of 3×3 pixels decides: a choice by a pixel's own noise would bias the values of the usable pixels.
        """
        photographs = self.photographs
        surface = photographs.scene.surface
        if surface.mesh is not None or surface.convex:
            return np.zeros(len(surface), dtype=bool)
        signal = surface.image(photographs.encoding.signal(photographs.stored[image], slice(None)).astype(np.float32))
        mean = cv2.blur(signal, (3, 3)).reshape(-1, photographs.channels)[surface.pixels]
        codes = photographs.stored[image].dtype
        typical = float(rounding(photographs.encoding, codes)[0] * _MIDTONE_ROUNDING)
        return (mean < _LIT_DEVIATIONS * math.hypot(photographs.noise.read, math.sqrt(typical))).all(axis=1)

    @cached_property
    def crowd(self) -> int:
        """How many times as many directions of light a pixel has as tiles are made for."""
        return max([1, *(self.photographs.scene.nodes(image) // _FEW_NODES for image in self.images)])

    @property
    def skipped(self) -> dict[str, int]:
        return dict(self._selection.skipped)

    @property
    def counts(self) -> list[int]:
        """Number of usable pixels of each image."""
        return self._selection.counts

    def __len__(self) -> int:
        return sum(self.counts)

    def usable(self, position: int, index: slice = slice(None)) -> np.ndarray:
        """Whether each pixel of the surface is usable in the image at `position` in `images`, or some in a row [n]."""
        start, stop, _ = index.indices(len(self.photographs.scene.surface))
        first = start // 8
        bits = self._selection.usable[position][first : -(-stop // 8)]
        return np.unpackbits(bits, count=stop - 8 * first).view(bool)[start - 8 * first :]

    def usable_at(self, position: int, index: np.ndarray) -> np.ndarray:
        """`usable` at some pixels [n], without a look at all the others."""
        return self._usable(self.images[position], index)

    def indices(self, position: int) -> np.ndarray:
        """Usable pixels (indices into the surface) of the image at `position` in `images`."""
        return np.flatnonzero(self.usable(position))

    def at(self, position: int, index: np.ndarray) -> Batch:
        """The samples of the image at `position` in `images` at some pixels."""
        image = self.images[position]
        return Batch(
            points=self.points(image, index),
            radiance=self.radiance(image, index),
            noise=MeasurementNoise(self.readout(image, index), self.limits(image, index), self.clipped(image, index)),
            pixels=torch.from_numpy(index.astype(np.int64)).to(self.device),
            groups=self.labels(position, index),
        )

    def labels(self, position: int, index: np.ndarray) -> Tensor:
        """Group of some pixels of the image at `position`, int64 [n]."""
        return torch.from_numpy(position * BLOCKS + self.blocks[index].astype(np.int64))

    def points(self, image: int, index: np.ndarray) -> Points:
        """Geometry and light of some pixels of an image."""
        selection = torch.from_numpy(index.astype(np.int64))
        return self.photographs.scene.points(image, selection, dtype=self.dtype, device=self.device)

    def radiance(self, image: int, index: np.ndarray | slice) -> Tensor:
        """Measured radiance of some pixels of an image [n, C]; each channel is an array of its own."""
        return as_tensor(self.photographs.radiance(image, index).T, self.dtype, self.device).T

    def clipped(self, image: int, index: np.ndarray | slice) -> Tensor | None:
        """Which values are clipped, as in `Batch`."""
        stored = self.photographs.pixels(image, index)
        black = stored.dtype.kind == "u" and stored.min(initial=1) == 0
        if not black and not self.photographs.encoding.saturated(stored.max(axis=0, keepdims=True, initial=0)).any():
            return None
        clipped = self.photographs.encoding.saturated(stored).astype(np.int8)
        if black:
            clipped -= stored == 0
        return torch.from_numpy(clipped).to(self.device)

    def limits(self, image: int, index: np.ndarray | slice) -> Limits | None:
        """Radiance at which some pixels of an image clip; None where none do."""
        photographs = self.photographs
        ends = photographs.encoding.limits(photographs.stored[image].dtype, index)
        if ends is None:
            return None
        scale = photographs.encoding.scale / photographs.exposures[image]
        return Limits(*(as_tensor(end * scale, self.dtype, self.device) for end in ends))

    def readout(self, image: int, index: np.ndarray | slice) -> Readout:
        """Coefficients of the noise of some pixels of an image."""
        photographs = self.photographs
        flat = photographs.encoding.flat
        scale = np.full((1, 1), photographs.encoding.scale / photographs.exposures[image])
        if flat is not None:
            scale = scale / flat[index]
        rounded, power = rounding(photographs.encoding, photographs.stored[image].dtype)
        values = (
            (photographs.noise.read * scale) ** 2,
            photographs.noise.gain * scale,
            rounded * scale ** (2 - power),
            np.full((1, 1), power),
        )
        return Readout(*(as_tensor(value, self.dtype, self.device) for value in values))

    @property
    def divisible(self) -> bool:
        """See `matest.division.Source`, as the following."""
        # To send the geometry for a single photograph takes longer than it saves.
        return len(self.images) > 1 and isinstance(self.photographs.stored, FileImages)

    def parts(self) -> dict[Any, object]:
        photographs = self.photographs
        return {
            "pixels": self,
            "photographs": photographs,
            "scene": photographs.scene,
            "surface": photographs.scene.surface,
        }

    def part(self, name: Any) -> object:
        return self.parts()[name]

    def release(self) -> None:
        if isinstance(self.photographs.stored, FileImages):
            self.photographs.stored.release()

    @cached_property
    def squares(self) -> SmoothSquares:
        """The smooth squares of the surface."""
        scene = self.photographs.scene
        few = len(scene.surface) < _FEWEST_OF_SQUARES
        return no_squares(len(scene.surface)) if few else find_squares(scene, self.blocks)

    @cached_property
    def blocks(self) -> np.ndarray:
        """The block of the object's bounding box that holds each pixel of the surface [N]."""
        surface = self.photographs.scene.surface
        rows, columns = np.divmod(surface.pixels, surface.shape[1])
        return (_cell(rows) * _BLOCKS_ACROSS + _cell(columns)).astype(np.uint8)


def _one_by_one(light: Light, positions: Tensor | None, normals: Tensor, view: Tensor) -> Iterable[Tensor]:
    """Unit vectors to each node of a light [1 or n, 3], not to all at once where there are hundreds of them."""
    if light.near:
        return light.directions(positions, normals, view).unbind(1)
    return (light.toward(node, positions, normals, view) for node in range(light.nodes))


def _cell(coordinate: np.ndarray) -> np.ndarray:
    """Which of `_BLOCKS_ACROSS` equal intervals of the object holds each coordinate."""
    low, span = coordinate.min(), np.ptp(coordinate) + 1
    return (coordinate - low) * _BLOCKS_ACROSS // span
