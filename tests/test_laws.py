"""The physics and numerics that every model in the catalogue obeys, with every choice of its options, and a sum."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cache

import pytest
import torch
from torch import Tensor

from matest.brdf import Brdf, variants
from matest.directions import Directions
from tests import tolerances
from tests.sampling import (
    closed_domain_pairs,
    corners,
    directional_albedo,
    draw,
    linear,
    named,
    random_pairs,
    spherical,
    trained,
)

EVERY = pytest.mark.parametrize("expression", [*variants(), "oren-nayar+torrance-sparrow"])
# A furnace holds one material: components of a sum share the light as their owner decides.
ALONE = pytest.mark.parametrize("expression", variants())
PRECISION = pytest.mark.parametrize("dtype", [torch.float64, torch.float32], ids=["float64", "float32"])

OBLIQUE = [math.radians(angle) for angle in (0, 40, 60, 75, 85, 89.5)]
ANGULAR_LEVELS = [0.1, 0.17, 0.26, 0.35, 0.6, 1.0, math.pi / 2]
LOG_LEVELS = [0.1, 0.2, 0.5, 1.0]
# Sets of parameters that are differentiated together: eight of the integral over grooves take two gigabytes.
SETS_AT_ONCE = 8
# Lobes wide enough for the quadrature.
OWN_LEVELS = {
    "f0": [0.1, 1.0],
    "exponent": [1.0, 3.0, 10.0, 50.0],
    "height_rms": [0.2, 1.0],
    "correlation_length": [2.0, 5.0],
    "correlation_length_x": [2.0, 5.0],
    "correlation_length_y": [2.0],
    "wavelength": [0.55],
    "solid_angle": [0.1, 1.0],
}


def unit_columns(brdf: Brdf) -> list[Brdf]:
    """The model with one linear parameter at 1 and the others at 0, each in turn; itself if none is linear."""
    columns = linear(brdf)
    return [brdf.replace({name: float(name == column) for name in columns}) for column in columns] or [brdf]


def brightest(brdf: Brdf) -> Brdf:
    """Amplitudes at 1, and shape parameters [k, 1, 1] over their range."""
    shaped = {name: declared for name, declared in brdf.declared.items() if name not in linear(brdf)}
    levels = []
    for name, declared in shaped.items():
        if declared.unit == "rad":
            levels.append([level for level in ANGULAR_LEVELS if level <= declared.domain.upper])
        elif name in OWN_LEVELS:
            levels.append(OWN_LEVELS[name])
        else:
            levels.append(LOG_LEVELS if declared.log else [1.0])
    grid = torch.cartesian_prod(
        *(torch.tensor(level, dtype=torch.float64) for level in levels), torch.ones(1, dtype=torch.float64)
    )
    return brdf.replace({name: grid[:, i].reshape(-1, 1, 1) for i, name in enumerate(shaped)})


@cache
def largest_albedo(expression: str) -> float:
    brdf = named(expression)
    filled = [brightest(column) for column in unit_columns(brdf)]
    return max(directional_albedo(model, theta).max().item() for model in filled for theta in OBLIQUE)


def pieces(brdf: Brdf) -> Iterator[Brdf]:
    """A model of many sets of parameters [k, 1, 1] in parts, each small enough for the cache of a processor."""
    parts = {name: value.split(SETS_AT_ONCE) for name, value in brdf.parameters.items()}
    for values in zip(*parts.values(), strict=True):
        yield brdf.replace(dict(zip(parts, values, strict=True)))


def derivatives(brdf: Brdf, wi: Tensor, wo: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
    """Values, and the derivative of their sum by every parameter and both directions."""
    model, leaves = trained(brdf)
    wi, wo = wi.clone().requires_grad_(), wo.clone().requires_grad_()
    values = model(wi, wo)
    gradients = torch.autograd.grad(values.sum(), [*leaves, wi, wo], materialize_grads=True, allow_unused=True)
    return values.detach(), dict(zip([*brdf.declared, "wi", "wo"], gradients, strict=True))


@EVERY
def test_light_and_viewer_can_be_exchanged(expression: str) -> None:
    if tolerances.is_listed(expression, tolerances.NOT_RECIPROCAL):
        pytest.skip("listed as not reciprocal")
    brdf = draw(named(expression), (500, 1), seed=1)
    wi, wo = random_pairs(500, seed=2)
    there, back = brdf(wi, wo), brdf(wo, wi)
    torch.testing.assert_close(there, back, rtol=tolerances.INDEPENDENT, atol=tolerances.UNDERFLOW)


@EVERY
@PRECISION
def test_values_are_never_negative(expression: str, dtype: torch.dtype) -> None:
    """Nor on the closed domain, where values are looked at together with their derivatives."""
    brdf = draw(named(expression), (500, 1), seed=3)
    assert (brdf(*(vector.to(dtype) for vector in random_pairs(500, seed=4))) >= 0).all()


@pytest.mark.parametrize("expression", tolerances.NOT_RECIPROCAL)
def test_every_listed_lack_of_reciprocity_is_real(expression: str) -> None:
    brdf = draw(named(expression), (500, 1), seed=1)
    wi, wo = random_pairs(500, seed=2)
    assert not torch.allclose(brdf(wi, wo), brdf(wo, wi), rtol=0.1)


@EVERY
def test_some_light_is_reflected_above_the_horizon(expression: str) -> None:
    if tolerances.is_listed(expression, tolerances.DARK):
        pytest.skip("listed as dark in places")
    assert (named(expression)(*random_pairs(500, seed=5))[1::2] > 0).all()


@EVERY
@pytest.mark.parametrize("cosine", [0.0, -1e-9, -0.5, -1.0])
def test_nothing_is_reflected_at_or_below_the_horizon(expression: str, cosine: float) -> None:
    brdf = named(expression)
    theta = torch.tensor([0.0, 0.7, 1.5], dtype=torch.float64)
    above = spherical(theta, 0.3)
    below = torch.tensor([math.sqrt(1 - cosine * cosine), 0.0, cosine], dtype=torch.float64)
    assert (brdf(above, below) == 0).all()
    assert (brdf(below, above) == 0).all()
    assert (brdf(below, below) == 0).all()


@ALONE
def test_no_more_light_leaves_than_arrives(expression: str) -> None:
    allowed = tolerances.ALBEDO_EXCESS[expression].largest if expression in tolerances.ALBEDO_EXCESS else 1.0
    assert largest_albedo(expression) <= allowed + tolerances.FURNACE


@pytest.mark.parametrize("expression", tolerances.ALBEDO_EXCESS)
def test_every_listed_excess_is_real(expression: str) -> None:
    assert largest_albedo(expression) == pytest.approx(tolerances.ALBEDO_EXCESS[expression].largest, rel=0.005)


@EVERY
@PRECISION
def test_values_are_not_negative_and_all_is_finite_on_the_closed_domain(expression: str, dtype: torch.dtype) -> None:
    wi, wo = closed_domain_pairs(dtype)
    broken = []
    for brdf in pieces(corners(named(expression), dtype)):
        # One set of directions for each set of parameters, so that every derivative belongs to one evaluation.
        combinations = next(iter(brdf.parameters.values())).shape[0]
        brdf = brdf.replace({name: value.expand(-1, len(wi), 1) for name, value in brdf.parameters.items()})
        values, gradients = derivatives(brdf, wi.expand(combinations, -1, 3), wo.expand(combinations, -1, 3))
        for name, numbers in {"value": values, **gradients}.items():
            lowest = 0.0 if name == "value" else -math.inf
            bad = (~(numbers.isfinite() & (numbers >= lowest)).all(dim=-1)).nonzero().tolist()
            for k, j in bad[:1]:
                at = {key: value[k, j].item() for key, value in brdf.parameters.items()}
                place = f"first at {at}, wi = {wi[j].tolist()}, wo = {wo[j].tolist()}"
                broken.append(f"{name}: {len(bad)} of {numbers[..., 0].numel()}, {place}")
    assert not broken, "\n".join(broken)


@EVERY
def test_float32_agrees_with_float64(expression: str) -> None:
    wi, wo = (vector.float() for vector in random_pairs(3000, seed=6, most=math.pi / 2))
    clear = (wi[:, 2] > tolerances.NEARLY_GRAZING) & (wo[:, 2] > tolerances.NEARLY_GRAZING)
    wi, wo = wi[clear], wo[clear]
    brdf = draw(named(expression), (40, 1, 1), seed=7).to(torch.float32, "cpu")
    single, double = brdf(wi, wo).double(), brdf(wi.double(), wo.double())
    error = (single - double).abs()
    peak = double.amax(dim=1, keepdim=True)
    allowed = torch.maximum(tolerances.FLOAT32 * double, tolerances.FLOAT32_OF_PEAK * peak)
    worst = (error / allowed).argmax().item()
    k, j = divmod(worst, len(wi))
    at = {name: value[k].item() for name, value in brdf.parameters.items()}
    assert (error <= allowed).all(), (
        f"{single[k, j].item()} is not {double[k, j].item()} (peak {peak[k].item()}) "
        f"at {at}, wi = {wi[j].tolist()}, wo = {wo[j].tolist()}"
    )


@EVERY
@PRECISION
def test_precision_of_directions_is_precision_of_values(expression: str, dtype: torch.dtype) -> None:
    wi, wo = random_pairs(4, seed=8)
    assert named(expression)(wi.to(dtype), wo.to(dtype)).dtype == dtype


@EVERY
def test_derivatives_agree_with_differences(expression: str) -> None:
    brdf = draw(named(expression), (8, 1), seed=9)
    wi, wo = random_pairs(8, seed=10, most=1.3)
    names = list(brdf.declared)

    def evaluate(wi: Tensor, wo: Tensor, *values: Tensor) -> Tensor:
        return brdf.replace(dict(zip(names, values, strict=True)))(wi, wo)

    inputs = [tensor.clone().requires_grad_() for tensor in (wi, wo, *brdf.parameters.values())]
    assert torch.autograd.gradcheck(evaluate, inputs, atol=tolerances.DIFFERENCES, rtol=tolerances.DIFFERENCES)


@EVERY
def test_forward_mode_agrees_with_reverse_mode(expression: str) -> None:
    brdf = draw(named(expression), (50, 1), seed=11)
    wi, wo = random_pairs(50, seed=12)
    _, gradients = derivatives(brdf, wi, wo)
    generator = torch.Generator().manual_seed(13)
    inputs = {**brdf.parameters, "wi": wi, "wo": wo}
    tangents = {
        name: torch.randn(value.shape, generator=generator, dtype=value.dtype) for name, value in inputs.items()
    }

    def evaluate(inputs: dict[str, Tensor]) -> Tensor:
        return brdf.replace({name: inputs[name] for name in brdf.declared})(inputs["wi"], inputs["wo"])

    values, forward = torch.func.jvp(evaluate, (inputs,), (tangents,))
    parts = torch.cat([gradients[name] * tangents[name] for name in inputs], dim=-1)
    torch.testing.assert_close(values, brdf(wi, wo), rtol=0, atol=0)
    # Parts may be large and cancel: rounding is of their size.
    off = (forward - parts.sum(dim=-1, keepdim=True)).abs()
    assert (off <= tolerances.INDEPENDENT * (1 + parts.abs().sum(dim=-1, keepdim=True))).all()


@EVERY
def test_vmap_over_pixels_agrees_with_one_call(expression: str) -> None:
    brdf = draw(named(expression), (20, 1), seed=14)
    wi, wo = random_pairs(20, seed=15)

    def one(wi: Tensor, wo: Tensor, values: dict[str, Tensor]) -> Tensor:
        return brdf.replace(values)(wi, wo)

    mapped = torch.vmap(one)(wi, wo, brdf.parameters)
    torch.testing.assert_close(mapped, brdf(wi, wo), rtol=tolerances.INDEPENDENT, atol=tolerances.UNDERFLOW)


@EVERY
def test_scalar_parameters_give_one_channel(expression: str) -> None:
    brdf = named(expression)
    wi, wo = random_pairs(6, seed=16)
    assert brdf(wi, wo).shape == (6, 1)
    assert brdf(wi[0], wo[0]).shape == (1,)
    assert brdf(wi.reshape(2, 3, 3), wo.reshape(2, 3, 3)).shape == (2, 3, 1)
    torch.testing.assert_close(brdf(wi[0], wo), torch.stack([brdf(wi[0], view) for view in wo]))
    torch.testing.assert_close(brdf(wi, wo[0]), torch.stack([brdf(light, wo[0]) for light in wi]))


@EVERY
def test_parameters_per_channel_are_one_model_a_channel(expression: str) -> None:
    brdf = draw(named(expression), (3,), seed=17)
    wi, wo = random_pairs(50, seed=18)
    alone = [brdf.replace({name: value[c] for name, value in brdf.parameters.items()})(wi, wo) for c in range(3)]
    torch.testing.assert_close(brdf(wi, wo), torch.cat(alone, dim=-1))


@EVERY
def test_parameters_per_pixel_are_one_model_a_pixel(expression: str) -> None:
    brdf = draw(named(expression), (30, 1), seed=19)
    wi, wo = random_pairs(30, seed=20)
    alone = [brdf.replace({name: value[i] for name, value in brdf.parameters.items()})(wi[i], wo[i]) for i in range(30)]
    torch.testing.assert_close(brdf(wi, wo), torch.stack(alone))


@EVERY
def test_the_model_is_linear_in_its_amplitudes(expression: str) -> None:
    brdf = draw(named(expression), (200, 1), seed=21)
    # Up to 60 degrees no fitted polynomial turns negative, so nothing is cut at zero.
    pairs = random_pairs(200, seed=22, most=1.05)
    columns = linear(brdf)
    offset = brdf.replace(dict.fromkeys(columns, 0.0))(*pairs)
    expected = offset
    for column in columns:
        unit = brdf.replace({name: float(name == column) for name in columns})(*pairs)
        expected = expected + brdf.parameters[column] * (unit - offset)
    torch.testing.assert_close(brdf(*pairs), expected, rtol=tolerances.INDEPENDENT, atol=tolerances.INDEPENDENT)


@EVERY
def test_terms_are_the_model_as_a_polynomial(expression: str) -> None:
    brdf = draw(named(expression), (200, 1), seed=23)
    wi, wo = random_pairs(200, seed=24, most=1.05)
    total = sum(
        math.prod((factor.value(brdf.parameters) for factor in term.factors), start=term.shape)
        for term in brdf.terms(Directions(wi, wo))
    )
    torch.testing.assert_close(brdf(wi, wo), total, rtol=tolerances.INDEPENDENT, atol=tolerances.UNDERFLOW)
