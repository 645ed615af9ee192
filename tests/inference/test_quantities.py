"""Estimates of single parameters and the names of their channels."""

from __future__ import annotations

import pytest

from matest.inference.quantities import channel_names


@pytest.mark.parametrize(("count", "names"), [(1, ("0",)), (3, ("R", "G", "B")), (5, ("0", "1", "2", "3", "4"))])
def test_three_channels_are_red_green_and_blue(count: int, names: tuple[str, ...]) -> None:
    assert channel_names(count) == names
