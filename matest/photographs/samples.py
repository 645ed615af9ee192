"""Photographs as samples: what `Capture.samples` gives."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
import torch
from torch import Tensor

from matest.parameters import Role
from matest.photographs.averaging import slope_variance
from matest.photographs.calibration import PhotographCalibration
from matest.photographs.noise import Noise, quantisation
from matest.photographs.nuisances import NUISANCES
from matest.photographs.photometry import Encoding
from matest.photographs.pilot import pilot
from matest.photographs.pixels import BLOCKS, LitPixels
from matest.photographs.readings import better_readings
from matest.photographs.texel_tiles import TexelTiles, texel_tile
from matest.photographs.tiles import ImageTiles
from matest.samples import Batch, Groups, Tiles
from matest.samples.account import Account
from matest.samples.batch import join
from matest.samples.reading import Reading
from matest.samples.residual_scale import NOISE_ALONE, ResidualScale
from matest.samples.texels import TexelTile
from matest.scene import Surface


class PhotographSamples(LitPixels):
    """Samples of some photographs: every usable pixel of each, as `LitPixels` chooses them."""

    def __repr__(self) -> str:
        values = len(self) * self.channels
        return f"PhotographSamples({values} values, {self.channels} channels, {len(self.images)} photographs)"

    @property
    def channels(self) -> int:
        return self.photographs.channels

    @property
    def relative(self) -> bool:
        return self.photographs.relative

    @property
    def noise_stated(self) -> bool:
        return self.photographs.noise_stated

    @cached_property
    def groups(self) -> Groups:
        """Blocks of pixels, and the position in `images` of the image that each belongs to."""
        scene, light = self.photographs.scene, None
        if self._one_light_each:
            numbers: dict[Hashable, int] = {}
            keys = [scene.lights[image][0].key for image in self.images]
            light = torch.tensor([numbers.setdefault(key, len(numbers)) for key in keys])
        return Groups(torch.arange(len(self.images)).repeat_interleave(BLOCKS), light)

    @property
    def _one_light_each(self) -> bool:
        """Whether every photograph has one light, which comes from one direction."""
        scene = self.photographs.scene
        around = scene.surrounded or bool((scene.ambient > 0).any())
        return not around and all(len(lights) == 1 for lights in scene.lights)

    @property
    def calibration_names(self) -> list[str]:
        """The kinds of errors of a calibration that have an effect on these photographs."""
        surface, scene = self.photographs.scene.surface, self.photographs.scene
        # A sphere looks the same from all sides.
        idle = {"tilt"} if surface.convex else set()
        if self.photographs.encoding.transfer in ("linear", 1.0):
            idle.add("curve")
        if not any(scene.lights[image] for image in self.images):
            idle |= {"direction", "rotation", "intensity", "ambient"}
        # A map of light is turned and scaled as a whole.
        if scene.surrounded:
            idle |= {"direction", "intensity"}
        return [name for name in NUISANCES if name not in idle]

    def calibration(self, names: Sequence[str]) -> PhotographCalibration:
        """The errors of the calibration of these kinds (`NUISANCES`), and what they do to the samples."""
        key = tuple(names)
        if key not in self._calibrations:
            self._calibrations[key] = PhotographCalibration(self, self.groups, key)
        return self._calibrations[key]

    @cached_property
    def _calibrations(self) -> dict[tuple[str, ...], PhotographCalibration]:
        """Those that were asked for, which remember what they have worked out."""
        return {}

    def parts(self) -> dict[Any, object]:
        return super().parts() | self._calibrations

    def part(self, name: Any) -> object:
        return self.calibration(name) if isinstance(name, tuple) else super().part(name)

    def __getstate__(self) -> dict[str, Any]:
        return {name: part for name, part in self.__dict__.items() if name != "_calibrations"}

    @property
    def texels(self) -> int:
        return len(self.photographs.scene.surface)

    @property
    def directions(self) -> int:
        """See `CalibratedSamples`."""
        return max((self.photographs.scene.nodes(image) for image in self.images), default=0)

    def texel_tiles(self) -> TexelTiles:
        """See `CalibratedSamples`."""
        return TexelTiles(self)

    def some_texels(self, count: int, seed: int) -> TexelTile:
        """See `CalibratedSamples`."""
        total = len(self.photographs.scene.surface)
        return texel_tile(self, np.sort(np.random.default_rng(seed).permutation(total)[:count]))

    def of_pixels(self, count: int, seed: int) -> tuple[Batch, float]:
        """All samples at about `count` random pixels of the surface, and by how much there are more of them.

        They lie in the memory of the processor, where errors of the calibration are computed.
        """
        total, here = len(self.photographs.scene.surface), copy(self)
        here.device = "cpu"
        some = np.sort(np.random.default_rng(seed).permutation(total)[:count])
        parts = [here.at(position, some[self.usable_at(position, some)]) for position in range(len(self.images))]
        return join([part for part in parts if len(part)]), total / len(some)

    def better_readings(self) -> list[Reading]:
        """What may have been meant where it explains the photographs far better than what is stated."""
        return [
            Reading(
                one.cause, one.finding, one.instead, one.mend,
                PhotographSamples(one.photographs, self.images, self.dtype, self.device, self.redundancy), one.order,
            )
            for one in better_readings(self.photographs)
        ]  # fmt: skip

    def optics(self, quantity: Role) -> Tensor | None:
        return self.photographs.scene.optics(quantity)

    @cached_property
    def account(self) -> Account:
        """Facts about these samples for tables and reports."""
        photographs, scene = self.photographs, self.photographs.scene
        encoding = photographs.encoding
        sky = bool((scene.ambient > 0).any())
        return Account(
            names=photographs.names,
            notes=photographs.notes,
            images=self.images,
            counts=self.counts,
            skipped=self.skipped,
            redundancy=self.redundancy,
            pixels=scene.surface.shape[0] * scene.surface.shape[1],
            coverage=scene.surface.coverage,
            one_light_each=self._one_light_each,
            slope_variance=slope_variance(scene.surface),
            geometry=[*_unneeded_shadows(scene.surface), *([] if sky else ["ambient light: there is none"])],
            noise="" if photographs.noise_stated else _estimated(photographs.noise),
            codes="" if encoding.step == 1 else _stretched(encoding, photographs.stored[0].dtype),
            clipping="" if photographs.clipping is None else photographs.clipping.sentence,
        )

    def pilot(self, count: int, seed: int) -> list[Batch]:
        """About `count` samples, spread evenly over images and half angles; one batch, and one group, per image."""
        return pilot(self, count, seed)

    def tiles(self, residual_scale: ResidualScale = NOISE_ALONE, *, merge: bool = True) -> Tiles:
        """All samples, a few images at a time; with `merge`, a few replace the pixels of every smooth square.

        Outliers are judged by the `residual_scale`.
        """
        return ImageTiles(self, residual_scale, merge=merge)

    def batches(self, size: int, *, shuffle: bool = False, seed: int = 0, skip: int = 0) -> Iterator[Batch]:
        """Mini-batches for a training loop; with `shuffle`, drawn over all images without replacement.

        Args:
            size: samples per batch; the last one may be smaller.
            shuffle: mix images and pixels.
            seed: of the permutation.
            skip: number of first batches to leave out, for a loop that was interrupted after so many.
        """
        starts = np.cumsum([0, *self.counts])
        order = np.arange(starts[-1])
        if shuffle:
            order = np.random.default_rng(seed).permutation(order)
        for first in range(skip * size, len(order), size):
            selection = np.sort(order[first : first + size])
            edges = np.searchsorted(selection, starts)
            by_image = [
                (position, selection[edges[position] : edges[position + 1]] - starts[position])
                for position in range(len(self.images))
                if edges[position] < edges[position + 1]
            ]
            batch = join([self.at(position, self.indices(position)[some]) for position, some in by_image])
            # Tiles have a channel in a row; a training loop may want to view the values of a sample as one.
            yield replace(batch, radiance=batch.radiance.contiguous())


def _estimated(noise: Noise) -> str:
    """What was estimated of the noise, as a sentence."""
    read, gain = (
        f"{value:.2g}" + (f" ± {std:.1g}" if std else "")
        for value, std in ((noise.read, noise.read_std), (noise.gain, noise.gain_std))
    )
    return f"Noise was estimated from the images: read {read}, gain {gain} of full scale."


def _stretched(encoding: Encoding, codes: np.dtype) -> str:
    """How far apart stored codes are, and what that does to the noise, as a sentence."""
    rounding = quantisation(encoding, codes)
    return (
        f"Stored codes come in steps of {encoding.step:.3g}: the read noise includes their rounding, "
        f"{rounding:.2g} of full scale."
    )


def _unneeded_shadows(surface: Surface) -> list[str]:
    """Why no shadow rays were cast, as a clause; nothing where they were."""
    if surface.mesh is not None and surface.mesh.convex:
        return ["shadow rays: the mesh is convex and cannot shadow itself"]
    if surface.convex:
        return ["shadow rays: a sphere cannot shadow itself"]
    return [] if surface.mesh is not None else ["shadow rays: no mesh, cast shadows are unknown"]
