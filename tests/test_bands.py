"""Images in bands of rows."""

from __future__ import annotations

import numpy as np
import pytest

from matest import bands as module
from matest.bands import bands
from matest.scene.surface import Surface, from_sphere

SIZE = 12


@pytest.fixture(autouse=True)
def _several_bands(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_BAND_RAYS", 100)


def sphere(factor: int) -> Surface:
    side = SIZE * factor
    return from_sphere((side, side), (side / 2, side / 2), 0.4 * side, None)


@pytest.mark.parametrize("factor", [1, 2, 3])
def test_bands_share_out_the_rows_and_the_rays(factor: int) -> None:
    surface = sphere(factor)
    parts = list(bands(surface, factor))
    assert len(parts) > 1
    assert [row for band in parts for row in band.rows] == list(range(SIZE))
    assert [ray for band in parts for ray in band.index] == list(range(len(surface)))


@pytest.mark.parametrize("factor", [1, 2, 3])
def test_pixels_are_means_over_their_rays_and_those_that_miss_count_as_zero(factor: int) -> None:
    surface = sphere(factor)
    values = np.random.default_rng(0).random((len(surface), 3))
    whole = [band.image(band.means(values[band.index.start : band.index.stop])) for band in bands(surface, factor)]
    fine = surface.image(values).reshape(SIZE, factor, SIZE, factor, 3)
    np.testing.assert_allclose(np.concatenate(whole), fine.mean(axis=(1, 3)), rtol=1e-14)


@pytest.mark.parametrize("factor", [1, 2, 3])
def test_coverage_is_the_share_of_rays_that_meet_the_surface(factor: int) -> None:
    surface = sphere(factor)
    coverage = np.concatenate([band.coverage for band in bands(surface, factor)])
    np.testing.assert_array_equal(
        coverage, surface.mask.reshape(SIZE, factor, SIZE, factor).mean(axis=(1, 3), dtype=float)
    )
