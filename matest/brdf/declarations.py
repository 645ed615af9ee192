"""Parameters that several models share, declared once."""

from __future__ import annotations

import math
from typing import Any

from matest.parameters import Role, interval, non_negative, parameter, unit_interval


def amplitude(doc: str, default: float = 0.5, **kind: Any) -> Any:
    """The share of the light that a lobe reflects, one value a channel."""
    return parameter(unit_interval, unit="1", doc=doc, default=default, per_channel=True, **kind)


def albedo(doc: str = "facet albedo ρ") -> Any:
    return amplitude(doc)


def diffuse() -> Any:
    """Albedo of the diffuse part of a model of highlights: 0 beside a diffuse model."""
    return amplitude("albedo of the body", role=Role.BODY)


def sigma() -> Any:
    """σ of Oren and Nayar's surfaces."""
    return parameter(interval(0, math.pi / 2), unit="rad", doc="std. deviation of the facet slope angle", default=0.3)


def interreflection() -> Any:
    """Factor of the ρ² term: 1, or the reciprocal of an unknown light scale."""
    return parameter(non_negative, unit="1", doc="strength of the second bounce", default=1.0, role=Role.GAUGE)


def slope(doc: str, default: float, **kind: Any) -> Any:
    """Rms slope of a distribution of facets."""
    return parameter(interval(1e-3, 1), unit="1", doc=doc, default=default, log=True, role=Role.SLOPE, **kind)


def exponent() -> Any:
    """Exponent n of a power of a cosine."""
    return parameter(interval(1, 1e4), unit="1", doc="exponent n", default=50.0, log=True)


def f0(**kind: Any) -> Any:
    """Reflectance at normal incidence, that of glass unless the capture determines it."""
    doc = "reflectance at normal incidence"
    return parameter(unit_interval, unit="1", doc=doc, default=0.04, held=0.04, log=True, role=Role.FRESNEL, **kind)


def height_rms(doc: str = "rms height σ", default: float = 1.0, **kind: Any) -> Any:
    return parameter(interval(0.01, 2), unit="µm", doc=doc, default=default, log=True, **kind)


def correlation_length(doc: str = "correlation length τ", default: float = 5.0, **kind: Any) -> Any:
    return parameter(interval(1, 100), unit="µm", doc=doc, default=default, log=True, **kind)


def wavelength(**kind: Any) -> Any:
    """λ of every channel: that of green light unless the capture says it."""
    domain = interval(0.2, 2)
    return parameter(domain, unit="µm", doc="wavelength λ", default=0.55, held=0.55, role=Role.WAVELENGTH, **kind)


def solid_angle(**kind: Any) -> Any:
    """Solid angle of the lights, a few times the sun's unless the capture says it."""
    domain, doc, lamp = interval(1e-5, 1), "solid angle of the source", 5e-4
    return parameter(domain, unit="sr", doc=doc, default=lamp, held=lamp, log=True, role=Role.SOLID_ANGLE, **kind)


def k_udf(**kind: Any) -> Any:
    """Strength of first-surface uniform-diffuse reflection."""
    return amplitude("reflectance by multiple scattering", 0.3, **kind)


def k_uds(**kind: Any) -> Any:
    """Strength of subsurface uniform-diffuse reflection."""
    return amplitude("reflectance by subsurface scattering", **kind)


def k_fs(**kind: Any) -> Any:
    """Strength of subsurface forward scattering; it may exceed 1."""
    domain, doc = interval(0, 10), "scale of the forward-scattered light"
    return parameter(domain, unit="1", doc=doc, default=1.0, per_channel=True, **kind)
