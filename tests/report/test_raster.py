"""Which pixels a picture shows."""

from __future__ import annotations

import numpy as np

from matest.report.raster import Raster
from tests.captures import sphere_surface

SURFACE = sphere_surface(32)


def test_every_pixel_of_the_picture_is_the_middle_of_its_square() -> None:
    values = np.arange(len(SURFACE), dtype=np.uint8)[:, None]
    whole = SURFACE.image(values, background=7)
    for step in (1, 2, 3):
        raster = Raster.of(SURFACE, step)
        picture = raster.picture(values[raster.index], background=7)
        np.testing.assert_array_equal(picture, whole[step // 2 :: step, step // 2 :: step])
