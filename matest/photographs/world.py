"""What samples of photographs look like before they are turned into local frames: where errors of a calibration act."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import normalize, pad

from matest.directions import to_local
from matest.photographs.pixels import LitPixels
from matest.samples.batch import Batch
from matest.scene import Points, Scene, Surface
from matest.scene.visibility import unoccluded_fraction

# Degree of the polynomials that smooth fields over the object are made of: features down to a sixth of it.
_DEGREE = 6
# Number of polynomials of two coordinates up to that degree.
TERMS = (_DEGREE + 1) * (_DEGREE + 2) // 2
# Pixels that the mean of products of polynomials over the object is taken of.
_SPREAD_PIXELS = 4_000
# The power that cameras that are not sRGB's are taken to have.
_POWER = 2.2
# Mean square of a combination of polynomials that few or thin pixels cannot tell from nothing.
_INDISTINCT = 1e-6


class Places:
    """Where n samples lie, and what does not change with errors of the calibration, in the precision of the samples.

    Args:
        worlds: that they belong to.
        pixels: of each sample its place among the surface's N pixels [n].
        image: position of its image [n].
        like: gives precision and device.
    """

    def __init__(self, worlds: Worlds, pixels: Tensor, image: Tensor, like: Tensor) -> None:
        self._worlds = worlds
        self._like = like
        self.pixels = pixels
        self.image = image

    @cached_property
    def coordinates(self) -> Tensor:
        """In the image, pixels [n, 2]."""
        return self._worlds.grid.coordinates(self.pixels).to(self._like)

    @cached_property
    def polynomials(self) -> Tensor:
        """See `Grid.polynomials` [n, terms]."""
        return self._worlds.grid.polynomials(self.pixels).to(self._like)

    @cached_property
    def normal_slopes(self) -> Tensor:
        """Change of the normals per pixel along x and y [n, 3, 2]."""
        return self._worlds.grid.slopes(self._worlds.scene.surface.normals, self.pixels).to(self._like)

    @cached_property
    def white(self) -> Tensor:
        """Radiance of full scale [n, 1]."""
        photographs = self._worlds.photographs
        scale, exposures = photographs.encoding.scale, photographs.exposures
        of_image = torch.tensor([scale / exposures[image] for image in self._worlds.images], dtype=torch.float64)
        return of_image[self.image][:, None].to(self._like)


@dataclass(eq=False)
class World:
    """n samples of L lights in world coordinates. Errors of the calibration change what they act on.

    Attributes:
        places: where the samples lie.
        normals: unit normals [n, 3].
        toward: unit vectors to each light [n, L, 3].
        view: unit vectors to the viewer [n, 3].
        irradiance: of a surface facing each light [n, L, C].
        ambient: ambient radiance times the unoccluded fraction of the sky [n, C]; None: there is none.
        body: see `Displaced`; likewise `power`, `curve`, `offset`.
    """

    places: Places
    normals: Tensor
    toward: Tensor
    view: Tensor
    irradiance: Tensor
    ambient: Tensor | None
    body: Tensor | None = None
    power: Tensor | None = None
    curve: Tensor | None = None
    offset: Tensor | None = None

    def points(self) -> Points:
        """The samples in their local frames."""
        normals, toward = normalize(self.normals, dim=-1), normalize(self.toward, dim=-1)
        wi, wo = to_local(normals[:, None], toward, self.view[:, None])
        return Points(wi, wo[:, 0], self.irradiance, self.ambient)

    def scale_light(self, factor: Tensor) -> None:
        """Multiply all light by a factor [n, 1]."""
        self.irradiance = self.irradiance * factor[:, None]
        if self.ambient is not None:
            self.ambient = self.ambient * factor

    def scale_body(self, factor: Tensor) -> None:
        """Multiply the albedo of the body by a factor [n, 1]."""
        self.body = factor if self.body is None else self.body * factor


class Worlds:
    """Makes the world of batches.

    Args:
        samples: that the batches are of.
    """

    def __init__(self, samples: LitPixels) -> None:
        self.images = samples.images
        self.photographs = samples.photographs
        self.grid = Grid(samples.photographs.scene.surface)

    @property
    def scene(self) -> Scene:
        return self.photographs.scene

    @cached_property
    def slots(self) -> int:
        """L: the most lights that an image has, each as many times as it has nodes."""
        return max(self.scene.nodes(image) for image in self.images)

    @cached_property
    def sphere_radius(self) -> float | None:
        """Radius in pixels of a sphere that a distant camera sees; None: the surface is another."""
        surface = self.scene.surface
        if not surface.convex:
            return None
        x = self.grid.coordinates(torch.arange(len(surface)))[:, 0]
        return float((x - x.mean()).square().mean().sqrt() / surface.normals[:, 0].std(correction=0))

    @cached_property
    def _traced(self) -> np.ndarray:
        """Share of an even sky that each pixel of the surface sees [N]; NaN where nobody asked yet."""
        return np.full(len(self.scene.surface), np.nan, dtype=np.float32)

    def unoccluded(self, pixels: Tensor) -> Tensor | None:
        """Share of an even sky that some pixels of the surface see [n]; None: all of it."""
        if self.scene.unoccluded is not None:
            return torch.from_numpy(self.scene.unoccluded)[pixels]
        traced, index = self._traced, pixels.unique().numpy()
        if len(unknown := index[np.isnan(traced[index])]):
            shares = unoccluded_fraction(self.scene.surface, unknown)
            if shares is None:
                return None
            traced[unknown] = shares
        return torch.from_numpy(traced)[pixels]

    def departure(self, share: Tensor) -> Tensor:
        """By how much a decoded share of full scale differs if the transfer is not the stated one but the usual other:
        sRGB's where a power is stated, the power 2.2 where sRGB's is.
        """
        stated = self.photographs.encoding
        other = replace(stated, transfer=_POWER if stated.transfer == "srgb" else "srgb")
        decoded = stated.linear(other.encoded(share.double().numpy()))
        return torch.from_numpy(decoded).to(share) - share.clamp(min=0)

    def of(self, batch: Batch, image: Tensor, pixels: Tensor) -> World:
        """The world of a batch; of pixels beside its own under the same light where `pixels` [m n] says so.

        Args:
            batch: n samples.
            image: position of the image of each [n].
            pixels: of the samples, or of m neighbours of each.
        """
        surface, like = self.scene.surface, batch.radiance
        copies = len(pixels) // len(batch)
        points, image = batch.points, image.repeat(copies)
        irradiance = points.irradiance.expand(len(batch), -1, like.shape[1])
        # Lights that an image lacks are dark.
        irradiance = pad(irradiance, (0, 0, 0, self.slots - irradiance.shape[1]))
        ambient = None if points.ambient is None else points.ambient.expand_as(like).repeat(copies, 1)
        view = surface.toward_viewer(pixels).to(like).expand(len(pixels), 3)
        return World(
            places=Places(self, pixels, image, like),
            normals=surface.normals_as(like.dtype)[pixels],
            toward=self._toward(image, pixels, like),
            view=view,
            irradiance=irradiance.repeat(copies, 1, 1),
            ambient=ambient,
        )

    def _toward(self, image: Tensor, pixels: Tensor, like: Tensor) -> Tensor:
        """Unit vectors to the lights [n, L, 3]; those of lights that an image lacks are the normal."""
        surface = self.scene.surface
        normals, view = surface.normals_as(like.dtype)[pixels], surface.toward_viewer(pixels).to(like)
        view = view.expand(len(normals), 3)
        toward = normals[:, None].repeat(1, self.slots, 1)
        for position in image.unique().tolist():
            rows = (image == position).nonzero()[:, 0]
            slot = 0
            for light in self.scene.lights[self.images[position]]:
                places = None
                if light.near and surface.positions is not None:
                    places = surface.positions[pixels[rows]].to(like)
                nodes = light.to(like.dtype, "cpu").directions(places, normals[rows], view[rows])
                toward[rows, slot : slot + light.nodes] = nodes.expand(len(rows), -1, 3)
                slot += light.nodes
        return toward


class Grid:
    """The pixels of a surface as an image: their coordinates, and how normals and positions change across them.

    x points right and y down, in pixels.
    """

    def __init__(self, surface: Surface) -> None:
        self._surface = surface
        self.height, self.width = surface.shape

    @cached_property
    def _places(self) -> Tensor:
        """Index of the surface's pixel at every pixel of the image [H W], −1 on the background."""
        places = np.full(self.height * self.width, -1, dtype=np.int32)
        places[self._surface.pixels] = np.arange(len(self._surface), dtype=np.int32)
        return torch.from_numpy(places)

    def coordinates(self, pixels: Tensor) -> Tensor:
        """Of the centres of some pixels [n, 2]."""
        flat = torch.from_numpy(self._surface.pixels)[pixels]
        return torch.stack([flat % self.width, flat.div(self.width, rounding_mode="floor")], dim=1).double() + 0.5

    @cached_property
    def box(self) -> Tensor:
        """Least and greatest coordinates of the object [2, 2]."""
        rows, columns = np.divmod(self._surface.pixels, self.width)
        return torch.tensor([[columns.min(), rows.min()], [columns.max() + 1, rows.max() + 1]], dtype=torch.float64)

    def polynomials(self, pixels: Tensor) -> Tensor:
        """Polynomials of x and y, of mean square 1 over the object and uncorrelated there [n, TERMS].

        The first is 1, the others are 0 on average. The sum of the squares of a field's coefficients is thus its mean
        square over the object.
        """
        return self._products(pixels) @ self._orthonormal

    @cached_property
    def _orthonormal(self) -> Tensor:
        """The polynomials in products of Legendre polynomials [TERMS, TERMS], triangular."""
        count = len(self._surface)
        products = self._products(torch.linspace(0, count - 1, min(count, _SPREAD_PIXELS)).long())
        gram = products.T @ products / len(products)
        lower = torch.linalg.cholesky(gram + _INDISTINCT * torch.eye(TERMS, dtype=torch.float64))
        return torch.linalg.inv(lower).T

    def _products(self, pixels: Tensor) -> Tensor:
        """Products of Legendre polynomials of x and y over the object's box, the first of them 1 [n, TERMS]."""
        low, high = self.box
        across = 2 * (self.coordinates(pixels) - low) / (high - low) - 1
        powers = [torch.ones_like(across), across]
        for degree in range(2, _DEGREE + 1):
            powers.append(((2 * degree - 1) * across * powers[-1] - (degree - 1) * powers[-2]) / degree)
        scaled = [math.sqrt(2 * degree + 1) * power for degree, power in enumerate(powers)]
        products = [scaled[i][:, 0] * scaled[j][:, 1] for i in range(_DEGREE + 1) for j in range(_DEGREE + 1 - i)]
        return torch.stack(products, dim=1)

    def around(self, pixels: Tensor, steps: Sequence[int] = (1,)) -> tuple[Tensor, Tensor]:
        """The pixels of a square around each of some pixels, row by row, its middle left out.

        Args:
            pixels: of the surface [n].
            steps: from its middle to its rows and columns on either side.

        Returns:
            The others [k, n], and which of these are on the object; one that is not is given as the pixel itself.
        """
        x, y = (self.coordinates(pixels) - 0.5).long().T
        line = [*(-step for step in reversed(steps)), 0, *steps]
        offsets = torch.tensor([(dx, dy) for dy in line for dx in line if dx or dy])
        x, y = x + offsets[:, :1], y + offsets[:, 1:]
        inside = (x >= 0) & (x < self.width) & (y >= 0) & (y < self.height)
        beside = self._places[torch.where(inside, y * self.width + x, 0)].long()
        inside &= beside >= 0
        return torch.where(inside, beside, pixels), inside

    def slopes(self, values: Tensor, pixels: Tensor) -> Tensor:
        """Change per pixel along x and y at some pixels [n, k, 2] of values [N, k] of the surface."""
        _, up, _, left, right, _, down, _ = self.around(pixels)[0]
        parts = []
        for before, after in ((left, right), (up, down)):
            steps = (before != pixels).int() + (after != pixels).int()
            parts.append((values[after] - values[before]) / steps.clamp(min=1)[:, None])
        return torch.stack(parts, dim=-1)
