"""The waist of matest: for every lit pixel of every image, the geometry and the measured radiance with its noise."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np
import torch
from torch import Tensor

from matest.capture.photometry import as_tensor
from matest.scene import Points

if TYPE_CHECKING:
    from matest.capture.capture import Capture

TILE = 16_384
# A pixel counts only where its surroundings are this many standard deviations from clipping.
_CLIP_MARGIN = 3.0
# Samples are grouped into blocks of pixels, whose errors may be correlated: this many across and down an image.
_BLOCKS_ACROSS = 4
BLOCKS = _BLOCKS_ACROSS**2


class Readout(NamedTuple):
    """Noise of an image in radiance: variance = read + gain·radiance; tensors [1 or n, 1 or C]."""

    read: Tensor
    gain: Tensor


@dataclass(frozen=True)
class Batch:
    """n samples: points, their measured radiance [n, C], the noise of their pixels.

    Attributes:
        points: geometry and light.
        radiance: measured, [n, C].
        readout: noise of the pixels.
        seen: False where a channel of a pixel is too dark for the sensor [n, C]; None where all are seen.
        cluster: label of the block of pixels of one image, image · BLOCKS + block (None when mixed).
        runs: where several blocks follow each other in one batch, the label and length of each.
        pixels: where on the surface each sample lies, an index into its N pixels [n]; None for samples of no surface.
    """

    points: Points
    radiance: Tensor
    readout: Readout
    seen: Tensor | None = None
    cluster: int | None = None
    runs: tuple[tuple[int, int], ...] = ()
    pixels: Tensor | None = None

    def __len__(self) -> int:
        return len(self.radiance)

    def __getitem__(self, index: slice) -> Batch:
        """Some of the samples."""
        readout = Readout(*(value if len(value) == 1 else value[index] for value in self.readout))
        seen = None if self.seen is None else self.seen[index]
        pixels = None if self.pixels is None else self.pixels[index]
        return Batch(self.points[index], self.radiance[index], readout, seen, self.cluster, pixels=pixels)

    def variance(self, radiance: Tensor) -> Tensor:
        """Noise variance of a pixel of this true `radiance` [n, C]."""
        return self.readout.read + self.readout.gain * radiance.clamp(min=0)

    def weight(self, radiance: Tensor) -> Tensor:
        """Inverse variance of a pixel of this true `radiance` [n, C]; 0 where a channel is not seen."""
        weight = 1 / self.variance(radiance)
        return weight if self.seen is None else weight * self.seen


class _Selection(NamedTuple):
    """Which pixels of each image are usable, one bit each, and what was skipped.

    Attributes:
        usable: per image, packed bits [N].
        unseen: per image, packed bits [N, C] of channels too dark for the sensor; None where there are none.
        counts: usable pixels per image.
        skipped: number of pixels left out, by reason.
    """

    usable: list[np.ndarray]
    unseen: list[np.ndarray | None]
    counts: list[int]
    skipped: dict[str, int]


class Samples:
    """Samples of some images of a capture.

    Left out, and counted in `skipped`: background, shadowed (attached and cast, with the edge of cast shadows, and
    too dark for the sensor), saturated (in any channel), rim (pixels that may mix object and background).
    """

    def __init__(
        self, capture: Capture, images: tuple[int, ...], dtype: torch.dtype, device: torch.device | str
    ) -> None:
        self.capture = capture
        self.images = images
        self.dtype = dtype
        self.device = device

    @cached_property
    def _selection(self) -> _Selection:
        scene = self.capture.scene
        surface = scene.surface
        skipped = dict.fromkeys(("background", "shadowed", "saturated", "rim", "redundant"), 0)
        usable_bits, unseen_bits = [], []
        for image in self.images:
            usable = ~surface.rim
            skipped["background"] += surface.shape[0] * surface.shape[1] - len(surface)
            skipped["rim"] += int(surface.rim.sum())
            below, above = self._clipped(image)
            dark = usable & (below.all(axis=1) | ~self._lit(image))
            usable &= ~dark
            skipped["shadowed"] += int(dark.sum())
            skipped["saturated"] += int((usable & above).sum())
            usable &= ~above
            usable_bits.append(np.packbits(usable))
            unseen_bits.append(np.packbits(below, axis=0) if below[usable].any() else None)
        counts = [int(np.bitwise_count(bits).sum()) for bits in usable_bits]
        return _Selection(usable_bits, unseen_bits, counts, skipped)

    def _lit(self, image: int) -> np.ndarray:
        """True where some light, or ambient light, reaches the pixel, and no shadow edge crosses it."""
        scene = self.capture.scene
        surface = scene.surface
        lit = np.full(len(surface), bool((scene.ambient[image] > 0).any()))
        shadows = scene.shadows[image] if scene.shadows else None
        for number, light in enumerate(scene.lights[image]):
            toward, _ = light.at(surface.positions)
            faces = ((surface.normals * toward).sum(-1) > 0).numpy()
            lit |= faces if shadows is None else faces & ~shadows[number]
        edge = scene.shadow_edge[image] if scene.shadow_edge else None
        return lit if edge is None else lit & ~edge

    def _clipped(self, image: int) -> tuple[np.ndarray, np.ndarray]:
        """True where the sensor cuts off noise at its lower end [N, C], and at its upper end in any channel [N].

        Judged by the mean of 3×3 pixels: chosen by the noisy pixel itself, what is left over would be biased.
        """
        capture = self.capture
        encoding, noise, stored = capture.encoding, capture.noise, capture.stored[image]
        surface = capture.scene.surface
        below = np.zeros(stored.shape, dtype=bool)
        above = np.asarray(encoding.saturated(stored).any(axis=1))
        if stored.dtype.kind != "u":
            return below, above
        # As the sensor saw it: black level in, flat field not yet divided out.
        linear = encoding.signal(stored, slice(None)) * (1.0 if encoding.flat is None else encoding.flat)
        linear = surface.image((linear + encoding.black).astype(np.float32))
        mean = cv2.blur(linear, (3, 3)).reshape(-1, stored.shape[1])[surface.pixels]
        below = mean < _CLIP_MARGIN * noise.read
        if encoding.saturation is not None:
            top = float(encoding.linear(np.array(encoding.saturation)))
            spread = float(np.sqrt(noise.read**2 + noise.gain * top))
            above |= (mean > top - _CLIP_MARGIN * spread).any(axis=1)
        return below, above

    @property
    def skipped(self) -> dict[str, int]:
        return dict(self._selection.skipped)

    @property
    def counts(self) -> list[int]:
        """Number of usable pixels of each image."""
        return self._selection.counts

    def __len__(self) -> int:
        return sum(self.counts)

    def indices(self, position: int) -> np.ndarray:
        """Usable pixels (indices into the surface) of the image at `position` in `images`."""
        count = len(self.capture.scene.surface)
        return np.flatnonzero(np.unpackbits(self._selection.usable[position], count=count))

    def at(self, image: int, index: np.ndarray, cluster: int | None = None) -> Batch:
        """The samples of one image at some pixels."""
        capture = self.capture
        chosen = torch.from_numpy(index.astype(np.int64))
        return Batch(
            points=capture.scene.points(image, chosen, dtype=self.dtype, device=self.device),
            radiance=as_tensor(capture.radiance(image, index), self.dtype, self.device),
            readout=self._readout(image, index),
            seen=self._seen(image, index),
            cluster=cluster,
            pixels=chosen.to(self.device),
        )

    def _seen(self, image: int, index: np.ndarray) -> Tensor | None:
        unseen = self._selection.unseen[self.images.index(image)]
        if unseen is None:
            return None
        # The bits of these pixels only: unpacking all of them for every tile would cost more than the tile.
        dark = (unseen[index >> 3] >> (7 - (index & 7)).astype(np.uint8)[:, None]) & 1
        return as_tensor(1 - dark, self.dtype, self.device)

    def _readout(self, image: int, index: np.ndarray) -> Readout:
        capture = self.capture
        flat = capture.encoding.flat
        scale = np.full((1, 1), capture.encoding.scale / capture.exposures[image])
        if flat is not None:
            scale = scale / flat[index]
        values = ((capture.noise.read * scale) ** 2, capture.noise.gain * scale)
        return Readout(*(as_tensor(value, self.dtype, self.device) for value in values))

    def tiles(self, size: int = TILE) -> Iterator[Batch]:
        """All samples in tiles that fit the processor's cache, each of one image and one cluster."""
        for position in range(len(self.images)):
            for piece in self.pieces(position, size):
                yield self.at(*piece)

    def pieces(self, position: int, size: int = TILE) -> list[tuple[int, np.ndarray, int]]:
        """The tiles of the image at `position` before anything is computed: arguments of `at`."""
        return [
            (self.images[position], index[start : start + size], cluster)
            for cluster, index in self._clusters(position)
            for start in range(0, len(index), size)
        ]

    def bundles(self, position: int, size: int = TILE) -> list[list[tuple[int, np.ndarray, int]]]:
        """The pieces of an image in groups of about `size` samples: small blocks are not worth a tile each."""
        groups: list[list[tuple[int, np.ndarray, int]]] = [[]]
        filled = 0
        for piece in self.pieces(position, size):
            if groups[-1] and filled + len(piece[1]) > size:
                groups.append([])
                filled = 0
            groups[-1].append(piece)
            filled += len(piece[1])
        return [group for group in groups if group]

    def bundled(self, pieces: list[tuple[int, np.ndarray, int]]) -> Batch:
        """One batch of several pieces of one image."""
        batch = self.at(pieces[0][0], np.concatenate([index for _, index, _ in pieces]))
        return replace(batch, runs=tuple((cluster, len(index)) for _, index, cluster in pieces))

    def _clusters(self, position: int) -> list[tuple[int, np.ndarray]]:
        """Blocks of an image: their labels, position · BLOCKS + block, and usable pixels."""
        index = self.indices(position)
        own = self._blocks[index]
        order = np.argsort(own, kind="stable")
        blocks, starts = np.unique(own[order], return_index=True)
        parts = np.split(index[order], starts[1:])
        return [(position * BLOCKS + int(block), part) for block, part in zip(blocks, parts, strict=False)]

    @cached_property
    def _blocks(self) -> np.ndarray:
        """The block of the object's bounding box that each pixel of the surface lies in [N]."""
        surface = self.capture.scene.surface
        rows, columns = np.divmod(surface.pixels, surface.shape[1])
        return (_cell(rows) * _BLOCKS_ACROSS + _cell(columns)).astype(np.uint8)

    def batches(self, size: int, *, shuffle: bool = False, seed: int = 0, skip: int = 0) -> Iterator[Batch]:
        """Mini-batches for a training loop of one's own; with `shuffle`, drawn over all images without replacement.

        Args:
            size: samples per batch; the last one may be smaller.
            shuffle: mix images and pixels.
            seed: of the permutation.
            skip: number of batches at the beginning to leave out, for a loop that goes on where it stopped.
        """
        starts = np.cumsum([0, *self.counts])
        order = np.arange(starts[-1])
        if shuffle:
            order = np.random.default_rng(seed).permutation(order)
        for first in range(skip * size, len(order), size):
            chosen = np.sort(order[first : first + size])
            edges = np.searchsorted(chosen, starts)
            parts = [
                self.at(image, self.indices(position)[chosen[edges[position] : edges[position + 1]] - starts[position]])
                for position, image in enumerate(self.images)
                if edges[position] < edges[position + 1]
            ]
            yield _join(parts)


def _cell(coordinate: np.ndarray) -> np.ndarray:
    """Which of `_BLOCKS_ACROSS` equal stretches of the object each coordinate falls into."""
    low, span = coordinate.min(), np.ptp(coordinate) + 1
    return (coordinate - low) * _BLOCKS_ACROSS // span


def _join(parts: list[Batch]) -> Batch:
    """One batch of several; images with fewer lights get dark ones."""
    lights = max(part.points.wi.shape[-2] for part in parts)
    points = [_spread(part.points, len(part), lights) for part in parts]
    ambient = None
    if any(p.ambient is not None for p in points):
        shapes = [part.radiance.shape for part in parts]
        ambient = torch.cat(
            [
                p.irradiance.new_zeros(shape) if p.ambient is None else p.ambient.expand(shape)
                for p, shape in zip(points, shapes, strict=True)
            ]
        )
    seen = None
    if any(part.seen is not None for part in parts):
        seen = torch.cat([torch.ones_like(part.radiance) if part.seen is None else part.seen for part in parts])
    readouts = [[value.expand(len(part), -1) for value in part.readout] for part in parts]
    return Batch(
        points=Points(
            torch.cat([p.wi for p in points]),
            torch.cat([p.wo for p in points]),
            torch.cat([p.irradiance for p in points]),
            ambient,
        ),
        radiance=torch.cat([part.radiance for part in parts]),
        readout=Readout(*(torch.cat(column) for column in zip(*readouts, strict=True))),
        seen=seen,
        pixels=torch.cat([part.pixels for part in parts if part.pixels is not None]),
    )


def _spread(points: Points, count: int, lights: int) -> Points:
    """Points with every tensor at full size and dark lights added up to `lights`."""
    missing = lights - points.wi.shape[-2]
    wi = points.wi.expand(count, -1, -1)
    irradiance = points.irradiance.expand(count, -1, -1)
    if missing:
        wi = torch.cat([wi, points.wo[:, None].expand(count, missing, 3)], dim=1)
        irradiance = torch.cat([irradiance, irradiance.new_zeros(count, missing, irradiance.shape[-1])], dim=1)
    return Points(wi, points.wo.expand(count, -1), irradiance, points.ambient)
