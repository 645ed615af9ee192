"""The patch whose maps are known everywhere."""

from __future__ import annotations

import numpy as np

from matest.benchmark.instruments.patch import patch
from matest.benchmark.suites.export import SMITH_GLOSS


def test_a_pixel_has_the_value_of_the_texel_that_it_shows() -> None:
    made = patch(SMITH_GLOSS, 24)
    assert made.surface.positions is not None
    assert len(made.surface) > 300
    x, y, z = made.surface.positions.numpy().T
    size = made.textured.size
    column, row = (np.floor(size * (side / z / 0.7 + 1) / 2).astype(int) for side in (x, -y))
    for name in ("diffuse", "slope"):
        texels = made.textured.textures[name].value[row, column]
        # Half a texel away a map has changed by so much at most.
        np.testing.assert_allclose(made.material.parameters[name].numpy(), texels, atol=0.004)
        assert np.ptp(texels, axis=0).min() > 0.09


def test_every_texel_is_on_the_patch() -> None:
    made = patch(SMITH_GLOSS, 8)
    assert len(made.textured.atlas.texels(made.textured.size)) == made.textured.size**2
    assert len(made.textured.seen) == made.textured.size**2
