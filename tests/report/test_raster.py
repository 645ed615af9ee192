"""Which pixels a picture shows."""

from __future__ import annotations

import numpy as np

from matest.report.picture_size import PictureSize
from matest.report.raster import Raster, Window
from matest.scene.surface import from_sphere
from tests.captures import sphere_surface

SURFACE = sphere_surface(32)


def test_every_pixel_of_the_picture_is_the_middle_of_its_square() -> None:
    values = np.arange(len(SURFACE), dtype=np.uint8)[:, None]
    whole = SURFACE.image(values, background=7)
    for step in (1, 2, 3):
        raster = Raster.of(SURFACE, step)
        picture = raster.picture(values[raster.index], background=7)
        np.testing.assert_array_equal(picture, whole[step // 2 :: step, step // 2 :: step])


def test_pictures_of_a_small_object_show_the_part_about_it() -> None:
    surface = from_sphere((90, 120), (100, 30), 12, None)
    window = Window.of(surface)
    rows, columns = np.divmod(surface.pixels, 120)
    assert 0 < rows.min() - window.first[0] < 6
    assert 0 < columns.min() - window.first[1] < 6
    raster = Raster.of(surface, 1, window)
    assert raster.shape == window.shape
    assert max(window.shape) < 36
    np.testing.assert_array_equal(raster.index, np.arange(len(surface)))
    corner = tuple(slice(first, first + side) for first, side in zip(*window, strict=True))
    values = np.arange(len(surface), dtype=np.uint8)[:, None]
    np.testing.assert_array_equal(raster.picture(values, background=7), surface.image(values, background=7)[corner])


def test_pictures_of_a_large_object_and_full_ones_show_all_of_a_photograph() -> None:
    assert Window.of(SURFACE) == Window((0, 0), SURFACE.shape)
    assert Window.of(from_sphere((90, 120), (100, 30), 12, None), PictureSize.FULL).shape == (90, 120)
