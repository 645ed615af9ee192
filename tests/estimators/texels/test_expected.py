"""What samples will tell of texels of the same values, against dense matrices."""

from __future__ import annotations

import pytest
import torch

from matest.benchmark.instruments.photographs import Sensor, ring, sphere, subject
from matest.brdf import CookTorrance, OrenNayar
from matest.estimators.texels.expected import ExpectedTexels
from matest.estimators.texels.unknowns import TexelUnknowns
from matest.samples.texels import TexelTile
from matest.shading import shade
from tests.problems import problem

MATERIALS = {
    "oren-nayar": (OrenNayar([0.5, 0.35, 0.2], 0.4), "albedo", {}),
    "cook-torrance": (CookTorrance([0.5, 0.4, 0.2], 0.9, 0.2, f0=0.04), "diffuse", {"f0": 0.04}),
}


def expected(name: str, mapped: tuple[str, ...], lights: int) -> ExpectedTexels:
    material, _, fix = MATERIALS[name]
    capture = subject(sphere(32), ring(lights), material, Sensor()).photograph()
    tile = capture.photographs.samples(dtype=torch.float64).some_texels(40, 1)
    chosen = problem(name, channels=3, fix=fix)
    unknowns = chosen.unknowns_at({key: value.double() for key, value in material.parameters.items()})
    return ExpectedTexels.of(TexelUnknowns(chosen, mapped), unknowns, tile)


def dense(found: ExpectedTexels) -> torch.Tensor:
    """JᵀWJ of every texel in u [n, P, P], from derivatives of the shader."""
    tile, chosen = found.tile, found.texels.problem

    def radiance(unknowns: torch.Tensor) -> torch.Tensor:
        return shade(chosen.material(unknowns), tile.in_a_row.points)

    jacobian = torch.autograd.functional.jacobian(radiance, found.unknowns)
    weight = tile.in_a_row.weight(radiance(found.unknowns)) * tile.usable[:, None]
    every = torch.einsum("icp,ic,icq->ipq", jacobian, weight, jacobian)
    return every.unflatten(0, (tile.images, -1)).sum(0)


@pytest.mark.parametrize("name", MATERIALS)
def test_the_information_on_what_is_in_common_is_the_schur_complement(name: str) -> None:
    body = MATERIALS[name][1]
    found = expected(name, (body,), 4)
    chosen = found.texels.problem
    own = torch.zeros(chosen.size, dtype=torch.bool)
    own[chosen.where[body]] = True
    total = torch.zeros(int((~own).sum()), int((~own).sum()), dtype=torch.float64)
    for each in dense(found):
        if bool(each.diagonal()[own].gt(0).all()):
            total += each[~own][:, ~own] - each[~own][:, own] @ torch.linalg.solve(
                each[own][:, own], each[own][:, ~own]
            )
    torch.testing.assert_close(found.in_common([0, 1, 2, 3], (body,)), total, rtol=1e-6, atol=0)
    everything = dense(found).sum(0)
    torch.testing.assert_close(found.in_common([0, 1, 2, 3], ()), everything, rtol=1e-6, atol=1e-9)


def test_one_image_tells_nothing_of_what_is_in_common_beside_a_factor_of_texels() -> None:
    assert not found_in_one_image().any()


def found_in_one_image() -> torch.Tensor:
    return expected("oren-nayar", ("albedo",), 3).in_common([1], ("albedo",))


@pytest.mark.parametrize("name", MATERIALS)
def test_variances_of_texels_are_those_of_their_samples(name: str) -> None:
    body = MATERIALS[name][1]
    found = expected(name, (body,), 4)
    told = found.told([0, 2])
    part = ExpectedTexels(found.texels, found.unknowns, found.tile.of_images([0, 2]), found.informations[[0, 2]])
    own = found.texels.places
    for texel, each in enumerate(dense(part)):
        assert bool(told.seen[texel]) == bool(each.diagonal()[own].gt(0).all())
        if told.seen[texel]:
            # Beside a prior as wide as the domain.
            inverse = torch.linalg.inv(each[own][:, own] + torch.eye(len(own)))
            torch.testing.assert_close(told.variance[:, texel], inverse.diagonal(), rtol=1e-5, atol=0)


def test_what_a_tile_is_said_to_measure_takes_the_place_of_what_it_did() -> None:
    tile: TexelTile = expected("oren-nayar", ("albedo",), 3).tile
    bright = tile.measuring(torch.full_like(tile.radiance, 1e3))
    assert bright.noise.clipped is not None
    assert bool((bright.noise.clipped == 1).all())
    assert not bool((tile.noise.clipped == 1).any())  # type: ignore[union-attr]
    some = tile.of_images([2, 0])
    n = len(tile)
    torch.testing.assert_close(some.radiance, tile.radiance[[*range(2 * n, 3 * n), *range(n)]])
