"""The sample of windows that a camera is judged by."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from matest.photographs.strata import one_per_stratum
from matest.photographs.windows import chosen_images, windows
from tests.captures import sphere_surface


def test_windows_are_neighbours_on_the_object_off_its_rim() -> None:
    surface = sphere_surface(64)
    index = windows(surface)
    assert len(index) > 1000
    places = surface.pixels[index]
    offsets = [row * 64 + column for row in (-1, 0, 1) for column in (-1, 0, 1)]
    np.testing.assert_array_equal(places - places[:, 4:5], np.broadcast_to(offsets, places.shape))
    assert not surface.rim[index].any()


def test_no_window_goes_round_the_edge_of_the_image() -> None:
    whole = sphere_surface(24)
    count = 24 * 24
    surface = replace(
        whole, pixels=np.arange(count), normals=whole.normals[:1].expand(count, 3), rim=np.zeros(count, dtype=bool)
    )
    columns = surface.pixels[windows(surface)] % 24
    assert (np.ptp(columns, axis=1) == 2).all()
    assert len(columns) == 22 * 22


def test_photographs_are_chosen_from_the_first_to_the_last() -> None:
    assert chosen_images([np.zeros(1)] * 3) == [0, 1, 2]
    many = chosen_images([np.zeros(1)] * 100)
    assert (many[0], many[-1], len(many)) == (0, 99, 8)


def test_one_index_is_drawn_from_each_stratum() -> None:
    index = one_per_stratum(1000, 10, np.random.default_rng(0))
    np.testing.assert_array_equal(index // 100, np.arange(10))
