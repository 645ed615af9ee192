"""Photographs at a few of their pixels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from matest.brdf import Lambert
from matest.photographs.lattice import on_lattice
from matest.photographs.photometry import Encoding
from matest.scene.bits import Bits
from tests.simulated import Studio


def test_a_lattice_keeps_what_belongs_to_its_pixels() -> None:
    whole = Studio(size=60).photograph(Lambert(0.6), seed=1).photographs
    count = len(whole.scene.surface)
    flat = np.linspace(0.5, 1, count, dtype=np.float32)[:, None]
    shade = np.arange(count) % 5 == 0
    shaded = replace(whole.scene, shadows=((Bits.of(shade),),) * len(whole), shadow_edge=(None,) * len(whole))
    thin = on_lattice(replace(whole, encoding=Encoding(flat=flat, black=0.01 * flat), scene=shaded), count // 9 + 1)
    surface = thin.scene.surface
    assert abs(len(surface) - count / 9) < 0.1 * count / 9
    # Where the pixels of the lattice lie in the images.
    rows, columns = np.divmod(surface.pixels, surface.shape[1])
    some = np.flatnonzero(np.isin(whole.scene.surface.pixels, 3 * rows * 60 + 3 * columns))
    assert np.array_equal(surface.normals, whole.scene.surface.normals[some])
    assert np.array_equal(thin.stored[2], whole.stored[2][some])
    assert np.array_equal(thin.encoding.flat, flat[some])
    assert np.array_equal(thin.encoding.black, 0.01 * flat[some])
    assert np.array_equal(np.asarray(thin.scene.shadows[0][0]), shade[some])


def test_few_pixels_are_all_kept() -> None:
    whole = Studio(size=24).photograph(Lambert(0.6), seed=1).photographs
    assert on_lattice(whole, 1000) is whole
