"""Captures that are read wrongly in one way, and what is found to explain them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.nn.functional import normalize

from matest.brdf import Brdf, CookTorrance, OrenNayar
from matest.photographs.photographs import Photographs
from matest.photographs.photometry import Encoding
from matest.photographs.readings import better_readings
from tests.captures import directional, point
from tests.simulated import Studio

# No mirror image of them is made of the same lights.
DIRECTIONS = (
    (0.1, 0.35, 0.93), (0.7, 0.2, 0.68), (-0.6, 0.35, 0.72), (0.35, 0.75, 0.55), (-0.35, -0.6, 0.72),
    (0.5, -0.3, 0.81), (-0.15, 0.05, 0.98),
)  # fmt: skip
STUDIO = Studio(size=48, lights=tuple((directional(d, 3.0),) for d in DIRECTIONS))
VIEW = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
MATTE = OrenNayar(0.7, 0.5)
GLOSSY = CookTorrance(0.3, 0.8, 0.2, f0=0.04)


def photographs(material: Brdf = MATTE, studio: Studio = STUDIO) -> Photographs:
    return studio.photograph(material, seed=1).photographs


def of_normal_map(right: Photographs, change: Callable[[Tensor], Tensor]) -> Photographs:
    """The photographs with a normal map that has these normals for the right ones."""
    surface = replace(right.scene.surface, convex=False, normals=change(right.scene.surface.normals))
    return replace(right, scene=replace(right.scene, surface=surface))


def under(right: Photographs, change: Callable[[Tensor], Tensor]) -> Photographs:
    """The photographs as stated to be under lights that stand elsewhere."""
    lights = tuple((replace(light, direction=change(light.direction)),) for (light,) in right.scene.lights)
    return replace(right, scene=replace(right.scene, lights=lights))


def stated_in(right: Photographs, order: list[int]) -> Photographs:
    """The photographs, each stated to be under the light of another."""
    lights = tuple(right.scene.lights[number] for number in order)
    return replace(right, scene=replace(right.scene, lights=lights))


def causes(stated: Photographs) -> set[str]:
    return {reading.cause for reading in better_readings(stated)}


def flipped(axis: int) -> Callable[[Tensor], Tensor]:
    def change(vectors: Tensor) -> Tensor:
        sign = torch.ones(3, dtype=vectors.dtype)
        sign[axis] = -1
        return vectors * sign

    return change


@pytest.mark.parametrize("material", [MATTE, GLOSSY])
@pytest.mark.parametrize(("axis", "side"), [(0, "x left"), (1, "y down")])
def test_a_normal_map_with_an_axis_the_wrong_way_looks_like_lights_with_it(
    axis: int, side: str, material: Brdf
) -> None:
    found = causes(of_normal_map(photographs(material), flipped(axis)))
    assert found == {f"normals {side}", f"lights {side}"}


def test_normals_that_were_stored_from_0_to_1_are_read_again() -> None:
    stated = of_normal_map(photographs(), lambda normals: normalize(normals + 1, dim=1))
    (found,) = better_readings(stated)
    assert found.cause == "normals 0 to 1"
    surface = found.photographs.scene.surface
    right = of_normal_map(photographs(), lambda normals: normals).scene.surface.normals
    assert torch.allclose(surface.normals[~surface.rim], right[~surface.rim], atol=1e-6)


@pytest.mark.parametrize(
    ("cause", "change"),
    [
        ("lights x left", flipped(0)),
        ("lights y down", flipped(1)),
        ("lights point away", torch.neg),
        ("half vectors for lights", lambda light: normalize(light + VIEW, dim=0)),
        ("reflections for lights", lambda light: 2 * (light @ VIEW) * light - VIEW),
    ],
)
def test_lights_that_stand_where_they_are_not_said_to_stand(cause: str, change: Callable[[Tensor], Tensor]) -> None:
    for material in (MATTE, GLOSSY):
        assert causes(under(photographs(material), change)) == {cause}


@pytest.mark.parametrize(
    ("stated", "cause"),
    [
        ([1, 2, 3, 4, 5, 6, 0], "lights shifted by one"),
        ([6, 0, 1, 2, 3, 4, 5], "lights shifted by one"),
        ([2, 3, 4, 5, 6, 0, 1], "lights shifted by 2"),
        ([6, 5, 4, 3, 2, 1, 0], "lights in reverse"),
        ([0, 1, 5, 3, 4, 2, 6], "lights swapped"),
        ([3, 1, 6, 0, 2, 5, 4], "lights in another order"),
    ],
)
def test_the_order_of_the_lights_is_found(stated: list[int], cause: str) -> None:
    (found,) = better_readings(stated_in(photographs(GLOSSY), stated))
    assert found.cause == cause
    # The stated light of the image that `order` names is the one's own.
    assert [stated[number] for number in found.order] == list(range(len(stated)))
    assert ", ".join(map(str, found.order)) in found.mend


def test_the_order_is_found_on_an_object_of_many_colours() -> None:
    radiance = STUDIO.clean(MATTE)
    texture = np.random.default_rng(0).uniform(0.2, 1.4, radiance.shape[1:])
    textured = STUDIO.expose(radiance * texture, seed=1).photographs
    assert not better_readings(textured)
    assert causes(stated_in(textured, [1, 2, 3, 4, 5, 6, 0])) == {"lights shifted by one"}


@pytest.mark.parametrize(("true", "stated"), [("srgb", "linear"), (2.2, "linear"), ("linear", "srgb"), ("linear", 2.2)])
def test_values_that_are_decoded_by_the_wrong_function(true: str | float, stated: str | float) -> None:
    light = STUDIO.clean(MATTE)
    stored = np.round(65535 * Encoding(true).encoded(0.9 * light / light.max())).astype(np.uint16)
    right = photographs()
    encoding = Encoding(stated, scale=float(light.max() / 0.9))
    (found,) = better_readings(replace(right, stored=tuple(stored), encoding=encoding))
    assert found.cause == f"transfer {true}"
    assert not better_readings(replace(right, stored=tuple(stored), encoding=replace(encoding, transfer=true)))


def test_near_lights_in_metres_beside_a_surface_in_millimetres() -> None:
    places = [(0.5, 1.0, 3.0), (-2.0, 0.4, 2.5), (1.5, -1.2, 3.0), (0.2, 2.2, 2.0), (2.0, 1.0, 2.0)]
    right = photographs(studio=Studio(size=48, lights=tuple((point(place, 20.0),) for place in places)))
    lights = tuple((replace(light, position=light.position / 1000),) for (light,) in right.scene.lights)
    stated = replace(right, scene=replace(right.scene, lights=lights))
    assert causes(stated) == {"lights in metres, surface in millimetres"}


def test_photographs_that_are_read_right_are_left_alone() -> None:
    generator = torch.Generator().manual_seed(0)

    def off(light: Tensor) -> Tensor:
        return normalize(light + 0.05 * torch.randn(3, generator=generator, dtype=light.dtype), dim=0)

    for material in (MATTE, GLOSSY):
        assert not better_readings(photographs(material))
        assert not better_readings(under(photographs(material), off))


def test_lights_that_are_the_same_are_not_exchanged() -> None:
    # Two photographs under one light, and every light brighter than stated by another factor.
    studio = replace(STUDIO, lights=(*STUDIO.lights, STUDIO.lights[0]))
    factors = np.array([1.0, 1.3, 0.8, 1.1, 0.7, 1.2, 0.9, 1.5])[:, None, None]
    uneven = studio.expose(factors * studio.clean(MATTE), seed=1).photographs
    assert not better_readings(uneven)
