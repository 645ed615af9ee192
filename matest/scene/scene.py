"""A scene: one visible surface under the lights of each image."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from matest.errors import InputError
from matest.parameters import Role
from matest.scene.bits import Bits
from matest.scene.environment import EnvironmentLight
from matest.scene.lights import Light
from matest.scene.points import Points, illuminate
from matest.scene.surface import Surface
from matest.scene.visibility import cast_shadows, grid_of_large, shadow_edges, unoccluded_fraction
from matest.workers import in_threads


@dataclass(frozen=True)
class Scene:
    """The geometry and light of K images of one surface.

    Attributes:
        surface: the object's pixels.
        lights: the lights of each image.
        ambient: ambient radiance of each image, [K, C].
        shadows: per image and node of a light, the pixels where it is blocked; None where nothing can block it.
        shadow_edge: per image, pixels on the edge of a cast shadow or in a penumbra; None likewise.
        unoccluded: share of an even sky that each pixel sees, [N]; None where it is 1, or there is no ambient light.
        wavelength: of each channel in µm, [C], if known.
    """

    surface: Surface
    lights: tuple[tuple[Light, ...], ...]
    ambient: Tensor
    shadows: tuple[tuple[Bits, ...] | None, ...] = ()
    shadow_edge: tuple[Bits | None, ...] = ()
    unoccluded: np.ndarray | None = None
    wavelength: Tensor | None = None

    @property
    def channels(self) -> int:
        return self.ambient.shape[1]

    def __len__(self) -> int:
        return len(self.lights)

    @property
    def surrounded(self) -> bool:
        """Whether any light comes from all around."""
        return any(isinstance(light, EnvironmentLight) for lights in self.lights for light in lights)

    def nodes(self, image: int) -> int:
        """How many directions of light an image is shaded with."""
        return sum(light.nodes for light in self.lights[image])

    def optics(self, quantity: Role) -> Tensor | None:
        """The stated wavelength of the channels (µm) or solid angle of the lights (sr); None: not stated.

        Raises:
            InputError: lights of different solid angles, or from all around.
        """
        if quantity is Role.WAVELENGTH:
            return self.wavelength
        if self.surrounded:
            raise InputError(
                "a mirror-like reflection is rendered under a map of light, but neither estimated nor predicted there: "
                "leave it out of the model, or set --fix solid_angle=SR."
            )
        angles = {light.solid_angle for lights in self.lights for light in lights}
        if len(angles) > 1:
            stated = ", ".join("none" if angle is None else f"{angle:g}" for angle in sorted(angles, key=str))
            raise InputError(
                f"a mirror-like reflection needs one solid_angle for all lights, but they have {stated} sr: give them "
                "one, or set it with --fix solid_angle=SR."
            )
        angle = next(iter(angles), None)
        return None if angle is None else torch.tensor(angle, dtype=torch.float64)

    def with_shadows(self) -> Scene:
        """The same scene with its cast shadows traced, and the sky that each pixel sees if there is ambient light."""
        grid = grid_of_large(self.surface)

        def trace(lights: tuple[Light, ...]) -> tuple[tuple[Bits, ...] | None, Bits | None]:
            shadows, edges = [], np.zeros(len(self.surface), dtype=bool)
            for light in lights:
                some, every = np.zeros(len(self.surface), dtype=bool), np.ones(len(self.surface), dtype=bool)
                for node in range(light.nodes):
                    shadow = cast_shadows(self.surface, light, grid, node)
                    if shadow is None:
                        return None, None
                    if light.edged(node):
                        edges |= shadow_edges(self.surface, shadow)
                    shadows.append(Bits.of(shadow))
                    some |= shadow
                    every &= shadow
                # Some points that stand for a near light are hidden and others are not: how many is known to a step.
                if light.near:
                    edges |= some & ~every
            return (tuple(shadows), Bits.of(edges)) if shadows else (None, None)

        shadows, edges = zip(*in_threads(trace, self.lights), strict=True)
        return dataclasses.replace(
            self,
            shadows=shadows,
            shadow_edge=edges,
            unoccluded=unoccluded_fraction(self.surface) if bool((self.ambient > 0).any()) else None,
        )

    def take(self, selection: np.ndarray) -> Scene:
        """The same scene restricted to some of its surface's pixels (boolean [N]), in the shadows of all of it."""

        def of_pixels(bits: Bits) -> Bits:
            return Bits.of(np.asarray(bits)[selection])

        return dataclasses.replace(
            self,
            surface=self.surface.take(selection),
            shadows=tuple(None if bits is None else tuple(map(of_pixels, bits)) for bits in self.shadows),
            shadow_edge=tuple(None if bits is None else of_pixels(bits) for bits in self.shadow_edge),
            unoccluded=None if self.unoccluded is None else self.unoccluded[selection],
        )

    def near_positions(self, image: int, index: Tensor | slice = slice(None)) -> Tensor | None:
        """Positions of some pixels [n, 3], where a light of the image is near: a distant one needs none."""
        near = any(light.near for light in self.lights[image])
        return self.surface.positions[index] if near and self.surface.positions is not None else None

    def points(
        self,
        image: int,
        index: Tensor | slice = slice(None),
        *,
        dtype: torch.dtype = torch.float32,
        device: torch.device | str = "cpu",
    ) -> Points:
        """The points of one image at some of the surface's pixels (indices into its N pixels).

        Differentiable in lights, ambient radiance, normals and positions that require gradients; a perspective
        camera's viewing directions follow the positions. Shadows stay as they were traced.
        """
        surface, ambient = self.surface, self.ambient[image]
        sky = None
        if ambient.requires_grad or bool((ambient > 0).any()):
            sky = ambient.to(device, dtype)[None]
            if self.unoccluded is not None:
                sky = sky * torch.from_numpy(self.unoccluded)[index].to(device, dtype)[:, None]
        shadows = self.shadows[image] if self.shadows else None
        blocked = None
        if shadows is not None:
            blocked = torch.stack([torch.from_numpy(shadow[index]) for shadow in shadows]).to(device)
        positions = self.near_positions(image, index)
        return illuminate(
            surface.normals_as(dtype)[index].to(device),
            surface.toward_viewer(index).to(device, dtype),
            [light.to(dtype, device) for light in self.lights[image]],
            positions=None if positions is None else positions.to(device, dtype),
            ambient=sky,
            blocked=blocked,
        )
