"""Errors of the calibration of photographs: one class a kind, with what it does to the world of some samples."""

from __future__ import annotations

import math
from collections.abc import Hashable
from typing import Protocol

import torch
from torch import Tensor
from torch.nn.functional import normalize

from matest.errors import InputError
from matest.photographs.world import TERMS, World, Worlds
from matest.samples.calibration import Family
from matest.samples.groups import Groups

# In which order lights have their errors.
_BY_LIGHT = "light by light in the order of the images, one that several share once"
# Squared cosine from the viewer to a normal on the outline, at least: its derivative stays finite.
_GRAZING = 1e-4


class Nuisance(Protocol):
    """One kind of error."""

    def family(self, worlds: Worlds, groups: Groups) -> Family:
        """Its unknowns."""

    def act(self, world: World, values: Tensor, worlds: Worlds) -> None:
        """Change the world of samples by errors of these values [n, q], differentiably."""


def _common(groups: Groups, count: int) -> Tensor:
    """Places of unknowns that all samples depend on [G, count]."""
    return torch.arange(count).expand(len(groups.image), -1)


class Direction:
    """Each light's direction, along two directions across it."""

    def family(self, worlds: Worlds, groups: Groups) -> Family:
        lights = _light_numbers(worlds)[groups.image]
        places = torch.stack([2 * lights, 2 * lights + 1], dim=-1).flatten(1)
        doc = (
            f"tilt of the direction d to each light, two angles, {_BY_LIGHT}: d moves along a = y × d (z × d where d "
            "is within 26° of ± y) and along d × a"
        )
        return Family("direction", "rad", doc, int(places.max()) + 1, places, assumed=0.01)

    def act(self, world: World, values: Tensor, worlds: Worlds) -> None:
        first, second = _across(world.toward)
        angles = values.unflatten(1, (worlds.slots, 2))
        world.toward = world.toward + angles[..., :1] * first + angles[..., 1:] * second


class Rotation:
    """All lights together, about the world's three axes."""

    def family(self, worlds: Worlds, groups: Groups) -> Family:  # noqa: ARG002
        return Family("rotation", "rad", "rotation of all lights about x, y and z", 3, _common(groups, 3), assumed=0.02)

    def act(self, world: World, values: Tensor, worlds: Worlds) -> None:  # noqa: ARG002
        world.toward = world.toward + torch.linalg.cross(values[:, None].expand_as(world.toward), world.toward)


class Intensity:
    """The power of each light."""

    def family(self, worlds: Worlds, groups: Groups) -> Family:
        places = _light_numbers(worlds)[groups.image]
        doc = f"power of each light beyond what is stated, relative to that, {_BY_LIGHT}"
        return Family("intensity", "1", doc, int(places.max()) + 1, places, assumed=0.03)

    def act(self, world: World, values: Tensor, worlds: Worlds) -> None:  # noqa: ARG002
        world.irradiance = world.irradiance * (1 + values)[..., None]


class Exposure:
    """The exposure of each image."""

    def family(self, worlds: Worlds, groups: Groups) -> Family:
        places = groups.image[:, None]
        return Family(
            "exposure",
            "1",
            "exposure of each image beyond what is stated, relative to that",
            len(worlds.images),
            places,
            assumed=0.03,
        )

    def act(self, world: World, values: Tensor, worlds: Worlds) -> None:  # noqa: ARG002
        world.scale_light(1 + values)


class Scale:
    """The strength of all lights together."""

    def family(self, worlds: Worlds, groups: Groups) -> Family:  # noqa: ARG002
        return Family(
            "scale",
            "1",
            "strength of all lights beyond what is stated, relative to that",
            1,
            _common(groups, 1),
            assumed=0.1,
        )

    def act(self, world: World, values: Tensor, worlds: Worlds) -> None:  # noqa: ARG002
        world.scale_light(1 + values)


class Ambient:
    """Even light from the whole sky in every image, relative to the key light's irradiance."""

    def family(self, worlds: Worlds, groups: Groups) -> Family:  # noqa: ARG002
        doc = "irradiance of an even sky beyond what is stated, relative to that of the key light"
        return Family("ambient", "1", doc, 1, _common(groups, 1), assumed=0.05)

    def act(self, world: World, values: Tensor, worlds: Worlds) -> None:
        sky = values * (key_light(worlds) / math.pi).to(values)
        seen = worlds.unoccluded(world.places.pixels)
        if seen is not None:
            sky = sky * seen.to(values)[:, None]
        world.ambient = sky if world.ambient is None else world.ambient + sky


class Black:
    """The black level of each channel, a fraction of full scale."""

    def family(self, worlds: Worlds, groups: Groups) -> Family:
        channels = worlds.photographs.channels
        doc = "black level of each channel beyond what is stated, as a fraction of full scale"
        return Family("black", "1", doc, channels, _common(groups, channels), assumed=0.02)

    def act(self, world: World, values: Tensor, worlds: Worlds) -> None:  # noqa: ARG002
        world.offset = values * world.places.white


class Vignetting:
    """Loss of light toward the image's corners, with the square of the distance from its middle."""

    def family(self, worlds: Worlds, groups: Groups) -> Family:  # noqa: ARG002
        return Family(
            "vignetting",
            "1",
            "share of the light that is lost at the image's corner",
            1,
            _common(groups, 1),
            assumed=0.2,
        )

    def act(self, world: World, values: Tensor, worlds: Worlds) -> None:
        middle = torch.tensor([worlds.grid.width, worlds.grid.height], dtype=torch.float64) / 2
        distance = (world.places.coordinates - middle.to(values)) / float(middle.norm())
        world.scale_light(1 - values * distance.square().sum(1, keepdim=True))


class Transfer:
    """The exponent from stored to linear values."""

    def family(self, worlds: Worlds, groups: Groups) -> Family:  # noqa: ARG002
        return Family(
            "transfer",
            "1",
            "exponent of the transfer beyond what is stated, relative to that",
            1,
            _common(groups, 1),
            assumed=0.1,
        )

    def act(self, world: World, values: Tensor, worlds: Worlds) -> None:  # noqa: ARG002
        # Decoded by an exponent too large by (1 + t), radiance is the true one to that power.
        world.power = values


class Curve:
    """The shape of the transfer: sRGB's, or a power."""

    def family(self, worlds: Worlds, groups: Groups) -> Family:
        stated = worlds.photographs.encoding.transfer
        doc = f"share of the way from the transfer that is stated to {'the power 2.2' if stated == 'srgb' else 'sRGB'}"
        return Family("curve", "1", doc, 1, _common(groups, 1), assumed=0.5)

    def act(self, world: World, values: Tensor, worlds: Worlds) -> None:  # noqa: ARG002
        world.curve = values


class Shift:
    """The object's place in the image."""

    def family(self, worlds: Worlds, groups: Groups) -> Family:  # noqa: ARG002
        return Family(
            "shift", "px", "shift of the object in the images, right and down", 2, _common(groups, 2), assumed=2.0
        )

    def act(self, world: World, values: Tensor, worlds: Worlds) -> None:
        if worlds.sphere_radius is not None:
            right, up = values[:, 0] / worlds.sphere_radius, -values[:, 1] / worlds.sphere_radius
            world.normals = _on_sphere(world.normals[:, 0] - right, world.normals[:, 1] - up)
            return
        world.normals = world.normals - (world.places.normal_slopes * values[:, None]).sum(-1)


class Radius:
    """The size of the object's outline."""

    def family(self, worlds: Worlds, groups: Groups) -> Family:  # noqa: ARG002
        return Family(
            "radius", "px", "radius of the object's outline beyond what is stated", 1, _common(groups, 1), assumed=2.0
        )

    def act(self, world: World, values: Tensor, worlds: Worlds) -> None:
        if worlds.sphere_radius is not None:
            shrunk = world.normals[:, :2] / (1 + values / worlds.sphere_radius)
            world.normals = _on_sphere(*shrunk.unbind(-1))
            return
        low, high = worlds.grid.box
        offset = world.places.coordinates - ((low + high) / 2).to(values)
        growth = (world.places.normal_slopes * offset[:, None]).sum(-1) / (float((high - low).max()) / 2)
        world.normals = world.normals - values * growth


class Tilt:
    """The object's turn about the world's three axes, through the middle of what is seen."""

    def family(self, worlds: Worlds, groups: Groups) -> Family:  # noqa: ARG002
        return Family("tilt", "rad", "turn of the object about x, y and z", 3, _common(groups, 3), assumed=0.02)

    def act(self, world: World, values: Tensor, worlds: Worlds) -> None:
        surface, grid = worlds.scene.surface, worlds.grid
        turned = torch.linalg.cross(values, world.normals)
        if surface.positions is not None:
            pixels = world.places.pixels
            middle = surface.positions.mean(0)
            moved = torch.linalg.cross(values.double(), surface.positions[pixels].double() - middle)
            # A point that moves by m is seen v pixels further: m = v · (slopes of the positions) + a move along sight.
            frame = torch.cat([grid.slopes(surface.positions, pixels).double(), world.view.double()[..., None]], dim=-1)
            steps = torch.linalg.solve(frame, moved[..., None])[:, :2, 0]
            turned = turned - (world.places.normal_slopes * steps[:, None].to(values)).sum(-1)
        world.normals = world.normals + turned


class Normals:
    """A smooth field of errors of the normals: two angles, polynomials over the object."""

    def family(self, worlds: Worlds, groups: Groups) -> Family:  # noqa: ARG002
        count = 2 * TERMS
        doc = (
            "coefficients of smooth errors of the normals, all along one direction across them, then all along another"
        )
        return Family("normals", "rad", doc, count, _common(groups, count), assumed=0.02, spread=TERMS**-0.5)

    def act(self, world: World, values: Tensor, worlds: Worlds) -> None:  # noqa: ARG002
        basis = world.places.polynomials
        first, second = _across(world.normals)
        along = (values.unflatten(1, (2, -1)) * basis[:, None]).sum(-1)
        world.normals = world.normals + along[:, :1] * first + along[:, 1:] * second


class NormalNoise:
    """Errors of the normal of each pixel by itself, along two directions across it."""

    def family(self, worlds: Worlds, groups: Groups) -> Family:  # noqa: ARG002
        doc = "errors of the normal of each pixel, along two directions across it"
        return Family("normal_noise", "rad", doc, 2, _common(groups, 2), assumed=0.02, of_pixels=True)

    def act(self, world: World, values: Tensor, worlds: Worlds) -> None:  # noqa: ARG002
        first, second = _across(world.normals)
        world.normals = world.normals + values[:, :1] * first + values[:, 1:] * second


class AlbedoNoise:
    """The albedo of each pixel's body by itself: the logarithm of a factor."""

    def family(self, worlds: Worlds, groups: Groups) -> Family:  # noqa: ARG002
        doc = "logarithm of the albedo of each pixel"
        return Family("albedo_noise", "1", doc, 1, _common(groups, 1), assumed=0.1, of_pixels=True)

    def act(self, world: World, values: Tensor, worlds: Worlds) -> None:  # noqa: ARG002
        world.scale_body(values.exp())


class AlbedoField:
    """A smooth field of the body's albedo: the logarithm of a factor, of mean 0 over the object."""

    def family(self, worlds: Worlds, groups: Groups) -> Family:  # noqa: ARG002
        count = TERMS - 1
        doc = "coefficients of a smooth logarithm of the albedo over the object"
        return Family("albedo_field", "1", doc, count, _common(groups, count), assumed=0.1, spread=count**-0.5)

    def act(self, world: World, values: Tensor, worlds: Worlds) -> None:  # noqa: ARG002
        world.scale_body((values * world.places.polynomials[:, 1:]).sum(1, keepdim=True).exp())


class Blur:
    """The blur of the images by a Gaussian; its unknown is the variance."""

    def family(self, worlds: Worlds, groups: Groups) -> Family:  # noqa: ARG002
        return Family("blur", "px²", "variance of the images' blur", 1, _common(groups, 1), assumed=1.0)

    def act(self, world: World, values: Tensor, worlds: Worlds) -> None:
        """It acts on sums over pixels, not on their world."""


# In the order in which they act: on the object, on the lights, on the sensor.
NUISANCES: dict[str, Nuisance] = {
    "shift": Shift(),
    "radius": Radius(),
    "tilt": Tilt(),
    "normals": Normals(),
    "normal_noise": NormalNoise(),
    "albedo_field": AlbedoField(),
    "albedo_noise": AlbedoNoise(),
    "direction": Direction(),
    "rotation": Rotation(),
    "intensity": Intensity(),
    "ambient": Ambient(),
    "exposure": Exposure(),
    "scale": Scale(),
    "vignetting": Vignetting(),
    "transfer": Transfer(),
    "curve": Curve(),
    "black": Black(),
    "blur": Blur(),
}


def key_light(worlds: Worlds) -> Tensor:
    """Irradiance of the brightest light of an image at the object's middle, the mean over images [C]."""
    surface, brightest = worlds.scene.surface, []
    middle = None if surface.positions is None else surface.positions.mean(0, keepdim=True)
    for image in worlds.images:
        lights = [light.at(middle)[1][0] for light in worlds.scene.lights[image]]
        if lights:
            brightest.append(max(lights, key=lambda power: float(power.mean())))
    if not brightest:
        raise InputError("ambient light is stated relative to the lights of the images, and these have none.")
    return torch.stack([light.double() for light in brightest]).mean(0)


def _light_numbers(worlds: Worlds) -> Tensor:
    """The number of every light's nodes in every image [I, L]; lights that are stated to be the same have one."""
    numbers: dict[Hashable, int] = {}
    rows = []
    for image in worlds.images:
        lights = worlds.scene.lights[image]
        row = [number for light in lights for number in [numbers.setdefault(light.key, len(numbers))] * light.nodes]
        # Lights that an image lacks give nothing: whose number they have does not matter.
        rows.append(row + [0] * (worlds.slots - len(row)))
    return torch.tensor(rows)


def _on_sphere(x: Tensor, y: Tensor) -> Tensor:
    """Unit normals [n, 3] of a sphere that a distant camera sees, by two components; those beyond its outline on it."""
    return torch.stack([x, y, (1 - x.square() - y.square()).clamp(min=_GRAZING).sqrt()], dim=-1)


def _across(vectors: Tensor) -> tuple[Tensor, Tensor]:
    """Two unit vectors across each of some unit vectors [..., 3]; the first has no y, or no z near the y axis."""
    near_y = vectors[..., 1:2].abs() > 0.9
    axis = torch.where(near_y, vectors.new_tensor([0.0, 0.0, 1.0]), vectors.new_tensor([0.0, 1.0, 0.0]))
    first = normalize(torch.linalg.cross(axis, vectors), dim=-1)
    return first, torch.linalg.cross(vectors, first)
