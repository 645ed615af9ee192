"""Objects whose material differs from place to place, and how right the maps of it are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any
from zlib import crc32

import numpy as np
import torch
from torch import Tensor

import matest
from matest.benchmark.instruments.photographs import Sensor, Subject, ring, subject
from matest.benchmark.instruments.waves import Waves, places
from matest.brdf import model
from matest.capture import Capture
from matest.estimation.parameter_map import ParameterMap, TexelStatus
from matest.estimation.result import Estimate
from matest.scene import Surface

# Channels of the photographs.
_CHANNELS = 3
# Where the values of two materials lie in their ranges, as shares: far apart, and off the ends.
_TWO = (0.2, 0.8)


@dataclass(frozen=True)
class Kind:
    """A material that differs from place to place.

    Attributes:
        expression: of the model.
        ranges: ends of the values of each parameter that has a map, the albedo of the body first.
        shared: values of the parameters that are the same everywhere, and to be found.
        fixed: values that are stated.
    """

    expression: str
    ranges: Mapping[str, tuple[float, float]]
    shared: Mapping[str, float | list[float]] = field(default_factory=dict)
    fixed: Mapping[str, float] = field(default_factory=dict)

    @property
    def shape(self) -> str:
        """The parameter with a map that shapes the reflectance; the albedo where none does."""
        return list(self.ranges)[-1]


_ALBEDO = (0.1, 0.7)
_SLOPE = (0.08, 0.35)
# rad.
_SIGMA = (0.15, 0.7)
KINDS = {
    "cook-torrance": Kind(
        "cook-torrance", {"diffuse": _ALBEDO, "slope": _SLOPE}, {"specular": [0.9] * _CHANNELS}, {"f0": 0.04}
    ),
    "oren-nayar": Kind("oren-nayar", {"albedo": _ALBEDO, "sigma": _SIGMA}),
    "oren-nayar, albedo": Kind("oren-nayar", {"albedo": _ALBEDO}, {"sigma": 0.4}),
}


def photographed(kind: Kind, surface: Surface, lights: int, seed: int, *, materials: int | None = None) -> Subject:
    """An object before a camera, every parameter that has a map varying.

    Args:
        kind: of the material.
        surface: the object.
        lights: number of photographs, each under one light of a ring.
        seed: of the material and of the noise.
        materials: 2: one on each side of a line through the middle; None: smooth waves.
    """
    brdf, _ = model(kind.expression)
    generator = np.random.default_rng([crc32(kind.expression.encode()), seed])
    draw = _waves if materials is None else _halves
    values: dict[str, Any] = {}
    for name, ends in kind.ranges.items():
        channels = _CHANNELS if brdf.declared[name].per_channel else 1
        values[name] = torch.from_numpy(draw(generator, places(surface), ends, channels))
    for name, value in {**kind.shared, **kind.fixed}.items():
        values[name] = torch.tensor(value, dtype=torch.float64)
    return subject(surface, ring(lights), brdf.replace(values), Sensor(), channels=_CHANNELS, seed=seed)


def _waves(generator: np.random.Generator, at: np.ndarray, ends: tuple[float, float], channels: int) -> np.ndarray:
    """Smooth fields [N, channels]."""
    return np.stack([Waves(generator).between(at, *ends) for _ in range(channels)], axis=1)


def _halves(generator: np.random.Generator, at: np.ndarray, ends: tuple[float, float], channels: int) -> np.ndarray:
    """One value left and another one right of the middle [N, channels]; which is higher is drawn."""
    low, high = ends
    first, second = (low + (high - low) * share for share in generator.permutation(_TWO))
    return np.repeat(np.where(at[:, :1] < 0, first, second), channels, axis=1)


def estimated(kind: Kind, capture: Capture) -> Estimate:
    """The estimate of a material of this kind with its maps."""
    return matest.estimate(capture, kind.expression, fix=dict(kind.fixed), maps=tuple(kind.ranges))


def tells(each: ParameterMap) -> Tensor:
    """The pixels whose own photographs tell the value [N]."""
    return (each.status == TexelStatus.DETERMINED) | (each.status == TexelStatus.AT_BOUND)


def known_to(each: ParameterMap, error: float) -> Tensor:
    """The pixels whose own photographs tell the value with a relative standard error below `error` [N]."""
    return tells(each) & (each.std < error * each.value).all(1)


def relative_errors(value: Tensor, truth: Tensor) -> Tensor:
    """Of a map, without their sign [N, 1 or C]."""
    return (value.double() / truth - 1).abs()
