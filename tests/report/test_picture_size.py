"""How large the pictures of a report are."""

from __future__ import annotations

import pytest

from matest.report.picture_size import MAX_PREVIEW_SIDE, MIN_PREVIEW_SIDE, PictureSize


@pytest.mark.parametrize(
    ("shape", "step"),
    [
        ((1, 1), 1),
        ((499, 499), 1),
        ((20, 500), 2),
        ((500, 20), 2),
        ((750, 750), 3),
        ((1024, 1024), 4),
        ((2400, 3200), 4),
        ((2400, 3201), 5),
        ((4000, 6000), 8),
    ],
)
def test_a_preview_takes_one_pixel_of_so_many(shape: tuple[int, int], step: int) -> None:
    assert PictureSize.PREVIEW.step(shape) == step


def test_previews_keep_between_their_limits() -> None:
    for side in range(MIN_PREVIEW_SIDE, 20000, 7):
        step = PictureSize.PREVIEW.step((side, side))
        assert step is not None
        assert MIN_PREVIEW_SIDE <= side / step <= MAX_PREVIEW_SIDE


def test_full_pictures_take_every_pixel_and_none_takes_none() -> None:
    assert PictureSize.FULL.step((4000, 6000)) == 1
    assert PictureSize.NONE.step((4000, 6000)) is None
