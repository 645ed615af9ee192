"""Cross-sections of images."""

from __future__ import annotations

import numpy as np
import pytest

from matest.profiles import compare, cross_section, middle_row
from tests.captures import refusal


def ramp(height: int = 6, width: int = 9) -> np.ndarray:
    """Value 10·row + column."""
    rows, columns = np.indices((height, width))
    return (10 * rows + columns).astype(float)


def test_a_row_is_read_pixel_by_pixel() -> None:
    assert cross_section(ramp(), (0, 2, 8, 2)).tolist() == [20 + x for x in range(9)]


def test_a_column_is_read_from_top_to_bottom() -> None:
    assert cross_section(ramp(), (3, 0, 3, 5)).tolist() == [3, 13, 23, 33, 43, 53]


def test_a_line_read_backwards_is_reversed() -> None:
    forward, backward = cross_section(ramp(), (1, 1, 7, 4)), cross_section(ramp(), (7, 4, 1, 1))
    np.testing.assert_allclose(forward, backward[::-1])


def test_between_pixels_values_are_interpolated() -> None:
    np.testing.assert_allclose(cross_section(ramp(), (0.5, 1.5, 4.5, 1.5)), [15.5, 16.5, 17.5, 18.5, 19.5])


def test_colours_are_averaged() -> None:
    image = np.stack([ramp(), 2 * ramp(), 6 * ramp()], axis=2)
    np.testing.assert_allclose(cross_section(image, (0, 3, 8, 3)), 3 * cross_section(ramp(), (0, 3, 8, 3)))


def test_the_last_pixel_of_the_image_is_inside() -> None:
    assert cross_section(ramp(), (8, 5, 8, 5)).tolist() == [58]


@pytest.mark.parametrize(("shape", "line"), [((6, 9), (0, 3, 8, 3)), ((7, 4), (0, 3, 3, 3))])
def test_the_middle_row_spans_the_image(shape: tuple[int, int], line: tuple[float, ...]) -> None:
    assert middle_row(shape) == line


def test_comparison_measures_distance_from_the_first_image() -> None:
    first = ramp()
    second = first.copy()
    second[2, 4] += 3
    found = compare([first, second], ["photo", "model"], (0, 2, 8, 2))
    assert found.rms == [0, pytest.approx(1)]  # √(3²/9)
    assert found.maximum == [0, pytest.approx(3)]
    assert found.distance.tolist() == list(range(9))
    assert found.profiles.shape == (2, 9)
    assert found.names == ["photo", "model"]


def test_comparison_finds_where_each_profile_is_brightest() -> None:
    first, second = np.zeros((5, 8)), np.zeros((5, 8))
    first[1, 3], second[1, 6] = 1, 2
    assert compare([first, second], ["a", "b"], (1, 1, 7, 1)).peak == [2, 5]


def test_grey_and_colour_images_can_be_compared() -> None:
    colour = np.repeat(ramp()[..., None], 3, axis=2)
    assert compare([ramp(), colour], ["a", "b"], (0, 1, 8, 1)).maximum[1] == pytest.approx(0)


def test_images_of_different_sizes_are_refused() -> None:
    message = refusal(lambda: compare([ramp(), ramp(6, 8)], ["photo.png", "model.exr"], (0, 1, 7, 1)))
    assert "model.exr" in message
    assert "6×9" in message
    assert "6×8" in message


@pytest.mark.parametrize("line", [(-1, 0, 3, 0), (0, 0, 9, 0), (0, 6, 3, 0), (0, 0, 3, -0.5)])
def test_lines_that_leave_the_image_are_refused(line: tuple[float, float, float, float]) -> None:
    message = refusal(lambda: compare([ramp()], ["a"], line))
    assert "x runs from 0 to 8, y from 0 to 5" in message
