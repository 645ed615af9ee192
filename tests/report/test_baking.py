"""Tables of a material, interpolated as the shader of the page does, against the model itself."""

from __future__ import annotations

import math
from collections.abc import Mapping

import pytest
import torch
from torch import Tensor

from matest.brdf import Brdf, CookTorrance, Lambert, OrenNayar, model
from matest.directions import to_local
from matest.parameters import interval, parameter, parameters_of
from matest.report.baking import SIDE_NODES, TOP, BakedMaterial, bake, coordinates, span
from tests.captures import sphere_surface
from tests.tolerances import RELIT_GLOSSY, RELIT_MATTE

NORMALS = sphere_surface(64).normals.double()
VIEWER = torch.tensor([[0.0, 0.0, 1.0]], dtype=torch.float64)
# Beside the viewer, from the side, from behind.
LIGHTS = [torch.nn.functional.normalize(torch.tensor(light, dtype=torch.float64), dim=0) for light in
          ((0.1, 0.0, 1.0), (0.85, 0.25, 0.45), (-0.7, 0.45, -0.2))]  # fmt: skip
PLASTIC = CookTorrance([0.5, 0.2, 0.1], 1.0, 0.1, 0.04)
METAL = CookTorrance(0.0, 1.0, slope=0.1, eta=[0.2, 0.8, 1.3], k=[3.5, 2.6, 2.3], fresnel="conductor")


def looked_up(table: Tensor, places: tuple[Tensor, ...]) -> Tensor:
    """Values [n, C] of a table [W, P, H, C] between its nodes, from places [n] over θh, ψ, ω."""
    parts = []
    for place, size in zip(reversed(places), table.shape, strict=False):
        below = place.floor().clamp(0, size - 2)
        parts.append((below.long(), place - below))
    total = torch.zeros(len(places[0]), table.shape[-1], dtype=torch.float64)
    for corner in range(8):
        index, weight = [], torch.ones_like(places[0])
        for axis, (below, part) in enumerate(parts):
            upper = corner >> axis & 1
            index.append(below + upper)
            weight = weight * (part if upper else 1 - part)
        total += weight[:, None] * table[tuple(index)]
    return total


def angles(normals: Tensor, light: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """θh, ψ and ω [n], by plain geometry."""
    half = torch.nn.functional.normalize(light + VIEWER[0], dim=0)
    cos_half = normals @ half
    along = torch.nn.functional.normalize(cos_half[:, None] * half - normals, dim=-1)
    theta = torch.atan2(torch.linalg.cross(normals, half.expand_as(normals)).norm(dim=-1), cos_half)
    psi = torch.atan2(along @ light, (half @ light).expand(len(normals)))
    omega = torch.asin((torch.linalg.cross(along, half.expand_as(along)) @ light).abs().clamp(max=1))
    return theta, psi, omega


def interpolated(baked: BakedMaterial, values: Mapping[str, Tensor], normals: Tensor, light: Tensor) -> Tensor:
    """Reflectance [n, C] as the shader has it."""
    places = coordinates(*angles(normals, light), reciprocal=baked.reciprocal)
    total = torch.zeros(len(normals), 1, dtype=torch.float64)
    for term in baked.terms:
        shape = looked_up(term.base, places) + TOP
        for name, moves in term.moves.items():
            channels = [
                torch.lerp(looked_up(moves[below], places), looked_up(moves[below + 1], places), float(node - below))
                for node in baked.spans[name].node(values[name])
                for below in [min(int(node), 2 * SIDE_NODES - 1)]
            ]
            by_channel = len(channels) > 1
            shape = shape + (torch.stack([m[:, k] for k, m in enumerate(channels)], -1) if by_channel else channels[0])
        total = total + term.unit * shape.sinh() * math.prod(factor.value(values) for factor in term.factors)
    return total.clamp(min=0)


def shown(radiance: Tensor) -> Tensor:
    """sRGB codes, by the standard's formula."""
    linear = radiance.clamp(0, 1)
    return 255 * torch.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def largest_error(material: Brdf, changes: Mapping[str, float] | None = None) -> float:
    """Over a sphere under all lights, in codes of a screen whose white is that of the page.

    `changes`: shares of the way from the estimate of parameters to their upper (+1) or lower (−1) end.
    """
    baked = bake(material)
    values = {name: torch.atleast_1d(value.double()) for name, value in material.parameters.items()}
    for name, share in (changes or {}).items():
        one = baked.spans[name]
        values[name] = one.value + abs(share) * ((one.upper if share > 0 else one.lower) - one.value)
    errors = []
    for light in LIGHTS:
        lit = NORMALS[NORMALS @ light > 0]
        wi, wo = to_local(lit, light[None], VIEWER)
        truth = material.replace(values)(wi, wo) * wi[:, 2:]
        white = truth.amax(-1).quantile(0.995) / 0.8
        table = interpolated(baked, values, lit, light) * wi[:, 2:]
        errors.append(float((shown(truth / white) - shown(table / white)).abs().max()))
    return max(errors)


@pytest.mark.parametrize("changes", [{}, {"sigma": 0.5}, {"sigma": -0.8}], ids=str)
def test_matte_tables_are_exact_to_two_codes(changes: dict[str, float]) -> None:
    assert largest_error(OrenNayar([0.7, 0.6, 0.5], 0.6), changes) < RELIT_MATTE


@pytest.mark.parametrize("changes", [{}, {"slope": 0.5}, {"slope": -0.5}, {"f0": 0.8, "slope": 0.5}], ids=str)
def test_glossy_tables_are_exact_to_four_codes(changes: dict[str, float]) -> None:
    assert largest_error(PLASTIC, changes) < RELIT_GLOSSY


@pytest.mark.parametrize("changes", [{}, {"slope": 0.4}, {"k": 0.7}, {"eta": -0.5}], ids=str)
def test_channels_of_a_metal_have_tables_of_their_own(changes: dict[str, float]) -> None:
    assert largest_error(METAL, changes) < RELIT_GLOSSY


@pytest.mark.parametrize("expression", ["ward", "lafortune", "blinn-phong", "fujii", "eon", "neumann-neumann",
                                        "oren-nayar+torrance-sparrow"])  # fmt: skip
def test_other_models_need_no_code_of_their_own(expression: str) -> None:
    assert largest_error(model(expression)[0]) < RELIT_GLOSSY


def test_a_model_that_is_not_reciprocal_has_tables_of_both_sides() -> None:
    scattering = model("li-torrance(forward=on)")[0].replace({"k_fs": 5.0})
    baked = bake(scattering)
    assert not baked.reciprocal
    assert bake(PLASTIC).reciprocal
    assert baked.terms[0].base.shape[1] == 2 * bake(PLASTIC).terms[0].base.shape[1] - 1
    assert largest_error(scattering) < RELIT_GLOSSY


def test_an_even_reflection_is_exact() -> None:
    assert largest_error(Lambert([0.7, 0.6, 0.5])) < 1e-9


def test_an_anisotropic_model_says_so() -> None:
    with pytest.raises(ValueError, match="anisotropic"):
        bake(model("ward(anisotropy=axes)")[0])


def test_nodes_are_places_of_their_values() -> None:
    for material in (PLASTIC, OrenNayar(0.7, 0.2), METAL):
        for each in bake(material).spans.values():
            for node in range(2 * SIDE_NODES + 1):
                inside = (each.lower < each.value) & (each.value < each.upper)
                assert each.node(each.at(node))[inside].tolist() == pytest.approx([node] * int(inside.sum()))


def test_ranges_of_maps_are_reached_and_a_zero_among_them_is_not_infinitely_far() -> None:
    ends = torch.tensor([0.0]).double(), torch.tensor([0.75]).double()
    baked = bake(PLASTIC, {"f0": ends})
    assert baked.spans["f0"].upper.item() == 0.75
    assert 0 < baked.spans["f0"].lower.item() < 1e-3
    assert all(bool(moves.isfinite().all()) for term in baked.terms for moves in term.moves.values())


def test_a_parameter_at_an_end_of_its_domain_moves_to_one_side() -> None:
    sigma = parameters_of(OrenNayar)["sigma"]
    one = span(sigma, torch.tensor([0.0], dtype=torch.float64), amplitude=False)
    assert one.lower.tolist() == [0.0]
    assert one.upper.item() > 0
    assert one.node(torch.tensor([0.0, 9.0], dtype=torch.float64)).tolist() == [SIDE_NODES, 2 * SIDE_NODES]


def test_an_amplitude_goes_down_to_nothing_and_not_beyond_its_domain() -> None:
    field = parameter(interval(0, 1), unit="1", doc="", default=0.5, log=True)
    declared = next(iter(field.metadata.values()))
    assert span(declared, torch.tensor([0.7]).double(), amplitude=True).lower.tolist() == [0.0]
    assert span(declared, torch.tensor([0.7]).double(), amplitude=True).upper.tolist() == [1.0]
    # Under lights of unknown strength.
    assert span(declared, torch.tensor([3.0]).double(), amplitude=True).upper.tolist() == [3.0]
