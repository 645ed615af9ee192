"""Spherical harmonics up to the order that irradiance needs."""

from __future__ import annotations

import math

import numpy as np
import torch

from matest.scene.harmonics import TRUNCATION, cosine_coefficients, harmonics
from tests import environments
from tests.tolerances import INDEPENDENT


def test_harmonics_are_orthonormal() -> None:
    z, weight = np.polynomial.legendre.leggauss(12)
    azimuth = np.arange(24) * 2 * math.pi / 24
    polar, around = np.meshgrid(np.arccos(z), azimuth, indexing="ij")
    basis = harmonics(torch.from_numpy(environments.directions(polar, around))).flatten(0, 1)
    weights = torch.from_numpy(np.repeat(weight, 24) * 2 * math.pi / 24)
    gram = basis.T @ (weights[:, None] * basis)
    torch.testing.assert_close(gram, torch.eye(len(gram), dtype=torch.float64), rtol=0, atol=100 * INDEPENDENT)


def test_they_make_the_legendre_series_of_the_clamped_cosine() -> None:
    coefficients = cosine_coefficients()
    one, others = environments.normals(1), environments.normals(4001)
    series = (harmonics(others) * coefficients) @ harmonics(one)[0]
    cosine = (others @ one[0]).clamp(min=0)
    # Ramamoorthi and Hanrahan's A_0, A_1, A_2 and A_4.
    printed = torch.tensor([math.pi, 2 * math.pi / 3, math.pi / 4, -math.pi / 24], dtype=torch.float64)
    torch.testing.assert_close(coefficients[[0, 1, 4, 9]], printed, rtol=INDEPENDENT, atol=0)
    assert 0.98 * TRUNCATION < float((series - cosine).abs().max()) < TRUNCATION
