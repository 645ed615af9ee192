"""Which reading the values of a table support."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from matest.brdf import Brdf, CookTorrance, Lambert
from matest.errors import InputError
from matest.tables import readings
from tests.tables.goniometer import hemispherical, measured


def lattice(material: Brdf, scale: str = "f", noise: float = 0.01) -> tuple[np.ndarray, np.ndarray]:
    """Angles and values on a lattice with every pair of directions and the exchanged one."""
    thetas, azimuths = np.radians(np.arange(10, 81, 10)), np.radians(np.arange(0, 360, 15))
    theta_i, theta_r, phi = (part.ravel() for part in np.meshgrid(thetas, thetas, azimuths, indexing="ij"))
    angles = np.stack([theta_i, np.zeros_like(phi), theta_r, phi], axis=1)
    wi = torch.from_numpy(np.stack([np.sin(theta_i), 0 * phi, np.cos(theta_i)], axis=1))
    wo = torch.from_numpy(
        np.stack([np.sin(theta_r) * np.cos(phi), np.sin(theta_r) * np.sin(phi), np.cos(theta_r)], axis=1)
    )
    values = material(wi, wo).numpy()
    values = values * (1 + noise * np.random.default_rng(0).standard_normal(values.shape))
    factor = {"f": 1.0, "pi-f": math.pi, "f-cos": np.cos(angles[:, :1])}[scale]
    return angles, values * factor


MATTE, GLOSS = Lambert(0.7), CookTorrance(0.4, 1.0, 0.2)


@pytest.mark.parametrize("material", [MATTE, GLOSS], ids=["matte", "gloss"])
def test_reciprocity_tells_f_from_f_cos(material: Brdf) -> None:
    assert readings.quantity(*lattice(material, "f-cos")) == "f-cos"


def test_more_light_than_there_is_tells_pi_f() -> None:
    assert readings.quantity(*lattice(MATTE, "pi-f")) == "pi-f"


def test_f_and_pi_f_are_refused_where_both_are_possible() -> None:
    with pytest.raises(InputError, match=r"f and π f fit alike: the surface would reflect 70% or 22%"):
        readings.quantity(*lattice(MATTE))


def test_without_exchanged_pairs_nothing_is_guessed() -> None:
    angles, values = lattice(MATTE)
    with pytest.raises(InputError, match="too few pairs of exchanged directions"):
        readings.quantity(angles[:100], values[:100])
    with pytest.raises(InputError, match="f and f cos θi fit alike"):
        readings.quantity(*lattice(MATTE, noise=3.0))


def test_a_bright_side_toward_the_light_is_no_highlight() -> None:
    """Retro-reflection: as sharp as a highlight, and darker at oblique incidence."""
    table = measured(GLOSS, hemispherical())
    theta_i = torch.acos(table.wi[:, 2])
    towards = (table.wi * table.wo).sum(-1).clamp(-1, 1).acos()
    values = (0.05 + theta_i.cos() * torch.exp(-((towards / 0.15) ** 2)))[:, None].numpy()
    phi = torch.atan2(table.wo[:, 1], table.wo[:, 0]) - math.pi
    angles = torch.stack([theta_i, 0 * phi, torch.acos(table.wo[:, 2]), phi], dim=1).numpy()
    with pytest.raises(InputError, match="both readings fit alike"):
        readings.azimuth(angles, values)


def test_units_are_seen_or_declared() -> None:
    angles = np.array([[0.5, 0.0, 1.2, 3.0]])
    assert readings.in_radians(angles, None)[0] == "rad"
    assert readings.in_radians(np.degrees(angles), None)[0] == "deg"
    np.testing.assert_allclose(readings.in_radians(np.degrees(angles), None)[1], angles)
    assert readings.in_radians(angles, "deg")[0] == "deg"
