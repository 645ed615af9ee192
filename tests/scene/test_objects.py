"""Which object each pixel of a surface shows."""

from __future__ import annotations

import numpy as np
import pytest

from matest.errors import InputError
from matest.scene.objects import Objects

SHAPE = (9, 12)


def halves() -> tuple[Objects, np.ndarray]:
    """The left half of an image shows one object, the right half another one; a third is not seen."""
    pixels = np.arange(SHAPE[0] * SHAPE[1])
    return Objects(("left", "right", "hidden"), (pixels % SHAPE[1] >= 6).astype(np.uint8)), pixels


def test_pixels_beside_another_object_are_a_rim_of_both() -> None:
    objects, pixels = halves()
    rim = objects.borders(SHAPE, pixels).reshape(SHAPE)
    assert rim[:, 4:8].all()
    assert not rim[:, :4].any()
    assert not rim[:, 8:].any()


def test_an_object_is_found_by_its_name() -> None:
    objects, _ = halves()
    assert objects.number("right", "capture") == 1
    assert objects.seen == {"left": 0, "right": 1}
    assert objects.take(objects.pixels_of(1)).seen == {"right": 1}


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        (None, r"capture: shows several objects \(left, right, hidden\)"),
        ("rihgt", "shows no object 'rihgt'; did you mean 'right'"),
        ("hidden", "no pixel shows the object 'hidden'"),
    ],
)
def test_what_cannot_be_chosen_is_refused(name: str | None, expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        halves()[0].number(name, "capture")


def test_the_only_object_needs_no_name() -> None:
    assert Objects(("vase",), np.zeros(3, np.uint8)).number(None, "capture") == 0
