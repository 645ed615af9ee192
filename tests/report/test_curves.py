"""Curves within a page."""

from __future__ import annotations

import re

import pytest

from matest.report.curves import Curve, drawing


def drawn(*values: float) -> str:
    return drawing(list(range(len(values))), [Curve("a", values, "#000")], (0, len(values)), "x", "y")


def ticks(svg: str) -> list[float]:
    """Of the axis upward."""
    return [float(text) for text in re.findall(r'text-anchor="end">([^<]+)<', svg)]


@pytest.mark.parametrize(
    "values", [(0.0, 1.0), (-3.0, 7.2), (1e-4, 2e-4), (-120.0, -100.0), (0.0, 0.0), (0.0, 9.99, 0.3)]
)
def test_round_ticks_hold_all_values_and_zero(values: tuple[float, ...]) -> None:
    found = ticks(drawn(*values))
    assert 2 <= len(found) <= 8
    assert found == sorted(found)
    assert 0 in found
    assert found[0] <= min(values)
    assert found[-1] >= max(values)


def test_a_curve_stays_in_its_frame_and_rises_with_its_values() -> None:
    (points,) = re.findall(r'points="([^"]+)"', drawn(-2.0, 0.5, 9.0))
    places = [tuple(map(float, point.split(","))) for point in points.split()]
    assert [x for x, _ in places] == sorted(x for x, _ in places)
    heights = [y for _, y in places]
    assert heights == sorted(heights, reverse=True)
    assert all(46 <= x <= 330 and 10 <= y <= 188 for x, y in places)
